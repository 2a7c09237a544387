"""HTML pages, made by Jinja2, an optional dependency."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import jinja2


def page_template(package: str, name: str) -> "jinja2.Template":
    """Load a template that escapes the values put into it.

    Args:
        package: the package that holds the template, such as "whitted.measure".
        name: the template's file name.

    Raises:
        RuntimeError: Jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError:
        raise RuntimeError(
            "reports need Jinja2, which is missing; install it with: pip install 'whitted[bench]'"
        ) from None
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(package, ""),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)
