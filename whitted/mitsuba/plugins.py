"""The plugins of Mitsuba 3, by what they are."""

_NAMES = {
    "integrator": "path direct prb prb_basic prb_projective direct_projective prbvolpath volpath "
    "volpathmis ptracer aov depth moment stokes volprim_rf_basic",
    "sensor": "perspective thinlens orthographic radiancemeter irradiancemeter distant batch",
    "film": "hdrfilm specfilm",
    "rfilter": "box gaussian tent mitchell catmullrom lanczos",
    "sampler": "independent stratified multijitter orthogonal ldsampler",
    "shape": "sphere rectangle disk cube cylinder obj ply serialized blender merge instance "
    "shapegroup sdfgrid ellipsoids ellipsoidsmesh bsplinecurve linearcurve",
    "bsdf": "diffuse dielectric conductor twosided roughdielectric roughconductor thindielectric "
    "plastic roughplastic pplastic principled principledthin blendbsdf mask bumpmap normalmap "
    "null hair measured measured_polarized circular polarizer retarder",
    "emitter": "point directional constant area spot envmap projector directionalarea sunsky "
    "timed_sunsky",
    "texture": "checkerboard bitmap mesh_attribute volume",
    "value": "rgb spectrum srgb uniform d65 blackbody regular irregular rawconstant",
    "medium": "homogeneous heterogeneous",
    "phase": "isotropic hg rayleigh sggx blendphase tabphase",
    "volume": "constvolume gridvolume",
}
# The kind of each plugin
KINDS = {name: kind for kind, names in _NAMES.items() for name in names.split()}
# Those that have a counterpart here, exact or approximate, by kind
TAKEN = {
    "integrator": ("path", "direct", "prb", "prb_basic", "prb_projective", "direct_projective"),
    "sensor": ("perspective",),
    "film": ("hdrfilm",),
    "rfilter": tuple(_NAMES["rfilter"].split()),
    "sampler": tuple(_NAMES["sampler"].split()),
    "shape": ("sphere", "rectangle", "disk"),
    "bsdf": (
        *("diffuse", "twosided", "dielectric", "conductor"),
        *("roughdielectric", "roughconductor"),
    ),
    "emitter": ("point", "directional", "constant"),
    "texture": ("checkerboard",),
}

# Mitsuba's names of indices of refraction
INDICES = {
    "vacuum": 1.0,
    "helium": 1.000036,
    "hydrogen": 1.000132,
    "air": 1.000277,
    "carbon dioxide": 1.00045,
    "water": 1.3330,
    "acetone": 1.36,
    "ethanol": 1.361,
    "carbon tetrachloride": 1.461,
    "glycerol": 1.4729,
    "benzene": 1.501,
    "silicone oil": 1.52045,
    "bromine": 1.661,
    "water ice": 1.31,
    "fused quartz": 1.458,
    "pyrex": 1.470,
    "acrylic glass": 1.49,
    "polypropylene": 1.49,
    "bk7": 1.5046,
    "sodium chloride": 1.544,
    "amber": 1.55,
    "pet": 1.5750,
    "diamond": 2.419,
}
