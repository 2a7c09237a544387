"""Errors of derivatives against the time of a gradient, of this version and of another one.

    python benchmarks/pareto.py [CHECKOUT]

CHECKOUT is a clone of another version, with its own .venv: versions as far back as f173d22 have
what this asks for. Scenes have 128 pixels along the longer side. Time is that of an image and its
reverse gradient by all centres, radii and indices, best of several calls; plain is an image of
plain samples. Errors are those of d image / d parameter against results/references/, which
`references.py` made. The figures are written to results/pareto.csv, and a chart of them to
results/pareto.png (needs the `bench` extra).
"""

import csv
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
RESULTS = HERE.parent / "results"
SAMPLES, CALLS = (1, 4), 9
COLUMNS = ("version", "scene", "spp", "plain ms", "gradient ms", "parameter", "error", "of it")


def scene_file(name: str) -> Path:
    """The file of a scene, shipped or of the benchmarks."""
    shipped = HERE.parent / "scenes" / f"{name}.toml"
    return shipped if shipped.exists() else HERE / f"{name}.toml"


def best(call, calls: int = CALLS) -> float:
    """The shortest time of a call, in milliseconds, after one that compiles."""
    call()
    times = []
    for _ in range(calls):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times) * 1e3


def measure(name: str, spp: int, names: list[str]) -> dict:
    """Times and derivatives of one scene, of the version in the search path."""
    import drjit as dr

    import whitted as wt

    scene = wt.load_scene(scene_file(name))
    values = scene.parameters()
    wrt = {k: v for k, v in values.items() if k.endswith((".center", ".radius", ".ior"))}
    longest = max(scene.resolution)
    size = tuple(round(side * 128 / longest) for side in scene.resolution)

    def gradient() -> None:
        dr.enable_grad(wrt)
        image = wt.render(scene.replace(wrt), spp=spp, resolution=size)
        dr.backward(dr.mean(dr.square(image - 0.3)))
        dr.eval([dr.grad(value) for value in wrt.values()])
        dr.sync_thread()
        dr.disable_grad(wrt)

    def plain() -> None:
        dr.eval(wt.render(scene, spp=spp, resolution=size, boundary=False))
        dr.sync_thread()

    errors = {}
    with np.load(RESULTS / "references" / f"{name}.npz") as known:
        for full in names:
            parameter, _, axis = full.rpartition(".")
            if len(axis) > 1:
                parameter, axis = full, None
            image = wt.gradient(scene, parameter, axis, spp=spp, resolution=size)
            sharp = known[full].astype(float)
            errors[full] = np.linalg.norm(image.numpy() - sharp) / np.linalg.norm(sharp)
    return {"plain": best(plain), "gradient": best(gradient), "errors": errors}


def serve(checkout: str) -> None:
    """Answer questions on standard input, one a line, with the version in a checkout."""
    sys.path.insert(0, checkout)
    for line in sys.stdin:
        try:
            answer = measure(*json.loads(line))
        except ValueError:
            # A scene that the version does not know
            answer = {}
        print(json.dumps(answer), flush=True)


def ask(checkouts: dict[str, Path]) -> list[dict]:
    """Measure all scenes with all versions, in turn."""
    servers = {
        version: subprocess.Popen(
            [folder / ".venv/bin/python", __file__, "--serve", folder],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for version, folder in checkouts.items()
    }
    rows = []
    for file in sorted((RESULTS / "references").glob("*.npz")):
        with np.load(file) as known:
            own = {n: float(known[f"{n} error"]) for n in known if not n.endswith(" error")}
        for spp in SAMPLES:
            for version, server in servers.items():
                server.stdin.write(json.dumps([file.stem, spp, list(own)]) + "\n")
                server.stdin.flush()
                found = json.loads(server.stdout.readline())
                if not found:
                    continue
                times = round(found["plain"], 2), round(found["gradient"], 1)
                for parameter, error in found["errors"].items():
                    values = version, file.stem, spp, *times, parameter, round(error, 4)
                    row = dict(zip(COLUMNS, (*values, round(own[parameter], 4)), strict=True))
                    rows.append(row)
                errors = " ".join(f"{error:.3f}" for error in found["errors"].values())
                print(f"{file.stem:14} spp {spp:2} {version:8} {times[1]:8} ms  {errors}")
    for server in servers.values():
        server.stdin.close()
        server.wait()
    return rows


def draw(rows: list[dict]) -> None:
    """A chart of mean errors against times, a panel for each scene."""
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    scenes = sorted({row["scene"] for row in rows})
    lines = -(-len(scenes) // 4)
    figure, axes = plt.subplots(lines, 4, figsize=(13, 3.1 * lines), layout="constrained")
    for panel, scene in zip(axes.flat, scenes, strict=False):
        for version in dict.fromkeys(row["version"] for row in rows):
            own = [row for row in rows if (row["scene"], row["version"]) == (scene, version)]
            if not own:
                continue
            times = [next(r["gradient ms"] for r in own if r["spp"] == n) for n in SAMPLES]
            means = [np.mean([r["error"] for r in own if r["spp"] == n]) for n in SAMPLES]
            panel.loglog(times, means, "o-", label=version)
        panel.set(title=scene, xlabel="image and gradient, ms", ylabel="mean error")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_formatter(NullFormatter())
    for panel in axes.flat[len(scenes) :]:
        panel.axis("off")
    axes.flat[0].legend()
    figure.savefig(RESULTS / "pareto.png", dpi=100)


def main() -> None:
    if sys.argv[1:2] == ["--serve"]:
        serve(sys.argv[2])
        return
    checkouts = {"now": HERE.parent}
    if len(sys.argv) > 1:
        checkouts["before"] = Path(sys.argv[1]).resolve()
    rows = ask(checkouts)
    with open(RESULTS / "pareto.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    draw(rows)


if __name__ == "__main__":
    main()
