"""The public face, as text: a change of a name, of an argument or of a default is noticed here.

If the change is meant, change the text along with the contract and the documentation.
"""

import dataclasses
import inspect

import whitted as wt

NAMES = {
    "BackendError": "(RuntimeError)",
    "Camera": "(*, position, look_at, fov, resolution, up=(0, 1, 0))",
    "Checkerboard": "(*, color, size)",
    "Cloud": "(name=None, *, center=None, radius=None, spheres=None, material)",
    "DirectionalLight": "(name=None, *, direction, irradiance)",
    "Disc": "(name=None, *, center, normal, radius, material)",
    "FitResult": (
        "(scene, parameters, uncertainty, covariance, labels, loss, quality, gains, history, "
        "stopped, notes=<factory>)"
    ),
    "Material": (
        "(name, *, color=(0, 0, 0), specular=0, shininess=50, reflection=0, refraction=0, ior=1.5, "
        "shadow=1, fresnel=False, checker=None)"
    ),
    "Pick": "(name, point, distance, sphere)",
    "Plane": "(name=None, *, normal, offset, material)",
    "PointLight": "(name=None, *, position, intensity, falloff='none')",
    "Scene": (
        "(camera, *, spheres=(), planes=(), discs=(), clouds=(), lights=(), materials=(), "
        "background=(0, 0, 0), ambient=(0, 0, 0), max_depth=5, min_importance=0, "
        "precision='single')"
    ),
    "SceneError": "(ValueError)",
    "Sphere": "(name=None, *, center, radius, material)",
    "__version__": "str",
    "fit": (
        "(scene, target=None, *, wrt, method='auto', spp=4, iterations=None, levels=None, "
        "starts=1, seed=0, budget=30.0, bounds=None, mask=None, gain=False, priors=None, "
        "robust=None, boundary=True, max_depth=None, resolution=None, tolerance=1e-06, "
        "progress=True, callback=None)"
    ),
    "from_mitsuba": "(source, precision='single', *, approximate=False)",
    "gradient": (
        "(scene, name, component=None, spp=1, *, error=None, boundary=None, terms='both', "
        "max_depth=None, resolution=None, progress=None)"
    ),
    "load_scene": "(path, precision='single')",
    "parse_scene": "(text, precision='single')",
    "pick": "(scene, x, y, *, through=False, resolution=None)",
    "read_image": "(path, layer=None)",
    "render": (
        "(scene, spp=1, *, error=None, boundary=None, terms='both', max_depth=None, "
        "resolution=None, rows=None, unroll=None, progress=None)"
    ),
    "show": "(image)",
    "to_srgb": "(image)",
    "torch_render": (
        "(scene, parameters, spp=1, *, error=None, boundary=None, terms='both', max_depth=None, "
        "resolution=None, progress=None)"
    ),
    "view": "(scene)",
    "write_image": "(path, image, metadata=None)",
}
# Attributes and methods of what users hold
MEMBERS = {
    wt.Scene: {
        "add": "(self, *new)",
        "ambient": "field",
        "astype": "(self, precision)",
        "background": "field",
        "camera": "field",
        "carrying": "(self, values)",
        "clouds": "field",
        "differentiated": "(self)",
        "features": "property",
        "fixed": "field",
        "folder": "field",
        "from_dict": "(tables, precision='single')",
        "gathered": "property",
        "gathering": "(self, gathered)",
        "given": "property",
        "inputs": "(self)",
        "lights": "field",
        "locations": "property",
        "many": "field",
        "marked": "property",
        "materials": "field",
        "max_depth": "field",
        "min_importance": "field",
        "names_by_shape": "property",
        "neutral": "property",
        "number_of": "(self, name)",
        "numbers": "property",
        "owner_of": "(self, number)",
        "parameters": "(self, *names)",
        "precision": "property",
        "remove": "(self, *names)",
        "replace": "(self, values)",
        "resolution": "field",
        "save": "(self, path)",
        "sets": "property",
        "shapes": "field",
        "singles": "property",
        "sources": "property",
        "structure": "property",
        "text": "field",
        "to_dict": "(self)",
        "to_mitsuba": "(self, *, approximate=False)",
        "touched": "field",
        "tree": "property",
        "used": "property",
    },
    wt.FitResult: {
        "covariance": "field",
        "gains": "field",
        "history": "field",
        "iterations": "property",
        "labels": "field",
        "loss": "field",
        "named": "(self, x)",
        "notes": "field",
        "numbers": "(self)",
        "parameters": "field",
        "plot": "(self, path=None)",
        "quality": "field",
        "scene": "field",
        "stopped": "field",
        "summary": "(self)",
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
            value = getattr(kind, name) if isinstance(value, classmethod) else value
            called = inspect.isfunction(value) or inspect.ismethod(value)
            found[name] = signature(value) if called else "property"
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
    assert found - {"Path", "configure", "show_in_notebooks"} == set(wt.__all__) - {"__version__"}
