"""Derivatives of the summed image, by central differences in double precision.

Prints them as JSON, by name of common.PROBES.
"""

import json

import common

# Samples a pixel, and half the difference of the parameters
SPP, STEP = 16, 1e-4


def total(name: str, component: int, change: float) -> float:
    """The sum of the image with one number changed."""
    import drjit as dr

    import whitted as wt

    scene = wt.load_scene(common.SCENE, "double")
    parameters = scene.parameters(name)
    old = parameters[name]
    if len(common.values()[name]) == 3:
        parameters[name] = old + type(old)(*[change if k == component else 0 for k in range(3)])
    else:
        parameters[name] = old + change
    image = wt.render(scene.replace(parameters), spp=SPP, boundary=True)
    return float(dr.sum(image, axis=None).array[0])


def references() -> dict[str, float]:
    """The derivatives, by name of common.PROBES."""
    places = [(name, k) for name in common.NAMES for k in range(len(common.values()[name]))]
    probes = {probe: places[place] for probe, place in common.PROBES.items()}
    return {
        probe: (total(*place, STEP) - total(*place, -STEP)) / (2 * STEP)
        for probe, place in probes.items()
    }


if __name__ == "__main__":
    print(json.dumps(references()))
