"""The public face, as text: a change of a name, of an argument or of a default is noticed here.

If the change is meant, change the text along with the contract and the documentation.
"""

import dataclasses
import inspect

import whitted as wt

NAMES = {
    "BackendError": "(RuntimeError)",
    "FitResult": (
        "(scene, parameters, uncertainty, covariance, labels, loss, gains, history, stopped, "
        "notes=<factory>)"
    ),
    "Scene": (
        "(camera, resolution, shapes, materials, lights, background, ambient, max_depth=5, "
        "min_importance=0.0, touched=frozenset(), fixed=None)"
    ),
    "SceneError": "(ValueError)",
    "__version__": "str",
    "fit": (
        "(scene, target=None, *, wrt, method='auto', spp=4, iterations=None, levels=None, "
        "starts=1, seed=0, bounds=None, mask=None, gain=False, boundary=True, max_depth=None, "
        "resolution=None, tolerance=1e-06, progress=True, callback=None)"
    ),
    "gradient": (
        "(scene, name, component=None, spp=1, *, error=None, boundary=None, terms='both', "
        "max_depth=None, resolution=None, progress=None)"
    ),
    "load_scene": "(path, precision='single')",
    "read_image": "(path, layer=None)",
    "render": (
        "(scene, spp=1, *, error=None, boundary=None, terms='both', max_depth=None, "
        "resolution=None, progress=None)"
    ),
    "torch_render": "(scene, parameters, spp=1, **options)",
    "write_image": "(path, image, metadata=None)",
}
# Attributes and methods of what users hold
MEMBERS = {
    wt.Scene: {
        "ambient": "field",
        "background": "field",
        "camera": "field",
        "carrying": "(self, values)",
        "features": "property",
        "fixed": "field",
        "lights": "field",
        "locations": "property",
        "materials": "field",
        "max_depth": "field",
        "min_importance": "field",
        "names_by_shape": "property",
        "neutral": "property",
        "numbers": "property",
        "parameters": "(self, *names)",
        "precision": "property",
        "replace": "(self, values)",
        "resolution": "field",
        "sets": "property",
        "shapes": "field",
        "structure": "property",
        "touched": "field",
        "used": "property",
    },
    wt.FitResult: {
        "covariance": "field",
        "gains": "field",
        "history": "field",
        "labels": "field",
        "loss": "field",
        "named": "(self, x)",
        "notes": "field",
        "numbers": "(self)",
        "parameters": "field",
        "plot": "(self, path=None)",
        "scene": "field",
        "stopped": "field",
        "uncertainty": "field",
    },
}


def signature(function):
    """Names and defaults of a function's arguments, without their types."""
    whole = inspect.signature(function)
    bare = [each.replace(annotation=each.empty) for each in whole.parameters.values()]
    return str(whole.replace(parameters=bare, return_annotation=whole.empty))


def described(value):
    """A function or a class by its arguments, an exception by what it is, others by their type."""
    if isinstance(value, type) and issubclass(value, Exception):
        return f"({value.__base__.__name__})"
    return signature(value) if callable(value) else type(value).__name__


def members(kind):
    """The public members of a dataclass, by name."""
    found = {field.name: "field" for field in dataclasses.fields(kind)}
    for name in dir(kind):
        if not name.startswith("_") and name not in found:
            value = inspect.getattr_static(kind, name)
            found[name] = signature(value) if inspect.isfunction(value) else "property"
    return dict(sorted(found.items()))


def test_public_names_and_their_arguments():
    assert {name: described(getattr(wt, name)) for name in wt.__all__} == NAMES


def test_members_of_scenes_and_results():
    assert {kind: members(kind) for kind in MEMBERS} == MEMBERS


def test_all_that_is_imported_is_listed():
    """What is neither a module nor private is public on purpose."""
    found = {
        name
        for name, value in vars(wt).items()
        if not name.startswith("_") and not inspect.ismodule(value)
    }
    assert found - {"Path", "configure"} == set(wt.__all__) - {"__version__"}
