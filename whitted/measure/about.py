"""Facts for people and bug reports: of this installation, and of a scene's kernel."""

import os
import re
from collections import Counter
from importlib.metadata import version
from pathlib import Path

import drjit as dr
from drjit.llvm import Float

from .. import llvm
from ..lights import DirectionalLight
from ..scene.features import (
    branches_out,
    glossy,
    may,
    reflects,
    refracts,
    shadow,
    weights_vary,
)
from ..scene.scene import Scene
from ..shapes import SHAPES


def system() -> dict[str, str]:
    """Versions, the libLLVM in use and why, vector width, threads, and where kernels are cached."""
    library = llvm.configure()
    cache = os.environ.get("DRJIT_CACHE_DIR") or Path.home() / ".drjit"
    return {
        "Dr.Jit": version("drjit"),
        "libLLVM": f"{library.path} ({library.reason})",
        "vector width": f"{_vector_width()} single-precision lanes",
        "threads": str(dr.thread_count()),
        "kernel cache": str(cache),
    }


def _vector_width() -> str:
    """The width of the vectors in a small kernel's LLVM code."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        dr.eval(dr.opaque(Float, 1) + 1)
        dr.sync_thread()
        code = "".join(kernel["ir"].getvalue() for kernel in dr.kernel_history() if "ir" in kernel)
    widths = re.search(r"<(\d+) x float>", code)
    return widths[1] if widths else "unknown"


def features(scene: Scene) -> list[str]:
    """The features of a scene that its kernel is compiled for."""
    counts = Counter(type(shape) for shape in scene.singles)
    counted = [_count(counts[kind], kind.__name__.lower()) for kind in SHAPES if counts[kind]]
    lights, facts = scene.lights, scene.features
    shadows = {shadow(scene, material) for material in scene.used}
    materials_that_fill = [m.name for m in scene.used if may(scene, m, "refraction")]
    fills = sum(one.made_of(materials_that_fill) for one in scene.sets)
    fills += sum(one.count for one in scene.sources if one.material in materials_that_fill)
    optional = {
        f"{_count(len(lights), 'light')} with hard shadows": bool(lights),
        "inverse-square falloff": any(getattr(x, "falloff", "none") != "none" for x in lights),
        "directional light": any(isinstance(light, DirectionalLight) for light in lights),
        "partial shadows": bool(lights) and "part" in shadows,
        "Lambert": any(may(scene, m, "color") or m.checker for m in scene.used),
        "checkerboard": any(m.checker for m in scene.used),
        "Blinn-Phong": glossy(scene),
        "ambient": "ambient" in facts.live,
        "reflection": reflects(scene),
        "refraction": refracts(scene),
        "Fresnel": weights_vary(scene),
        "a tree of spheres": bool(scene.sources),
        "media search": fills > 1,
        "least importance": scene.min_importance > 0,
        "compensated sums": bool(facts.places.compensated),
        "coinciding primitives": bool(facts.places.hidden),
        "tree of rays": branches_out(scene),
        "chain of rays": reflects(scene) and not branches_out(scene),
    }
    return counted + [name for name, present in optional.items() if present]


def compiled_in(scene: Scene) -> str:
    """The features of a scene, in words."""
    return ", ".join(features(scene)) or "nothing"


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
