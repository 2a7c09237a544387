"""What peers share: the scene, and a loop that answers run.py.

Each peer stays in a process of its own, so that peers can take turns.
"""

import json
import os
import sys
import time
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

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
# Which of the 24 numbers the derivatives of the summed image are compared by
PROBES = {"sphere x": 8, "mirror x": 0, "index": 13}


class MissingError(Exception):
    """A peer is not installed."""


def scene(path: str | Path = SCENE) -> dict:
    """What a scene file says, in TOML or in JSON."""
    text = Path(path).read_text()
    return json.loads(text) if str(path).endswith(".json") else tomllib.loads(text)


def values() -> dict[str, list[float]]:
    """The 12 parameters by name, each a list of one or three numbers."""
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
    """The 24 numbers of a gradient that is given by parameter."""
    import numpy as np

    return [float(v) for name in NAMES for v in np.ravel(np.array(gradients[name]))]


def memory() -> float:
    """The largest resident memory of this process so far, in MB."""
    # `ru_maxrss` would not do: a child's begins with its parent's
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


class Peer:
    """What a peer can do. What it cannot do stays None."""

    image = None  # the picture
    gradient = None  # the derivatives of the image's mean square by the 24 numbers
    sums = None  # derivatives of the summed image, by name of PROBES
    milliseconds = None  # of the last call, where the peer takes the time itself
    megabytes = None  # of the last call, where the peer runs another process
    compiled = None  # seconds of compiling or loading, where they are not part of the first call


def answer(peer: Peer, request: dict) -> dict:
    """Do one call, and take its time."""
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
    """Answer requests from stdin, each a line of JSON, with such lines on stdout.

    Args:
        make: makes the peer.
    """
    # What libraries print must not mix with answers, even if they do not print through Python
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    try:
        peer = make()
        print(json.dumps({"ready": True}), file=out, flush=True)
    except (ImportError, MissingError) as error:
        print(json.dumps({"missing": str(error)}), file=out, flush=True)
        return
    for line in sys.stdin:
        print(json.dumps(answer(peer, json.loads(line))), file=out, flush=True)
