"""Mitsuba 3 in tests."""

import numpy as np
import pytest
import samples

NEEDED = "needs Mitsuba 3: pip install 'whitted[mitsuba]'"


def picture(written, spp=None, seed=0):
    """Mitsuba's picture: of a ray through each pixel's centre, or of random ones."""
    mitsuba = pytest.importorskip("mitsuba", reason=NEEDED)
    mitsuba.set_variant("scalar_rgb")
    sampler = {"type": "independent", "sample_count": spp}
    if spp is None:
        sampler = {"type": "stratified", "jitter": False, "sample_count": 1}
    sensor = written["sensor"] | {"sampler": sampler}
    # Russian roulette would make noise of its own
    integrator = written["integrator"] | {"rr_depth": 100}
    loaded = mitsuba.load_dict(written | {"sensor": sensor, "integrator": integrator})
    return np.array(mitsuba.render(loaded, seed=seed), np.float64)


def compare(theirs, scene):
    """Compare a picture of Mitsuba's with that of a scene, of a ray through each pixel's centre.

    Mitsuba has seven digits. A point that is seen at a cosine c is off by 1e-7 / c, and no ray of
    these pictures meets a surface at less than 0.001.
    """
    ours = samples.render_plain(scene).numpy()
    assert ours.std() > 0.01
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-4 * ours.max())
