"""What peers share: the scene, and a loop that answers run.py, so that peers stay in processes of
their own and take turns.
"""

import json
import os
import sys
import time
from pathlib import Path

import tomllib

HERE = Path(__file__).parent
SCENE = HERE.parent / "yardstick.toml"
SPHERES = [f"spheres.sphere{k}.{field}" for k in range(3) for field in ("center", "radius")]
MATERIALS = ["materials.mirror.ior", "materials.glass.ior", "materials.green.ior"]
# The 12 parameters of a gradient, 24 numbers in this order
NAMES = [
    *SPHERES,
    *MATERIALS,
    "lights.light0.position",
    "lights.light0.intensity",
    "camera.position",
]
# Numbers among the 24 whose derivative of the summed image is compared
PROBES = {"sphere x": 8, "mirror x": 0, "index": 13}


class Missing(Exception):
    """A peer is not installed."""


def scene() -> dict:
    """The scene file."""
    return tomllib.loads(SCENE.read_text())


def values() -> dict[str, list[float]]:
    """The 12 parameters' values by name, the scalars as lists of one."""
    loaded = scene()
    found = {}
    for k, sphere in enumerate(loaded["spheres"]):
        found |= {
            f"spheres.sphere{k}.center": sphere["center"],
            f"spheres.sphere{k}.radius": [sphere["radius"]],
        }
    found |= {name: [loaded["materials"][name.split(".")[1]].get("ior", 1.5)] for name in MATERIALS}
    light = loaded["lights"][0]
    found |= {
        "lights.light0.position": light["position"],
        "lights.light0.intensity": light["intensity"],
    }
    return found | {"camera.position": loaded["camera"]["position"]}


def flat(gradients: dict) -> list[float]:
    """The 24 numbers of a gradient by name."""
    import numpy as np

    return [float(v) for name in NAMES for v in np.ravel(np.array(gradients[name]))]


def memory() -> float:
    """The largest resident memory of this process so far, in MB."""
    # Not ru_maxrss, in which a child starts with its parent's
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


class Peer:
    """What a peer may do; what it cannot stays None."""

    image = None  # the picture
    gradient = None  # of the mean of squares by the 24 numbers, one value each
    sums = None  # derivatives of the summed image by name of PROBES
    milliseconds = None  # of the last call by the peer's own clock, if it has one
    megabytes = None  # likewise
    compiled = None  # seconds, if not in the first call


def answer(peer: Peer, request: dict) -> dict:
    """Does one call, timed."""
    import numpy as np

    call = getattr(peer, request["call"])
    if call is None:
        return {"cannot": True}
    start = time.perf_counter()
    result = call()
    milliseconds = (time.perf_counter() - start) * 1e3
    reply = {
        "ms": peer.milliseconds or milliseconds,
        "megabytes": peer.megabytes or memory(),
        "compiled": peer.compiled,
    }
    if "path" in request:
        np.save(request["path"], np.array(result))
    elif request["call"] != "image":
        reply["result"] = result
    return reply


def serve(make) -> None:
    """Answers requests on stdin, a line of JSON each, with lines on stdout."""
    # What libraries print, by any way, must not mix with answers
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    try:
        peer = make()
        print(json.dumps({"ready": True}), file=out, flush=True)
    except (ImportError, Missing) as error:
        print(json.dumps({"missing": str(error)}), file=out, flush=True)
        return
    for line in sys.stdin:
        print(json.dumps(answer(peer, json.loads(line))), file=out, flush=True)
