"""What messages of a page do to a scene, without a server and without a browser."""

import io

import numpy as np
import pytest
from PIL import Image
from view_scene import TEXT

import whitted as wt
from whitted.core import frozen
from whitted.view.session import Session

BALL = "spheres.ball.center"
# Where the ball and the lamp are seen, in parts of the picture
AT_BALL, AT_LAMP = (0.638, 0.5), (0.5, 0.0976)


@pytest.fixture
def session(tmp_path):
    return Session(wt.parse_scene(TEXT), tmp_path, "scene.toml")


def say(session, kind, **more):
    return session.handle({"kind": kind, **more})


def refusal(session, kind, **more):
    """The line of a message that is refused, and nothing else."""
    before = session.state.scene
    (reply,) = say(session, kind, **more)
    assert reply["kind"] == "refused"
    assert session.state.scene is before
    assert "\n" not in reply["text"]
    return reply["text"]


def grab(session, x, y, what="shape", **more):
    return say(session, "grab", x=x, y=y, what=what, **more)


def values(session):
    return session.frame()[0]["values"]


def pixels(data):
    return np.asarray(Image.open(io.BytesIO(data)))


def look_of(session, **changes):
    return session.state.look.model_copy(update=changes).model_dump()


def test_opening_tells_all_things_and_parameters(session):
    (scene,) = say(session, "open")
    assert [group["name"] for group in scene["groups"]] == [
        *("scene", "camera", "spheres.ball", "discs.mirror", "planes.floor"),
        *("materials.red", "materials.grey", "materials.mirror", "lights.lamp", "lights.sun"),
    ]
    told = {each["name"]: each for group in scene["groups"] for each in group["parameters"]}
    assert set(told) == set(session.state.scene.parameters())
    assert told[BALL]["value"] == pytest.approx([0.6, 0, 0.5])
    for each in told.values():
        assert each["low"] < each["high"]
        assert all(each["low"] <= x <= each["high"] for x in each["value"])
        # Both ends are legal
        for end in (each["low"], each["high"]):
            value = [end, *each["value"][1:]] if len(each["value"]) == 3 else end
            session.state.scene.replace({each["name"]: value})


def test_first_frame_is_the_scene(session):
    header, shown = session.frame()
    assert header["values"] == {}
    assert (header["undo"], header["redo"], header["picked"]) == (False, False, None)
    expected = wt.to_srgb(wt.render(session.state.scene, boundary=False))
    # As good as JPEG is
    assert abs(pixels(shown["picture"]).astype(int) - expected).mean() < 4


def test_numbers_move_and_are_undone(session):
    assert say(session, "set", name=BALL, value=[0.5, 0.1, 0.5]) == []
    assert say(session, "set", name="materials.mirror.reflection", value=[0.5]) == []
    assert values(session) == {
        BALL: pytest.approx([0.5, 0.1, 0.5]),
        "materials.mirror.reflection": pytest.approx([0.5]),
    }
    say(session, "keep")
    header, _ = session.frame()
    assert header["undo"]
    say(session, "undo")
    assert values(session) == {}
    say(session, "redo")
    assert values(session)[BALL] == pytest.approx([0.5, 0.1, 0.5])
    say(session, "reset")
    assert values(session) == {}
    say(session, "undo")
    assert BALL in values(session)


def test_a_new_step_forgets_what_was_undone(session):
    for x in (0.1, 0.2):
        say(session, "set", name=BALL, value=[x, 0, 0])
        say(session, "keep")
    say(session, "undo")
    say(session, "set", name=BALL, value=[0.3, 0, 0])
    say(session, "keep")
    assert not session.frame()[0]["redo"]
    # To keep what has not changed is no step
    say(session, "keep")
    say(session, "undo")
    assert values(session)[BALL][0] == pytest.approx(0.1)


def test_dragging_follows_the_mouse(session):
    """The point that was taken is seen under the mouse again, as deep as it was."""
    grab(session, *AT_BALL)
    assert session.state.picked == "spheres.ball"
    say(session, "drag", x=0.4, y=0.3, how="across")
    x, y, z = values(session)[BALL]
    depth = wt.pick(wt.parse_scene(TEXT), AT_BALL[0] * 48, AT_BALL[1] * 32).point[2]
    height = 2 * np.tan(np.radians(22.5)) * (4 - depth)
    assert x - 0.6 == pytest.approx((0.4 - AT_BALL[0]) * 1.5 * height, rel=1e-4)
    assert y == pytest.approx(0.2 * height, rel=1e-4)
    assert z == pytest.approx(0.5)


def test_dragging_along_the_view_and_then_across(session):
    grab(session, *AT_BALL)
    say(session, "drag", x=AT_BALL[0], y=0.4, how="along")
    x, y, z = values(session)[BALL]
    assert (x, y) == pytest.approx((0.6, 0))
    assert z < 0.5
    # From here on across: nothing jumps
    say(session, "drag", x=AT_BALL[0], y=0.4, how="across")
    assert values(session)[BALL] == pytest.approx([x, y, z], abs=1e-6)


def test_floor_moves_along_its_normal(session):
    grab(session, 0.5, 0.95)
    assert session.state.picked == "planes.floor"
    say(session, "drag", x=0.9, y=0.9, how="across")
    assert list(values(session)) == ["planes.floor.offset"]
    assert values(session)["planes.floor.offset"][0] < 1


def test_lamp_moves(session):
    (lamp,) = session.frame()[0]["lights"]
    assert lamp["name"] == "lights.lamp"
    assert (lamp["x"], lamp["y"]) == pytest.approx(AT_LAMP, abs=1e-3)
    grab(session, *AT_LAMP, what="light", name="lights.lamp")
    say(session, "drag", x=0.3, y=0.2, how="across")
    (moved,) = session.frame()[0]["lights"]
    assert (moved["x"], moved["y"]) == pytest.approx((0.3, 0.2), abs=2e-3)
    assert session.state.picked == "lights.lamp"


def test_camera_turns_pans_and_comes_nearer(session):
    grab(session, 0.5, 0.5, what="camera")
    say(session, "drag", x=0.6, y=0.4, how="turn")
    eye = np.array(values(session)["camera.position"])
    assert np.linalg.norm(eye) == pytest.approx(4, rel=1e-5)
    assert eye[0] < -0.1
    # The mouse went up: the eye goes down
    assert eye[1] < -0.1
    say(session, "undo")
    grab(session, 0.5, 0.5, what="camera")
    say(session, "drag", x=0.6, y=0.5, how="pan")
    now = values(session)
    assert now["camera.position"][0] == pytest.approx(now["camera.look_at"][0])
    assert now["camera.look_at"][0] < 0
    say(session, "undo")
    say(session, "wheel", steps=2.0, camera=True)
    assert values(session)["camera.position"][2] == pytest.approx(4 * 0.93**2)


def test_camera_does_not_turn_over(session):
    grab(session, 0.5, 0.5, what="camera")
    say(session, "drag", x=0.5, y=9.0, how="turn")
    assert values(session)["camera.position"][1] < 4
    assert np.isfinite(pixels(session.frame()[1]["picture"])).all()


def test_wheel_changes_the_radius_of_what_is_picked(session):
    grab(session, *AT_BALL)
    say(session, "wheel", steps=2.0)
    assert values(session) == {"spheres.ball.radius": [pytest.approx(0.4 * 1.05**2)]}


def test_background_grabs_the_camera(session):
    grab(session, 0.5, 0.02)
    assert session.state.picked is None
    say(session, "drag", x=0.6, y=0.02, how="across")
    assert list(values(session)) == ["camera.position"]


def test_picking_in_a_mirror(session):
    n = np.array([0.35, 0, 1]) / np.hypot(0.35, 1)
    image = np.array([0.6, 0, 0.5]) - 2 * (np.array([1.2, 0, 1]) @ n) * n
    half = (4 - image[2]) * np.tan(np.radians(22.5))
    place = 0.5 + image[0] / half / 3, 0.5
    grab(session, *place)
    assert session.state.picked == "discs.mirror"
    grab(session, *place, through=True)
    assert session.state.picked == "spheres.ball"


def test_outline_is_drawn_around_what_is_picked(session):
    plain = pixels(session.frame()[1]["picture"]).astype(int)
    say(session, "select", name="spheres.ball")
    header, shown = session.frame()
    assert header["picked"] == "spheres.ball"
    changed = abs(pixels(shown["picture"]) - plain).max(2) > 60
    rows, columns = np.nonzero(changed)
    assert 20 < changed.sum() < 200
    # Around its centre
    assert (columns.mean() + 0.5) / 48 == pytest.approx(AT_BALL[0], abs=0.03)
    assert (rows.mean() + 0.5) / 32 == pytest.approx(AT_BALL[1], abs=0.05)
    session.handle(look_of(session, outline=False))
    assert abs(pixels(session.frame()[1]["picture"]) - plain).max() < 30


def test_labels_are_drawn_at_edges(session):
    plain = pixels(session.frame()[1]["picture"]).astype(int)
    session.handle(look_of(session, labels=True))
    changed = abs(pixels(session.frame()[1]["picture"]) - plain).max(2) > 60
    assert 30 < changed.sum() < 700


def test_first_drag_compiles_nothing(session):
    """After `warm` no frozen function is recorded anew."""
    session.warm()
    made = frozen._store.made
    session.frame()
    grab(session, *AT_BALL)
    for k in range(3):
        say(session, "drag", x=0.5, y=0.4 + k / 10, how="across")
        session.frame()
    assert frozen._store.made == made


def test_a_picture_at_rest_is_better(session):
    """It has the samples and the edges that are asked for."""
    first, _ = session.frame()
    assert first["moving"]
    say(session, "rest")
    header, shown = session.frame()
    assert not header["moving"]
    scene = session.state.scene
    best, plain = wt.to_srgb(wt.render(scene, 4)), wt.to_srgb(wt.render(scene, boundary=False))
    got = pixels(shown["picture"]).astype(float)
    assert abs(got - best).mean() < abs(got - plain).mean()
    say(session, "rest")
    assert not session.state.stale


def test_size_depth_and_samples_of_the_picture(session):
    session.handle(look_of(session, size=[20, 10], depth=1, spp=9))
    header, shown = session.frame()
    assert pixels(shown["picture"]).shape == (10, 20, 3)
    assert header["look"]["spp"] == 9
    assert session.state.wanted().options["max_depth"] == 1


def test_a_weight_of_0_is_compiled_before_it_moves(session):
    name = "materials.red.reflection"
    structure = session.state.scene.structure
    say(session, "prepare", name=name)
    prepared = session.state.scene.structure
    assert prepared != structure
    for weight in (0.1, 0.2, 0.0):
        say(session, "set", name=name, value=[weight])
        assert session.state.scene.structure == prepared
    # What is compiled already stays as it is
    before = session.state.scene
    say(session, "prepare", name=BALL)
    assert session.state.scene is before


def test_scene_is_saved_with_its_comments(session, tmp_path):
    say(session, "set", name=BALL, value=[0.25, 0, 0.5])
    assert say(session, "save", name="new.toml")[0]["text"] == "saved new.toml"
    text = (tmp_path / "new.toml").read_text()
    assert (
        text
        == TEXT.replace("center = [0.6, 0, 0.5]", "center = [0.25, 0, 0.5]").replace(
            "0.25, 0, ", "0.25, 0.0, "
        )
        or "# before the mirror" in text
    )
    assert wt.load_scene(tmp_path / "new.toml") == session.state.scene


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_picture_is_saved(session, tmp_path, name):
    assert say(session, "save", name=name)[0]["kind"] == "saved"
    expected = wt.render(session.state.scene, 4).numpy()
    got = wt.read_image(tmp_path / name).numpy()
    np.testing.assert_allclose(
        wt.to_srgb(got).astype(int), wt.to_srgb(expected), atol=1 if name == "a.png" else 0
    )


def test_a_file_is_replaced_only_if_that_is_asked_for(session, tmp_path):
    (tmp_path / "a.toml").write_text("old")
    (reply,) = say(session, "save", name="a.toml")
    assert reply["kind"] == "there"
    assert reply["text"] == "save: 'a.toml' is there already; save again to replace it"
    assert (tmp_path / "a.toml").read_text() == "old"
    assert say(session, "save", name="a.toml", replace=True)[0]["kind"] == "saved"
    assert wt.load_scene(tmp_path / "a.toml") == session.state.scene


@pytest.mark.parametrize(
    "name",
    [
        "../a.toml",
        "/nowhere/a.toml",
        "a/b.toml",
        ".a.toml",
        "a\0.toml",
        "..",
        "",
        "a\n.toml",
        "a.toml ",
    ],
)
def test_names_lead_nowhere_else(session, tmp_path, name):
    assert "is not a plain name; use letters, digits" in refusal(session, "save", name=name)
    assert list(tmp_path.iterdir()) == []


def test_other_refusals_of_save(session, tmp_path):
    assert "should end in .toml (the scene), .png or .exr" in refusal(session, "save", name="a.py")
    (tmp_path / "b.toml").symlink_to(tmp_path / "elsewhere.toml")
    expected = "save: 'b.toml' is a link or a folder; choose another name"
    assert refusal(session, "save", name="b.toml", replace=True) == expected
    session.state.folder = tmp_path / "gone"
    expected = "save: 'c.toml' cannot be written: No such file or directory"
    assert refusal(session, "save", name="c.toml") == expected


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (None, "message: expected a kind, one of open, set, prepare, "),
        ({"kind": "run"}, "message: expected a kind, one of "),
        ({"kind": ["set"]}, "message: expected a kind, one of "),
        ({"kind": "set", "name": BALL}, "set.value: field required, got "),
        ({"kind": "set", "name": BALL, "value": [1, 2, "3"]}, "set.value.2: input should be a"),
        ({"kind": "set", "name": BALL, "value": [1, 2, float("inf")]}, "set.value.2: input should"),
        ({"kind": "set", "name": BALL, "value": [1, 2]}, f"{BALL}: expected one vector of three"),
        ({"kind": "set", "name": "spheres.ball.radius", "value": [-1]}, "expected a number > 0"),
        ({"kind": "set", "name": "x", "value": [1]}, "no parameter 'x'; nearest: "),
        ({"kind": "prepare", "name": "x"}, "no parameter 'x'; nearest: "),
        ({"kind": "keep", "more": 1}, "keep.more: extra inputs are not permitted, got 1"),
        ({"kind": "drag", "x": 0, "y": 0, "how": "across"}, "drag: nothing is held; press the"),
        ({"kind": "grab", "x": 2, "y": 0, "what": "shape"}, "grab.x: input should be less than"),
        (
            {"kind": "grab", "x": 0, "y": 0, "what": "light", "name": "lights.sun"},
            "grab: the scene has no light 'lights.sun' that is at a point",
        ),
        ({"kind": "select", "name": "x"}, "select: the scene has nothing called 'x'"),
        ({"kind": "differentiate", "name": "x"}, "differentiate: the scene has no parameter 'x'"),
        ({"kind": "differentiate", "name": BALL}, f".component: '{BALL}' needs one of x, y, z"),
        (
            {"kind": "differentiate", "name": "camera.fov", "component": "x"},
            "differentiate.component: 'camera.fov' needs none",
        ),
        ({"kind": "stop"}, "stop: no fit is running"),
        ({"kind": "fit", "wrt": [BALL]}, "fit: there is no target; drop a picture here, or take"),
    ],
)
def test_bad_messages_are_refused_in_one_line(session, message, text):
    before = session.state.scene
    (reply,) = session.handle(message)
    assert reply["kind"] == "refused"
    assert text in reply["text"]
    assert "\n" not in reply["text"]
    assert session.state.scene is before


def test_bad_looks_are_refused(session):
    for changes, text in (
        ({"spp": 5}, "look.spp: expected a perfect square (1, 4, 9, ...), got 5"),
        ({"size": [4096, 4096]}, "size: 4096 x 4096 has more than 4194304 pixels; choose a sma"),
        ({"depth": 0}, "look.depth: input should be greater than or equal to 1, got 0"),
    ):
        (reply,) = session.handle(look_of(session, **changes))
        assert text in reply["text"]


def test_a_scene_whose_picture_is_too_large_is_refused():
    scene = wt.parse_scene(TEXT).replace({"camera.resolution": (4000, 4000)})
    with pytest.raises(ValueError, match="4000 x 4000 has more than 4194304 pixels"):
        Session(scene)
