"""What this installation consists of, for people and for bug reports."""

import os
import re
from importlib.metadata import version
from pathlib import Path

import drjit as dr
from drjit.llvm import Float

from . import llvm
from .scene import Scene
from .surface import transparent
from .trace import branches_out, reflects, refracts


def system() -> dict[str, str]:
    """Versions, the libLLVM in use and why, vector width, threads and the folder of compiled kernels."""
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
    """The width that a small kernel's code was generated for."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        dr.eval(dr.opaque(Float, 1) + 1)
        dr.sync_thread()
        code = "".join(kernel["ir"].getvalue() for kernel in dr.kernel_history() if "ir" in kernel)
    widths = re.search(r"<(\d+) x float>", code)
    return widths[1] if widths else "unknown"


def features(scene: Scene) -> list[str]:
    """What a scene's kernel has compiled in."""
    materials = scene.used
    primitives = [_count(len(scene.spheres), "sphere"), _count(len(scene.planes), "plane")]
    dielectric = refracts(scene) and any(m.fresnel for m in materials)
    optional = {
        f"{_count(len(scene.lights), 'light')} with hard shadows": scene.lights,
        "inverse-square falloff": any(light.inverse_square for light in scene.lights),
        "Lambert": any(scene.may(m, "color") or m.checker for m in materials),
        "checkerboard": any(m.checker for m in materials),
        "Blinn-Phong": any(scene.may(m, "specular") for m in materials),
        "ambient": "ambient" in scene.nonzero,
        "reflection": reflects(scene),
        "refraction": refracts(scene),
        "Fresnel": dielectric,
        "media search": len(transparent(scene)) > 1,
        "least importance": scene.min_importance > 0,
        "compensated sums": any(sphere.wide for sphere in scene.spheres),
        "coinciding primitives": scene.twins,
        "tree of rays": branches_out(scene),
        "chain of rays": reflects(scene) and not branches_out(scene),
    }
    return [text for text in primitives if text[0] != "0"] + [name for name, present in optional.items() if present]


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
