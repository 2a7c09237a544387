"""Large pictures in bands: the pixels of `render`, in memory, in a tiled EXR, in a pyramid."""

import errno
import os
import re

import numpy as np
import OpenEXR
import pytest
from cluster_scene import ball, contents

import whitted as wt
from whitted import cluster
from whitted.cli import run
from whitted.cluster import bands, connect, picture, pyramid
from whitted.files import tiles

zarr = pytest.importorskip("zarr", reason="needs zarr 3: pip install 'whitted[cluster]'")
# Two bands and a part of one; no whole tiles
SIZE = (70, 150)


@pytest.fixture(scope="module")
def client():
    pytest.importorskip("distributed", reason="needs Dask: pip install 'whitted[cluster]'")
    with connect.connected(None, 1) as client:
        yield client


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Bands of 64 rows, and chunks of 32."""
    monkeypatch.setattr(bands, "SAMPLES", 70 * 64)
    monkeypatch.setattr(pyramid, "CHUNK", 32)
    monkeypatch.setattr(picture, "CHUNK", 32)


@pytest.fixture(scope="module")
def whole():
    return wt.render(ball(), 4, resolution=SIZE).numpy()


def test_a_picture_in_memory_is_that_of_render(whole, precision):
    done = []
    scene = ball(precision)
    found = cluster.render(scene, spp=4, resolution=SIZE, progress=done.append)
    np.testing.assert_array_equal(found, wt.render(scene, 4, resolution=SIZE).numpy())
    np.testing.assert_allclose(done, [1 / 3, 2 / 3, 1])


def test_workers_render_the_same_picture(whole, client, tmp_path):
    np.testing.assert_array_equal(cluster.render(ball(), client, spp=4, resolution=SIZE), whole)
    for name in ("a.exr", "a.zarr"):
        cluster.render(ball(), client, spp=4, resolution=SIZE, output=tmp_path / name)
    np.testing.assert_array_equal(wt.read_image(tmp_path / "a.exr").numpy(), whole)
    np.testing.assert_array_equal(zarr.open_group(str(tmp_path / "a.zarr"))["0"][:], whole)


def test_a_tiled_file_is_one_for_other_programs(whole, tmp_path):
    about = {"spp": 4, "scene": "ball", "seconds": 0.5}
    path = tmp_path / "a.exr"
    assert cluster.render(ball(), spp=4, resolution=SIZE, output=path, metadata=about) is None
    with OpenEXR.File(str(path)) as file:
        header = file.header()
        assert header["type"] == OpenEXR.tiledimage
        assert (header["tiles"].xSize, header["tiles"].ySize) == (64, 64)
        assert {name: header[name] for name in about} == about
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, whole)
    assert [one.name for one in tmp_path.iterdir()] == ["a.exr"]


@pytest.mark.parametrize("size", [(1, 1), (64, 64), (65, 63), (130, 128)])
def test_tiles_may_come_in_any_order(tmp_path, size):
    """Noise does not get smaller by compression, and is stored as it is."""
    pixels = np.random.default_rng(0).normal(size=(size[1], size[0], 3)).astype(np.float32)
    pixels[: size[1] // 2] = 0.25
    firsts = list(range(0, size[1], tiles.TILE))
    with (tmp_path / "a.exr").open("wb") as file, tiles.TiledFile(file, size, {}) as tiled:
        for first in reversed(firsts):
            tiled.write(first, pixels[first : first + tiles.TILE])
    np.testing.assert_array_equal(wt.read_image(tmp_path / "a.exr").numpy(), pixels)


def test_a_pyramid_has_all_levels(whole, tmp_path):
    cluster.render(ball(), spp=4, resolution=SIZE, output=tmp_path / "a.zarr")
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="r")
    shapes = [(150, 70, 3), (75, 35, 3), (38, 18, 3), (19, 9, 3)]
    assert group.attrs["levels"] == 4
    assert [group[str(level)].shape for level in range(4)] == shapes
    np.testing.assert_array_equal(group["0"][:], whole)
    half = whole.astype(float).reshape(75, 2, 35, 2, 3).mean((1, 3))
    np.testing.assert_allclose(group["1"][:], half, rtol=2e-7)
    # At an odd end a pixel stands for what is left
    expected = group["1"][74, 0:2].mean(0)
    np.testing.assert_allclose(group["2"][37, 0], expected, rtol=2e-7)


def test_what_killed_workers_have_not_renamed_is_not_in_a_pyramid(tmp_path):
    with pyramid.new_pyramid(tmp_path / "a.zarr", (40, 40), np.dtype("f4"), {}) as store:
        pyramid.write_band(str(store), 0, np.ones((40, 40, 3), "f4"))
        chunk = next(path for path in store.glob("0/c/**/*") if path.is_file())
        chunk.with_suffix(".0a1b2c.partial").write_bytes(b"half")
    assert not list(tmp_path.rglob("*.partial"))
    assert (zarr.open_group(str(tmp_path / "a.zarr"), mode="r")["0"][:] == 1).all()


def test_memory_is_that_of_bands(tmp_path, monkeypatch):
    """A picture that does not fit in memory is refused, unless it is written as bands come."""
    size = (1 << 10, 1 << 20)
    monkeypatch.setattr(os, "sysconf", lambda name: 1 << 15)  # a GiB
    with pytest.raises(ValueError, match=r"^resolution: an image of 1024 x 1048576 takes 12\.0"):
        cluster.render(ball(), resolution=size)
    taken = []

    class Enough(Exception):
        pass

    def stop(fraction):
        taken.append(fraction)
        raise Enough

    for name in ("a.exr", "a.zarr"):
        with pytest.raises(Enough):
            cluster.render(
                ball(), resolution=size, boundary=False, output=tmp_path / name, progress=stop
            )
    assert len(taken) == 2
    # And nothing is left of it
    assert list(tmp_path.iterdir()) == []


def test_a_band_that_fails_three_times_ends_the_picture(tmp_path, monkeypatch):
    def fails(picture, task):
        raise RuntimeError("no luck")

    monkeypatch.setattr(picture, "render_band", fails)
    message = "^rows 0 to 63 have failed three times: RuntimeError: no luck$"
    with pytest.raises(RuntimeError, match=message):
        cluster.render(ball(), resolution=SIZE, output=tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.exr", "a.zarr"])
def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch, name):
    def full(*given):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(tiles, "compressed", full)
    monkeypatch.setattr(bands, "write_band", full)
    with pytest.raises(OSError, match="No space left on device"):
        cluster.render(ball(), resolution=SIZE, output=tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"output": "a.png"}, "a.png: expected a name that ends in .exr or .zarr"),
        ({"output": "old.zarr"}, "old.zarr: is there already; choose another name"),
        ({"output": "none/a.zarr"}, "make it first"),
        ({"output": "none/a.exr"}, "make it first"),
        ({"spp": 2}, "spp: expected a perfect square"),
        ({"max_depth": 0}, "max_depth: expected a whole number"),
        ({"resolution": (0, 1)}, "resolution: expected (width, height)"),
        ({"metadata": "no"}, "metadata: expected a dictionary of names and values, got 'no'"),
        (
            {"metadata": {"tiles": 1}},
            "metadata: expected names of 1 to 255 characters, but none that",
        ),
        ({"metadata": {"a\0": 1}}, "is laid out, got 'a\\x00'"),
        ({"metadata": {1: 1}}, "is laid out, got 1"),
        ({"metadata": {"a": 1 << 40}}, "metadata: a: expected a text, a number, or a whole number"),
        ({"metadata": {"a": [1]}}, "of 32 bits, got [1]"),
        ({"progress": 3}, "progress: expected True, False or a function"),
    ],
)
def test_bad_input_is_refused(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.zarr").mkdir()
    with pytest.raises(ValueError, match=re.escape(message)):
        cluster.render(ball(), **options)
    assert contents(tmp_path) == {}


def test_a_worker_that_does_not_see_the_pyramid_says_so(tmp_path):
    message = "on this worker; all workers have to see it"
    with pytest.raises(FileNotFoundError, match=message):
        pyramid.write_band(str(tmp_path / "none.zarr"), 0, np.zeros((1, 1, 3)))


def test_command(whole, tmp_path, capsys):
    """A pyramid; and workers, for a PNG of which the picture has to be in memory."""
    ball().save(tmp_path / "ball.toml")
    command = ["render", str(tmp_path / "ball.toml"), "--spp", "4", "--size", "70x150"]
    files = [str(tmp_path / name) for name in ("a.exr", "a.png")]
    assert run([*command, "-o", files[0], "-o", files[1], "--workers", "1"]) == 0
    assert f"wrote {files[0]} and {files[1]}, the PNG as sRGB" in capsys.readouterr().out
    np.testing.assert_array_equal(wt.read_image(tmp_path / "a.exr").numpy(), whole)
    assert run([*command, "-o", str(tmp_path / "a.zarr")]) == 0
    np.testing.assert_array_equal(zarr.open_group(str(tmp_path / "a.zarr"))["0"][:], whole)
    assert wt.read_image(tmp_path / "a.png").shape == whole.shape
    capsys.readouterr()
    for more, message in (
        (["-o", str(tmp_path / "a.zarr")], "a.zarr: is there already; choose another name"),
        (["-o", "b.zarr", "-o", "b.exr"], "-o: b.zarr is written alone; leave out the others"),
        (["-o", "b.exr", "--workers", "0"], "--workers: expected a whole number from 1 on, got 0"),
    ):
        assert run([*command, *more]) == 2
        out, error = capsys.readouterr()
        assert (out, error.count("\n")) == ("", 1)
        assert message in error
