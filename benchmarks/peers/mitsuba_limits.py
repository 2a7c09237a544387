"""What Mitsuba 3 can differentiate by, in a scene like the yardstick's.

    python benchmarks/peers/mitsuba_limits.py

Prints JSON: for each parameter that is asked for, Mitsuba's own flags, which tell whether it can be
differentiated and whether it moves edges. Last comes the derivative of a picture by the radius of a
ball that is seen in an ideal mirror only.
"""

import json

ASKED = {
    "index of a smooth dielectric": "s1.bsdf.eta",
    "position of a point light": "light.position",
    "position of the camera": "sensor.to_world",
    "position of a matte sphere": "s2.to_world",
    "position of a mirror": "s0.to_world",
}


def flags() -> dict[str, str]:
    """What Mitsuba's flags say of each parameter."""
    import mitsuba as mi
    from mitsuba_paths import description

    mi.set_variant("llvm_ad_rgb")
    parameters = mi.traverse(mi.load_dict(description("prb_projective")))
    found = {}
    for what, key in ASKED.items():
        if key not in parameters:
            found[what] = "is not among the parameters"
            continue
        flag = parameters.flags(key)
        names = [
            name
            for name in ("NonDifferentiable", "Discontinuous")
            if flag & int(getattr(mi.ParamFlags, name))
        ]
        found[what] = ", ".join(names) or "Differentiable"
    return found


def mirrored(spp: int = 256) -> tuple[float, float]:
    """d sum / d radius of a ball that is seen in an ideal mirror only.

    Returns:
        The derivative by prb_projective, and by differences of its images.
    """
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    look = mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0])
    wall = mi.ScalarTransform4f().translate([0, 0, -2]).scale(3)
    mirror = {"type": "conductor", "material": "none"}
    film = {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}}
    glow = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "prb_projective", "max_depth": 4},
            "sensor": {"type": "perspective", "fov": 40, "to_world": look, "film": film},
            "mirror": {"type": "rectangle", "to_world": wall, "bsdf": mirror},
            "ball": {
                "type": "sphere",
                "to_world": mi.ScalarTransform4f().translate([0.2, 0, 3]),
                "emitter": glow,
            },
        }
    )
    parameters = mi.traverse(scene)

    def picture(radius: float):
        parameters["ball.to_world"] = mi.AffineTransform4f().translate([0.2, 0, 3]).scale(radius)
        parameters.update()
        return mi.render(scene, parameters, spp=spp)

    radius = mi.Float(1)
    dr.enable_grad(radius)
    dr.backward(dr.sum(picture(radius), axis=None))
    upper, lower = (picture(1 + change).numpy().sum(dtype=float) for change in (0.02, -0.02))
    return float(dr.grad(radius)[0]), float(upper - lower) / 0.04


if __name__ == "__main__":
    try:
        by_mitsuba, by_differences = mirrored()
        derivatives = (
            f"d sum = {by_mitsuba:.0f} by `prb_projective`, "
            f"{by_differences:.0f} by differences of its images"
        )
        found = {**flags(), "radius of a ball seen in an ideal mirror only": derivatives}
        print(json.dumps(found))
    except ImportError as error:
        print(json.dumps({"missing": str(error)}))
