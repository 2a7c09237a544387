"""BSDFs and materials."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import numpy as np

from .node import CLOSE, Node
from .report import Report, equals
from .walls import Wall, cells, to_uv


@dataclass(frozen=True)
class Surface:
    """What a BSDF is here, as far as that does not depend on its shape."""

    name: str
    path: str
    # Of the material's table
    keys: Mapping[str, Any] = field(default_factory=dict)
    # Its back is black in Mitsuba
    one_sided: bool = False
    # Of glass: the indices of refraction inside and outside
    indices: tuple[float, float] | None = None
    # The texture of its colour
    checkerboard: Node | None = None


# Mitsuba's own, of shapes without one
DEFAULT = Surface("default", "", {"color": [0.5] * 3}, one_sided=True)


def surface(node: Node, name: str) -> Surface:
    """What a BSDF is here."""
    if not node.taken():
        return Surface(name, node.path)
    found = {
        "diffuse": _diffuse,
        "twosided": _twosided,
        "dielectric": _dielectric,
        "roughdielectric": _dielectric,
        "conductor": _conductor,
        "roughconductor": _conductor,
    }[node.type](node, name)
    node.finish()
    return found


def _diffuse(node: Node, name: str) -> Surface:
    texture = node.child("texture")
    if texture is None or not texture.taken():
        keys = {} if texture else {"color": node.color("reflectance", 0.5, 1.0)}
        return Surface(name, node.path, keys, one_sided=True)
    return Surface(name, node.path, one_sided=True, checkerboard=texture)


def _twosided(node: Node, name: str) -> Surface:
    inner = node.child("bsdf")
    if inner is None:
        node.report.refuse(node.path, "'twosided' without a material in it")
        return Surface(name, node.path)
    if inner.type in ("dielectric", "roughdielectric"):
        node.report.refuse(node.path, f"'{inner.type}' has two sides, and cannot be in 'twosided'")
    return replace(surface(inner, name), one_sided=False)


def _dielectric(node: Node, name: str) -> Surface:
    _smooth(node)
    indices = node.index("int_ior", "bk7"), node.index("ext_ior", "air")
    keys = {
        "fresnel": True,
        "reflection": node.weight("specular_reflectance"),
        "refraction": node.weight("specular_transmittance"),
    }
    return Surface(name, node.path, keys, indices=indices)


def _conductor(node: Node, name: str) -> Surface:
    _smooth(node)
    if node.has("material") and str(node.table["material"]) != "none":
        why = "metals have no counterpart; expected 'none', a mirror"
        node.report.refuse(node.told("material"), why)
    for key in ("eta", "k"):
        if node.has(key):
            node.report.refuse(node.told(key), "metals have no counterpart; expected none")
    return Surface(
        name, node.path, {"reflection": node.weight("specular_reflectance")}, one_sided=True
    )


def _smooth(node: Node) -> None:
    """Refuse what makes a surface rough."""
    if not node.type.startswith("rough"):
        return
    node.ignore("distribution", "sample_visible")
    given = [key for key in ("alpha", "alpha_u", "alpha_v") if node.has(key)] or ["alpha"]
    for key in given:
        node.report.differ(
            node.told(key), "rough surfaces have no counterpart", "a smooth one is taken"
        )


def on_wall(found: Surface, wall: Wall | None) -> Surface:
    """A surface with the colours of its checkerboard on a wall, where it has one.

    Args:
        wall: None for a shape that has other texture coordinates than a rectangle.
    """
    texture = found.checkerboard
    if texture is None:
        return found
    colors = [texture.color("color0", 0.4, 1.0), texture.color("color1", 0.2, 1.0)]
    transform = _texture_transform(texture)
    texture.finish()
    fitting = cells(wall, transform) if wall else None
    if fitting is None:
        why = "expected square cells along the world's axes from the origin on, on a rectangle"
        texture.report.refuse(equals(texture.at("type"), texture.type), why)
        return found
    size, swapped = fitting
    color, other = reversed(colors) if swapped else colors
    keys = {"color": color, "checker": {"color": other, "size": size}}
    return replace(found, keys=keys, checkerboard=None)


def _texture_transform(texture: Node) -> np.ndarray:
    value: Any = texture.table.get("to_uv")
    if np.shape(getattr(value, "matrix", value))[:1] == (3,):
        return texture.matrix("to_uv", 3)
    return np.delete(np.delete(texture.matrix("to_uv"), 2, 0), 2, 1)


def bsdf(
    name: str,
    material: Mapping[str, Any],
    report: Report,
    around: float,
    two_sided: bool,
    wall: Wall | None,
) -> dict[str, Any]:
    """The BSDF of a material.

    Args:
        material: its table, with all its keys.
        around: of glass, the index of refraction of what is around it.
        two_sided: of other materials, whether their backs can be seen.
        wall: the rectangle that is made of it; None for other shapes.
    """
    where = f"materials.{name}"
    if material["specular"]:
        _drop(report, where, material, "specular", "highlights have no counterpart in Mitsuba")
    if material["shadow"] != 1:
        _drop(report, where, material, "shadow", "Mitsuba's shadows are full")
    if material["refraction"]:
        return _glass(where, material, report, around)
    found = _opaque(where, material, report, wall)
    return {"type": "twosided", "bsdf": found} if two_sided else found


def _drop(report: Report, where: str, material: Mapping, key: str, why: str) -> None:
    report.differ(equals(f"{where}.{key}", material[key]), why, "it is left out")


def _opaque(where: str, material: Mapping, report: Report, wall: Wall | None) -> dict[str, Any]:
    reflection, board = material["reflection"], material.get("checker")
    brightest = max(*material["color"], *(board["color"] if board else ()))
    if reflection and material["fresnel"]:
        why = "a reflection by the Fresnel equations of an opaque material has no counterpart"
        _drop(report, where, material, "reflection", why)
        reflection = 0
    elif reflection and brightest:
        painted = "checker" if board else "color"
        fainter = "reflection" if reflection < brightest else painted
        why = "a reflection beside a color has no counterpart"
        _drop(report, where, material, fainter, why)
        reflection = 0 if fainter == "reflection" else reflection
    if reflection:
        return {"type": "conductor", "specular_reflectance": _rgb([reflection] * 3)}
    color = _checkerboard(where, material, report, wall) if board else _rgb(material["color"])
    return {"type": "diffuse", "reflectance": color}


def _checkerboard(
    where: str, material: Mapping, report: Report, wall: Wall | None
) -> dict[str, Any]:
    board = material["checker"]
    colors = {"color0": _rgb(material["color"]), "color1": _rgb(board["color"])}
    transform = np.eye(4)
    if wall is None or abs(wall.normal).max() < 1 - CLOSE:
        report.refuse(f"{where}.checker", "expected only on planes that are square to an axis")
    else:
        transform = to_uv(wall, board["size"])
    return {"type": "checkerboard", **colors, "to_uv": dr.scalar.Matrix4f64(transform)}


def _rgb(color: Sequence[float]) -> dict[str, Any]:
    return {"type": "rgb", "value": list(color)}


def _glass(where: str, material: Mapping, report: Report, around: float) -> dict[str, Any]:
    if max(material["color"]):
        _drop(report, where, material, "color", "the color of a glass has no counterpart")
    weights = [material["reflection"], material["refraction"]]
    if not material["fresnel"]:
        why = "constant weights of glass have no counterpart"
        told = equals(f"{where}.fresnel", material["fresnel"])
        report.differ(told, why, "they are shared out by the Fresnel equations")
        weights = [1.0, 1.0]
    names = "specular_reflectance", "specular_transmittance"
    return {
        "type": "dielectric",
        "int_ior": float(material["ior"]),
        "ext_ior": float(around),
        **{
            name: _rgb([weight] * 3)
            for name, weight in zip(names, weights, strict=True)
            if weight != 1
        },
    }
