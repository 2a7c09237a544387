"""HTML pages, made by Jinja2, an optional dependency."""

import base64
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import jinja2

HERE = "whitted.files"


def page_template(package: str, name: str) -> "jinja2.Template":
    """Load a template that escapes the values put into it.

    It may extend `page.html`, which stands beside this file. The filter `data_uri` puts a picture
    into the page, given the path of a PNG, so that the page needs no other file.

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
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(own, "") for own in (package, HERE)]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_uri"] = _data_uri
    return environment.get_template(name)


def _data_uri(png: Path) -> str:
    return f"data:image/png;base64,{base64.b64encode(png.read_bytes()).decode()}"
