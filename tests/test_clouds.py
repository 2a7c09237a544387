"""Clouds: many spheres of one material, found by a tree.

What a tree finds is held against single spheres, which are code of their own, and against an
exhaustive search in NumPy. Both have closed forms, or tests of their own.
"""

import pickle

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from drjit.opt import Adam

import whitted as wt
from whitted import SceneError
from whitted.core.ray import NONE, Ray
from whitted.scene.many import MOST_ALONE
from whitted.shapes import hierarchy
from whitted.shapes.many import FIRST
from whitted.tracing.intersect import closest_hit

LIGHT = wt.PointLight("key", position=(2, 4, 3), intensity=(0.9, 0.9, 0.9))
SUN = wt.DirectionalLight("sun", direction=(-1, -2, -0.5), irradiance=(0.4, 0.4, 0.4))
MATTE = wt.Material("matte", color=(0.7, 0.4, 0.2), specular=0.2)
MATERIALS = [
    wt.Material("glass", reflection=1, refraction=1, ior=1.5, fresnel=True),
    wt.Material("mirror", color=(0.2, 0.2, 0.2), reflection=0.7),
    wt.Material("veil", color=(0.3, 0.5, 0.3), refraction=0.6, ior=1, shadow=0.4),
    MATTE,
]
BOARD = wt.Material(
    "board", color=(0.6, 0.6, 0.6), checker=wt.Checkerboard(color=(0.1, 0.1, 0.1), size=0.5)
)
FLOOR = wt.Plane("floor", normal=(0, 1, 0), offset=1.2, material=BOARD)


def camera(position=(0, 1.2, 4.5), size=(24, 24)):
    return wt.Camera(position=position, look_at=(0, 0, 0), fov=40, resolution=size)


def matte_cloud(rows, /, **more):
    """A cloud of matte spheres in front of a checkerboard."""
    cloud = wt.Cloud("beads", spheres=rows, material=MATTE)
    setting = {"camera": camera(), "planes": [FLOOR], "lights": [LIGHT], "ambient": (0.1,) * 3}
    return wt.Scene(**{**setting, "clouds": [cloud], **more})


def beads(count, seed=0, largest=0.15):
    """Spheres with random places and sizes: (count, 4)."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-1, 1, (count, 3)), rng.uniform(0.05, largest, count)])


def both_ways(precision, of, lights):
    """A scene as single spheres, and as clouds.

    Args:
        of: the materials of up to ten spheres.
    """
    rng = np.random.default_rng(2)
    spheres = np.column_stack([rng.uniform(-1, 1, (10, 3)), 10 ** rng.uniform(-1.3, -0.1, 10)])
    spheres[2, :3] = spheres[1, :3]  # around one center
    spheres[3, 3] = spheres[0, 3]  # of equal size
    spheres = spheres[: len(of)]
    common = {
        "camera": camera(),
        "planes": [FLOOR],
        "lights": lights,
        "materials": MATERIALS,
        "background": (0.3, 0.4, 0.6),
        "max_depth": 4,
        "precision": precision,
    }
    single = [
        wt.Sphere(center=row[:3], radius=row[3], material=MATERIALS[own].name)
        for row, own in zip(spheres, of, strict=True)
    ]
    clouds = [
        wt.Cloud(own.name, spheres=spheres[of == k], material=own.name)
        for k, own in enumerate(MATERIALS)
    ]
    return wt.Scene(spheres=single, **common), wt.Scene(clouds=clouds, **common)


# What a scene is, and what it looks like


@pytest.mark.parametrize("precision", ["single", "double"])
def test_picture_is_that_of_single_spheres_to_the_last_bit(precision):
    # Glass in glass, mirrors and veils
    single, cloud = both_ways(precision, np.array([0, 0, 0, 0, 1, 1, 1, 2, 2, 3]), [LIGHT, SUN])
    images = [wt.render(scene, boundary=False).numpy() for scene in (single, cloud)]
    np.testing.assert_array_equal(*images)
    assert images[0].std() > 0.1


def test_edges_and_derivatives_are_those_of_single_spheres():
    of = np.array([1, 1, 3, 3])
    single, cloud = both_ways("double", of, [LIGHT])
    np.testing.assert_allclose(*(wt.render(scene).numpy() for scene in (single, cloud)), atol=1e-12)
    way = np.random.default_rng(3).standard_normal((4, 3))
    ours = single.parameters("spheres.*.center")
    dr.enable_grad(ours)
    for value, row in zip(ours.values(), way, strict=True):
        dr.set_grad(value, ad.Array3f64(*row.tolist()))
    expected = dr.forward_to(wt.render(single.replace(ours))).numpy()

    theirs = cloud.parameters("clouds.*.center")
    dr.enable_grad(theirs)
    for k, value in enumerate(theirs.values()):
        dr.set_grad(value, ad.Array3f64(np.ascontiguousarray(way[of == k].T)))
    slope = dr.forward_to(wt.render(cloud.replace(theirs))).numpy()
    np.testing.assert_allclose(slope, expected, atol=1e-9 * np.abs(expected).max())

    # <w, J v> = <J' w, v>
    theirs = cloud.parameters("clouds.*.center")
    dr.enable_grad(theirs)
    weights = np.random.default_rng(4).random(slope.shape)
    dr.backward(dr.sum(wt.render(cloud.replace(theirs)) * ad.TensorXf64(weights), axis=None))
    back = sum(
        (value.grad.numpy().T * way[of == k]).sum() for k, value in enumerate(theirs.values())
    )
    assert back == pytest.approx((weights * slope).sum(), rel=1e-9)


def test_many_single_spheres_go_through_the_tree():
    spheres = beads(MOST_ALONE + 8)
    single = [wt.Sphere(center=row[:3], radius=row[3], material=MATTE) for row in spheres]
    alone = matte_cloud([], clouds=[], spheres=single)
    cloud = matte_cloud(spheres)
    assert not any(shape.group == "spheres" for shape in alone.singles)
    np.testing.assert_array_equal(wt.render(alone).numpy(), wt.render(cloud).numpy())

    moving = alone.parameters("spheres.sphere3.*")
    dr.enable_grad(moving)
    dr.backward(dr.mean(wt.render(alone.replace(moving)), axis=None))
    whole = cloud.parameters("clouds.beads.*")
    dr.enable_grad(whole)
    dr.backward(dr.mean(wt.render(cloud.replace(whole)), axis=None))
    center, radius = whole["clouds.beads.center"].grad, whole["clouds.beads.radius"].grad
    assert np.abs(center.numpy()[:, 3]).max() > 0
    np.testing.assert_allclose(
        moving["spheres.sphere3.center"].grad.numpy()[:, 0], center.numpy()[:, 3], rtol=1e-4
    )
    assert moving["spheres.sphere3.radius"].grad[0] == pytest.approx(radius[3], rel=1e-4)


@pytest.mark.parametrize(
    "spheres",
    [
        beads(1),
        [[0, 0, 0, 0.1 * k] for k in range(1, 9)],
        [[0, 0, 0, 0.5]] * 7,
        [[0.2 * k, 0, 0, 10.0**k] for k in range(-4, 5)],
    ],
    ids=["one", "around one center", "equal", "of all sizes"],
)
def test_odd_clouds_are_like_single_spheres(spheres):
    rows = np.array(spheres)
    single = [wt.Sphere(center=row[:3], radius=row[3], material=MATTE) for row in rows]
    eye = {"camera": camera((0.3, 0.4, 2.5))}
    alone, cloud = matte_cloud([], clouds=[], spheres=single, **eye), matte_cloud(rows, **eye)
    np.testing.assert_array_equal(
        *(wt.render(scene, boundary=False).numpy() for scene in (alone, cloud))
    )


def test_empty_cloud_is_no_cloud():
    empty = matte_cloud([])
    assert not empty.sources
    np.testing.assert_array_equal(
        wt.render(empty).numpy(), wt.render(matte_cloud([], clouds=[])).numpy()
    )
    assert dr.width(empty.parameters("clouds.beads.center")["clouds.beads.center"]) == 0


def test_eye_and_light_exactly_on_a_sphere_are_outside_of_it():
    rows = np.array([[0, 0, 0, 1], [0, 3, 0, 1], [3, 0, 0, 0.5]], float)
    eye = camera((0, 0, 1))
    lights = [wt.PointLight("on", position=(0, 2, 0), intensity=(1, 1, 1))]
    single = [wt.Sphere(center=row[:3], radius=row[3], material=MATTE) for row in rows]
    view = {"camera": eye, "lights": lights}
    alone, cloud = matte_cloud([], clouds=[], spheres=single, **view), matte_cloud(rows, **view)
    assert cloud.features.places.many.under_eye
    assert cloud.features.places.many.under_lights == (0,)
    away = {"camera.look_at": (0, 0.5, 3)}
    for scenes in ((alone, cloud), (alone.replace(away), cloud.replace(away))):
        np.testing.assert_array_equal(
            *(wt.render(scene, boundary=False).numpy() for scene in scenes)
        )


def test_of_coinciding_spheres_the_first_is_seen():
    red = wt.Material("red", color=(1, 0, 0))
    row = [[0, 0, 0, 0.5]]
    first = wt.Sphere("first", center=(0, 0, 0), radius=0.5, material=red)
    over = matte_cloud([*row, *beads(4).tolist()], spheres=[first])
    assert 0 not in over.tree.hierarchy.members
    two = matte_cloud(
        row, clouds=[wt.Cloud(spheres=row, material=red), wt.Cloud(spheres=row, material=MATTE)]
    )
    image = wt.render(two, boundary=False).numpy()
    assert image[12, 12, 0] > 0
    assert image[12, 12, 1] == 0


# The tree


def exhaustive(spheres, o, d):
    """The distance to the nearest sphere along each ray, in double precision."""
    nearest = np.full(len(o), np.inf)
    for row in spheres:
        to = row[:3] - o
        b = (to * d).sum(1)
        inside = row[3] ** 2 - ((to - b[:, None] * d) ** 2).sum(1)
        half = np.sqrt(np.maximum(inside, 0))
        t = np.where(b - half > 0, b - half, b + half)
        nearest = np.where((inside > 0) & (t > 0) & (t < nearest), t, nearest)
    return nearest


def hits(scene, o, d):
    """The distances and the numbers of the nearest spheres along rays."""
    kernel = scene.structure.filled(scene.inputs())
    width, uint = len(o), ad.UInt32
    vector = scene.precision.vector
    o, d = (vector(np.ascontiguousarray(x.T.astype(scene.precision.dtype))) for x in (o, d))
    ray = Ray(o, d, dr.full(uint, NONE, width), dr.full(ad.Bool, False, width))
    found = closest_hit(kernel, ray)
    return found.t.numpy(), found.index.numpy()


def test_no_ray_misses_a_sphere():
    spheres = beads(3000, largest=0.06)
    scene = matte_cloud(spheres, planes=[], precision="double")
    rng = np.random.default_rng(1)
    o, d = rng.uniform(-1.5, 1.5, (4000, 3)), rng.standard_normal((4000, 3))
    # Along the axes as well, where a ray may run within a side of a box
    d[:600] = np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 100, 0)
    o[:300] = spheres[:300, :3] - 2 * d[:300] + spheres[:300, 3:] * np.array([0.6, 0.6, 0.6])
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    t, index = hits(scene, o, d)
    expected = exhaustive(spheres, o, d)
    assert 0.3 < np.isfinite(expected).mean() < 1
    # Roundings of a distance of about 1
    np.testing.assert_allclose(t, expected, atol=1e-12)
    assert ((index == NONE) == np.isinf(expected)).all()


@pytest.mark.parametrize("step", [1e-3, 1.0], ids=["a little", "far"])
def test_moved_spheres_are_found_like_those_of_a_new_scene(step):
    spheres = beads(200)
    way = np.random.default_rng(5).standard_normal((200, 3))
    moved = spheres + step * np.column_stack([way, np.zeros(200)])
    before, new = matte_cloud(spheres), matte_cloud(moved)
    _ = before.tree
    after = before.replace({"clouds.beads.center": moved[:, :3]})
    np.testing.assert_array_equal(wt.render(after).numpy(), wt.render(new).numpy())
    # Arranged as before, or anew: as good as a tree that was built there
    same = np.array_equal(after.tree.hierarchy.children, before.tree.hierarchy.children)
    assert same == (step < 0.1)
    if not same:
        np.testing.assert_array_equal(after.tree.hierarchy.records, new.tree.hierarchy.records)


def test_tree_is_never_deeper_than_its_stack():
    concentric = np.column_stack([np.zeros((5000, 3)), np.arange(1, 5001)])
    line = np.column_stack([2.0 ** np.arange(59), np.zeros((59, 2)), 2.0 ** np.arange(-1, 58)])
    for spheres in (concentric, line, beads(5000), beads(2)):
        rows = spheres.astype(np.float32)
        tree = hierarchy.build(rows, np.arange(len(rows)))
        assert len(tree.rounds) <= hierarchy.DEPTH
        place, leaves, links = 0, [], tree.links.tolist()
        while place != hierarchy.END:
            link, after = links[place]
            if link & hierarchy.LEAF:
                leaves.append(link ^ hierarchy.LEAF)
            place = after if link & hierarchy.LEAF else link
        assert sorted(leaves) == list(range(len(rows)))


def test_another_number_of_spheres_compiles_nothing():
    wt.render(matte_cloud(beads(60)))
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        for count in (61, 500, 1):
            wt.render(matte_cloud(beads(count), planes=[FLOOR]))
        kernels = [kernel for kernel in dr.kernel_history() if "cache_hit" in kernel]
    traced = [kernel for kernel in kernels if kernel["operation_count"] > 300]
    assert traced
    assert all(kernel["cache_hit"] for kernel in traced)


def test_bands_make_no_difference(monkeypatch):
    scene = matte_cloud(beads(100))
    whole = wt.render(scene, spp=4).numpy()
    from whitted.rendering import job

    monkeypatch.setattr(job, "BAND", 24 * 8 * 4)
    np.testing.assert_array_equal(wt.render(scene, spp=4).numpy(), whole)


# Derivatives


def test_gradients_at_edges_agree_with_differences():
    spheres = beads(60, seed=3, largest=0.25)
    scene = matte_cloud(spheres, precision="double", camera=camera(size=(48, 48)))
    way = np.random.default_rng(6).standard_normal((60, 3)) * spheres[:, 3:]
    step = 0.02

    def picture(part):
        moved = {"clouds.beads.center": spheres[:, :3] + part * step * way}
        return wt.render(scene.replace(moved), spp=400, boundary=False).numpy()

    expected = (picture(1) - picture(-1)) / (2 * step)
    values = scene.parameters("clouds.beads.center")
    dr.enable_grad(values)
    dr.set_grad(values["clouds.beads.center"], ad.Array3f64(np.ascontiguousarray(way.T)))
    slope = dr.forward_to(wt.render(scene.replace(values), spp=16)).numpy()
    error = np.abs(slope - expected).sum() / np.abs(expected).sum()
    # Of this, the differences themselves err by about 4 %: with 900 samples 0.07 becomes 0.05
    assert error < 0.1


@pytest.mark.parametrize("boundary", [False, True])
def test_spheres_and_other_numbers_have_gradients_together(boundary):
    """The derivatives that reverse mode adds up are those of forward mode, in every order."""
    scene = matte_cloud(beads(5), precision="double")
    names = ["camera.fov", "clouds.beads.center", "materials.matte.color"]
    for order in (names, names[::-1]):
        forward, reverse = (scene.parameters(*order) for _ in range(2))
        dr.enable_grad(forward, reverse)
        for value in forward.values():
            dr.set_grad(value, 1)
        slope = dr.forward_to(wt.render(scene.replace(forward), boundary=boundary)).numpy()
        dr.backward(dr.sum(wt.render(scene.replace(reverse), boundary=boundary), axis=None))
        sums = {name: dr.grad(value).numpy().sum() for name, value in reverse.items()}
        assert all(total != 0 for total in sums.values())
        # Both are sums of the same terms, in another order
        np.testing.assert_allclose(sum(sums.values()), slope.sum(), rtol=1e-9)


def test_optimiser_moves_a_cloud():
    target = wt.render(matte_cloud(beads(40)))
    scene = matte_cloud(beads(40) + [0.02, -0.01, 0.01, 0])
    opt = Adam(lr=0.004, params=scene.parameters("clouds.beads.center"))
    losses = []
    for _ in range(12):
        image = wt.render(scene.replace(opt))
        loss = dr.mean(dr.square(image - target), axis=None)
        dr.backward(loss)
        opt.step()
        losses.append(loss.array[0])
    assert losses[-1] < losses[0] / 3


def test_torch_takes_a_cloud():
    torch = pytest.importorskip("torch")
    scene = matte_cloud(beads(5))
    center = torch.tensor(beads(5)[:, :3], dtype=torch.float32, requires_grad=True)
    wt.torch_render(scene, {"clouds.beads.center": center}).mean().backward()
    values = scene.parameters("clouds.beads.center")
    dr.enable_grad(values)
    dr.backward(dr.mean(wt.render(scene.replace(values)), axis=None))
    ours = values["clouds.beads.center"].grad.numpy().T
    np.testing.assert_allclose(center.grad.numpy(), ours, rtol=1e-4, atol=1e-7)


def test_gradient_by_one_number_of_a_cloud():
    scene = matte_cloud(beads(5))
    by_x = wt.gradient(scene, "clouds.beads.center", "2.x").numpy()
    values = scene.parameters("clouds.beads.center")
    dr.enable_grad(values)
    dr.set_grad(values["clouds.beads.center"], ad.Array3f([0, 0, 1, 0, 0], 0, 0))
    np.testing.assert_array_equal(by_x, dr.forward_to(wt.render(scene.replace(values))).numpy())
    assert np.abs(wt.gradient(scene, "clouds.beads.radius", "4").numpy()).max() > 0


@pytest.mark.parametrize("component", [None, "x", "5.x", "1", "-1.x", "1.y.z"])
def test_component_of_a_cloud_that_is_none(component):
    message = r"component: expected a sphere of the cloud 'clouds.beads.center', '0.x' to '4.z'"
    with pytest.raises(ValueError, match=message):
        wt.gradient(matte_cloud(beads(5)), "clouds.beads.center", component)


# Scenes in Python and in files


def test_cloud_is_described_by_arrays_of_any_kind():
    rows = beads(6)
    for center, radius in (
        (rows[:, :3], rows[:, 3]),
        (rows[:, :3].tolist(), rows[:, 3].tolist()),
        (ad.Array3f64(np.ascontiguousarray(rows[:, :3].T)), ad.Float64(rows[:, 3])),
        (ad.TensorXf64(rows[:, :3]), ad.TensorXf64(rows[:, 3])),
    ):
        cloud = wt.Cloud("beads", center=center, radius=radius, material=MATTE)
        assert cloud == wt.Cloud("beads", spheres=rows, material=MATTE)
        assert hash(cloud) == hash(wt.Cloud("beads", spheres=rows, material=MATTE))
    np.testing.assert_array_equal(cloud.center, rows[:, :3])
    np.testing.assert_array_equal(cloud.radius, rows[:, 3])
    assert wt.Cloud(center=[[0, 0, 0], [1, 0, 0]], radius=2, material="m").radius.tolist() == [2, 2]
    assert repr(cloud) == "Cloud('beads', spheres=6 spheres, material='matte')"


def test_scene_with_a_cloud_is_compared_copied_and_changed():
    scene = matte_cloud(beads(70))
    assert scene == matte_cloud(beads(70))
    assert scene != matte_cloud(beads(70, seed=1))
    assert scene != matte_cloud(beads(71))
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert wt.Scene.from_dict(scene.to_dict()) == scene
    assert scene.astype("double").astype("single") == scene
    assert "cloud   beads  matte  70 spheres" in repr(scene)
    fewer = scene.replace({"clouds.beads.spheres": beads(3)})
    assert dr.width(fewer.parameters("clouds.beads.radius")["clouds.beads.radius"]) == 3
    assert not scene.remove("beads").sources
    assert scene.replace({"clouds.beads": wt.Cloud(spheres=beads(2), material=MATTE)}).sources
    larger = scene.replace({"clouds.beads.radius": 2 * beads(70)[:, 3]})
    assert larger.numbers["clouds.beads.radius"][5] == np.float32(2 * beads(70)[5, 3])


def test_cloud_is_saved_beside_the_scene(tmp_path):
    scene = matte_cloud(beads(70))
    scene.save(tmp_path / "a.toml")
    assert 'spheres = "a.beads.npy"' in (tmp_path / "a.toml").read_text()
    again = wt.load_scene(tmp_path / "a.toml")
    assert again == scene
    # Another folder gets a file of its own, and a cloud that has moved is written anew
    (tmp_path / "b").mkdir()
    again.save(tmp_path / "b" / "b.toml")
    assert wt.load_scene(tmp_path / "b" / "b.toml") == scene
    moved = again.replace({"clouds.beads.center": beads(70, seed=1)[:, :3]})
    moved.save(tmp_path / "a.toml")
    assert wt.load_scene(tmp_path / "a.toml") == moved


def test_cloud_stays_in_its_own_file(tmp_path):
    np.savetxt(tmp_path / "beads.csv", beads(70), delimiter=",", header="x,y,z,r", comments="")
    text = matte_cloud(beads(2), clouds=[]).to_dict()
    wt.Scene.from_dict(text).save(tmp_path / "a.toml")
    with (tmp_path / "a.toml").open("a") as file:
        file.write('# Beads\n[[clouds]]\nspheres = "beads.csv"\nmaterial = "matte"\n')
        file.write("[materials.matte]\ncolor = [1, 1, 1]\n")
    scene = wt.load_scene(tmp_path / "a.toml")
    np.testing.assert_array_equal(
        scene.numbers["clouds.cloud0.radius"], beads(70)[:, 3].astype(np.float32)
    )
    scene.replace({"camera.fov": 50}).save(tmp_path / "a.toml")
    assert '# Beads\n[[clouds]]\nspheres = "beads.csv"' in (tmp_path / "a.toml").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.toml", "beads.csv"]


def test_small_cloud_stands_in_the_scene_file(tmp_path):
    matte_cloud(beads(3)).save(tmp_path / "a.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["a.toml"]
    assert wt.load_scene(tmp_path / "a.toml") == matte_cloud(beads(3))


def test_mitsuba_gets_single_spheres():
    sun = wt.DirectionalLight(direction=(0, -1, 0), irradiance=(1, 1, 1))
    scene = matte_cloud(beads(3), planes=[], ambient=(0, 0, 0), lights=[sun], max_depth=1)
    written = scene.replace({"materials.matte.specular": 0}).to_mitsuba()
    assert (
        sum(own.get("type") == "sphere" for own in written.values() if isinstance(own, dict)) == 3
    )


FOUR = "rows of four numbers: a center and a radius > 0"
LEGAL = "finite numbers of at most 1e+18, and a radius > 0"


SHAPE = "center: expected numbers of shape (N, 3), got"
AS_MANY = "radius: expected 1 numbers > 0, or one for all, got"
ONE = [[0, 0, 0]]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"center": [[0, 0]], "radius": 1}, f"{SHAPE} shape (1, 2)"),
        ({"center": "x", "radius": 1}, f"{SHAPE} something else"),
        ({"center": ONE, "radius": [1, 2]}, f"{AS_MANY} shape (2,)"),
        ({"center": ONE}, f"{AS_MANY} something else"),
        ({"center": ONE, "radius": -1}, f"spheres: row 0 is [0, 0, 0, -1]: expected {LEGAL}"),
        (
            {"spheres": [[1, 2, 3, 1], [0, 0, np.nan, 1]]},
            f"spheres: row 1 is [0, 0, nan, 1]: expected {LEGAL}",
        ),
        ({"spheres": [[1, 2, 3]]}, f"spheres: expected N {FOUR}, got an array of shape 1 x 3"),
        ({"spheres": [[1, 2, 3, True]]}, f"spheres: expected {FOUR}"),
        ({"spheres": [[1, 2, 3, 1], [1]]}, f"spheres: expected {FOUR}"),
        ({"spheres": 3}, f"spheres: expected {FOUR}"),
    ],
)
def test_cloud_that_is_none_is_refused(given, message):
    with pytest.raises(SceneError) as error:
        wt.Cloud("beads", material="m", **given)
    assert str(error.value) == f"clouds.beads.{message}"


def test_cloud_takes_spheres_or_their_parts():
    with pytest.raises(SceneError, match=r"^clouds.beads: give spheres, or center and radius"):
        wt.Cloud("beads", spheres=[[0, 0, 0, 1]], radius=1, material="m")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("beads.npy", None, "cannot be read: No such file or directory"),
        ("beads.npy", np.zeros((3, 3)), f"expected N {FOUR}, got an array of shape 3 x 3"),
        ("beads.npy", np.array([[0, 0, 0, np.inf]]), f"row 0 is [0, 0, 0, inf]: expected {LEGAL}"),
        ("beads.npy", np.array([[0, 0, 0, 0]]), f"row 0 is [0, 0, 0, 0]: expected {LEGAL}"),
        ("beads.npy", np.array([["a"] * 4]), f"expected {FOUR}, got an array of <U1"),
        ("beads.npy", b"", f"not a file of {FOUR}: "),
        ("beads.npy", np.array([[{}] * 4]), f"not a file of {FOUR}: "),
        ("beads.csv", b"1,2,3\n", f"expected N {FOUR}, got an array of shape 1 x 3"),
        ("beads.csv", b"1,2,3,x\n", f"not a file of {FOUR}: "),
        ("beads.txt", b"", "expected a file that ends in .npy or .csv, or rows of four numbers"),
    ],
)
def test_file_that_is_no_cloud_is_refused(tmp_path, load, name, content, message):
    if isinstance(content, bytes):
        (tmp_path / name).write_bytes(content)
    elif content is not None:
        np.save(tmp_path / name, content)
    text = (
        "[camera]\nposition = [0, 0, 3]\nlook_at = [0, 0, 0]\nfov = 50\nresolution = [8, 4]\n"
        f'[materials.m]\n[[clouds]]\nspheres = "{name}"\nmaterial = "m"\nsize = 3\n'
    )
    with pytest.raises(SceneError) as error:
        load(text)
    lines = str(error.value).splitlines()
    where = tmp_path / "scene.toml"
    assert lines[0].startswith(f'{where}: clouds[0].spheres = "{name}": {message}')
    # With all other problems of the file
    assert lines[1].startswith(f"{where}: clouds[0].size: unknown key")


def test_spheres_that_do_not_fit_in_memory_are_refused():
    from whitted.scene.rows import check_room

    with pytest.raises(ValueError, match=r"^\d+ spheres take about \d+\.\d GiB, too much for a"):
        check_room(10**10)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (beads(4)[:, :3], r"numbers of shape \(5, 3\), got an array of shape \(4, 3\)"),
        (ad.Array3f(0), r"numbers of shape \(5, 3\), got Array3f of shape \(3, 1\)"),
        (None, r"numbers of shape \(5, 3\), got None; replace 'clouds.beads.spheres' for another"),
        ([[0, 0, np.nan]] * 5, "clouds.beads.center, sphere 0 = 0, 0, nan: expected three finite"),
    ],
)
def test_other_numbers_than_the_cloud_has_are_refused(value, message):
    with pytest.raises(ValueError, match=message):
        matte_cloud(beads(5)).replace({"clouds.beads.center": value})


def test_radius_of_an_optimiser_that_went_too_far_is_refused():
    with pytest.raises(ValueError, match=r"sphere 1 = -1: expected a number > 0; bound the steps"):
        matte_cloud(beads(2)).replace({"clouds.beads.radius": ad.Float(1, -1)})


def test_cloud_is_not_moved_while_a_kernel_is_recorded():
    scene = matte_cloud(beads(3))

    @dr.freeze
    def moved(center):
        return wt.render(scene.replace({"clouds.beads.center": center}), boundary=False)

    message = r"clouds.beads.center: a tree of spheres cannot be built in a frozen function"
    with pytest.raises((ValueError, RuntimeError)) as error:
        moved(scene.parameters("clouds.beads.center")["clouds.beads.center"])
    chain = [error.value, error.value.__cause__]
    assert any(message.replace("\\", "") in str(each) for each in chain)


@pytest.mark.parametrize("method", ["lm", "adam"])
def test_fit_finds_the_spheres_of_a_cloud(method):
    spheres = np.array([[-0.7, 0, 0, 0.3], [0.2, 0.3, 0.2, 0.25], [0.8, -0.2, -0.2, 0.35]])
    truth = matte_cloud(spheres, camera=camera(size=(48, 48)))
    start = truth.replace({"clouds.beads.center": spheres[:, :3] + [[0.06, -0.04, 0.0]]})
    names = ["clouds.beads.center", "clouds.beads.radius"]
    found = wt.fit(start, wt.render(truth, 4), wrt=names, method=method, progress=False)
    assert found.labels[:4] == [f"{names[0]}.{place}" for place in ("0.x", "0.y", "0.z", "1.x")]
    assert found.labels[-1] == "clouds.beads.radius.2"
    assert np.shape(found.parameters["clouds.beads.center"]) == (3, 3)
    # A hundredth of a pixel across the view, which is 0.07 wide; by distance ten times that
    off = np.abs(np.array(found.parameters["clouds.beads.center"]) - spheres[:, :3])
    assert off[:, :2].max() < (0.002 if method == "lm" else 0.02)
    np.testing.assert_allclose(found.parameters["clouds.beads.radius"], spheres[:, 3], atol=0.02)


def test_fit_of_too_many_numbers_is_refused():
    scene = matte_cloud(beads(400))
    with pytest.raises(
        ValueError, match=r"^wrt: expected from 1 to 1000 numbers, got 1200; an opt"
    ):
        wt.fit(scene, wt.render(scene), wrt=["clouds.beads.center"])


def test_numbers_of_spheres_begin_above_all_others():
    scene = matte_cloud(beads(40))
    _, index = hits(scene, np.array([[0.0, 0, 5]] * 2), np.array([[0.0, 0, -1], [0, 0, 1]]))
    assert index[1] == NONE
    assert index[0] >= FIRST or index[0] == 0


def test_pick_tells_the_sphere_of_a_cloud():
    spheres = np.array([[0, 0, 0, 0.5], [5, 0, 0, 0.5]])
    found = wt.pick(matte_cloud(spheres, camera=camera((0, 0, 4))), 12, 12)
    assert (found.name, found.sphere) == ("clouds.beads", 0)
    assert found.point == pytest.approx((0, 0, 0.5), abs=1e-6)
    single = [wt.Sphere(center=(0, 0, -k), radius=0.5, material=MATTE) for k in range(40)]
    many = matte_cloud([], clouds=[], planes=[], spheres=single, camera=camera((0, 0, 4)))
    found = wt.pick(many, 12, 12)
    assert (found.name, found.sphere) == ("spheres.sphere0", None)
    assert many.owner_of(many.number_of("spheres.sphere20")) == ("spheres.sphere20", None)
    assert many.number_of("spheres.nobody") is None
