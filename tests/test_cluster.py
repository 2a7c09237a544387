"""Data sets of pictures: what a sweep writes, and what is left when it is killed at any moment."""

import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from cluster_scene import IOR, VARY, X, ball, contents, deadly, doubled, picky, threads

import whitted as wt
from whitted import cluster
from whitted.cli import run
from whitted.cluster import connect, plan, samplers, store
from whitted.cluster.engine import outcomes
from whitted.cluster.samplers import Axis, Samples

NEEDS = "pip install 'whitted[cluster]'"
distributed = pytest.importorskip("distributed", reason=NEEDS)
zarr = pytest.importorskip("zarr", reason=NEEDS)

COUNT, BATCH = 12, 2
# Tasks of a command, which has no time for them
MANY = 80


@pytest.fixture(scope="module")
def client():
    """Two workers on this machine, of one thread each."""
    with connect.connected(None, 2) as client:
        yield client


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A sweep that nothing interrupts, in this process."""
    path = tmp_path_factory.mktemp("whole") / "whole.zarr"
    cluster.sweep(ball(), VARY, path, count=COUNT, batch=BATCH)
    return path


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """What a command writes that nothing interrupts."""
    path = tmp_path_factory.mktemp("many") / "many.zarr"
    cluster.sweep(ball(), VARY, path, count=MANY, batch=1)
    return path


def sweep(path, client=None, **options):
    return cluster.sweep(ball(), VARY, path, client, **{"count": COUNT, "batch": BATCH, **options})


# What is written


def test_pictures_are_those_of_the_scene(whole):
    group = zarr.open_group(str(whole), mode="r")
    assert group["image"].shape == (COUNT, 10, 12, 3)
    for k in (0, 5, 11):
        values = {IOR: group[IOR][k], "spheres.ball.center": (group[X][k], 0, 0)}
        expected = wt.render(ball().replace(values)).numpy()
        np.testing.assert_array_equal(group["image"][k], expected)
    assert group["done"][:].tolist() == [1] * 6
    # All is there to make the scene again
    assert wt.Scene.from_dict(group.attrs["scene"]) == ball()


def test_values_fill_their_ranges(whole):
    group = zarr.open_group(str(whole), mode="r")
    for name, (low, high) in VARY.items():
        places = (group[name][:] - low) / (high - low)
        # Of 8 points of a Sobol sequence, each eighth of a range has one
        assert sorted((places[:8] * 8).astype(int)) == list(range(8))


def test_derivatives_are_those_of_gradient(tmp_path):
    names = [IOR, "spheres.ball.center", "camera.position.z"]
    cluster.sweep(
        ball("double"), {X: [0.1]}, tmp_path / "a.zarr", derivatives=names, spp=4, batch=1
    )
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="r")
    labels = group.attrs["sweep"]["derivatives"]
    assert labels == [IOR, *(f"spheres.ball.center.{axis}" for axis in "xyz"), "camera.position.z"]
    scene = ball("double").replace({"spheres.ball.center": (0.1, 0, 0)})
    for k, label in enumerate(labels):
        name, _, axis = label.rpartition(".")
        at = (name, axis) if axis in "xyz" else (label, None)
        expected = wt.gradient(scene, *at, spp=4).numpy()
        # The same kernels, but one image for all: sums in the same order
        np.testing.assert_allclose(group["derivative"][0, k], expected, rtol=1e-12, atol=1e-12)


def test_store_opens_with_xarray(whole):
    """As the documentation says."""
    xarray = pytest.importorskip("xarray", reason="needs xarray")
    data = xarray.open_zarr(whole, consolidated=False)
    clear = data.image[(data[IOR] > 1.5).values]
    assert clear.dims == ("picture", "y", "x", "channel")
    assert 0 < clear.shape[0] < COUNT
    np.testing.assert_array_equal(data.image[3], zarr.open_group(str(whole))["image"][3])


def test_store_opens_with_torch(whole):
    torch = pytest.importorskip("torch", reason="needs PyTorch")
    data = zarr.open_group(str(whole), mode="r")
    pictures, index = (torch.from_numpy(data[name][:]) for name in ("image", IOR))
    assert len(torch.utils.data.TensorDataset(pictures, index)) == COUNT


def test_numbers_of_clouds_and_patterns(tmp_path):
    """One sphere of a cloud, and a number of each that a pattern stands for."""
    beads = wt.Cloud("beads", spheres=[[0, 0, 0, 0.3], [1, 0, 0, 0.2]], material="glass")
    scene = ball().add(beads)
    vary = {"clouds.beads.radius.1": [0.1, 0.2], "clouds.beads.center.0.y": [0.3, 0.4]}
    vary["materials.*.ior"] = [1.2, 1.3]
    cluster.sweep(scene, vary, tmp_path / "a.zarr")
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="r")
    values = {
        "clouds.beads.radius": np.array([0.3, 0.2]),
        "clouds.beads.center": np.array([[0, 0.4, 0], [1, 0, 0]]),
        **{f"materials.{name}.ior": 1.3 for name in ("glass", "floor")},
    }
    expected = wt.render(scene.replace(values)).numpy()
    np.testing.assert_array_equal(group["image"][1], expected)


def test_values_may_be_drawn_by_a_function(tmp_path):
    def normal(random, count):
        return random.normal(1.5, 0.01, count)

    for name in ("a.zarr", "b.zarr"):
        cluster.sweep(ball(), {IOR: normal}, tmp_path / name, count=3, seed=5)
    assert contents(tmp_path / "a.zarr") == contents(tmp_path / "b.zarr")
    values = zarr.open_group(str(tmp_path / "a.zarr"))[IOR][:]
    np.testing.assert_array_equal(values, normal(np.random.default_rng(5), 3))


# Samplers


@pytest.mark.parametrize("sampler", samplers.SAMPLERS)
def test_any_part_of_the_values_is_computed_by_itself(sampler):
    axes = Axis("a", 0, 1), Axis("b", -1, 1), Axis("c", 2, 3)
    samples = Samples(axes, sampler, 125, seed=3)
    whole = samples.values(0, 125)
    assert whole.shape == (125, 3)
    assert (whole >= [0, -1, 2]).all()
    assert (whole <= [1, 1, 3]).all()
    parts = [samples.values(first, min(7, 125 - first)) for first in range(0, 125, 7)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert len(np.unique(whole, axis=0)) == 125
    if sampler != "grid":
        assert (Samples(axes, sampler, 125, seed=4).values(0, 9) != whole[:9]).any()


def test_a_grid_has_all_combinations():
    axes = Axis("a", 0, 1), Axis("b", values=(5.0, 7.0)), Axis("c", 2, 4)
    values = Samples(axes, "grid", 18, 0).values(0, 18)
    expected = [[a, b, c] for a in (0, 0.5, 1) for b in (5, 7) for c in (2, 3, 4)]
    assert values.tolist() == expected


# Killed at any moment


def test_workers_write_the_same_bytes(whole, client, tmp_path):
    seen = []
    result = sweep(tmp_path / "a.zarr", client, progress=seen.append)
    assert contents(tmp_path / "a.zarr") == contents(whole)
    assert (result.count, result.tasks, result.rendered, result.failed) == (COUNT, 6, 6, [])
    np.testing.assert_allclose(seen, np.arange(1, 7) / 6)


def test_a_worker_that_is_killed_loses_nothing(whole, client, tmp_path):
    """By its process, while tasks run and wait on it."""
    victims = list(client.run(os.getpid).values())[:1]

    def kill(fraction):
        while victims:
            os.kill(victims.pop(), signal.SIGKILL)

    result = sweep(tmp_path / "a.zarr", client, progress=kill, batch=1)
    assert result.failed == []
    sweep(tmp_path / "b.zarr", batch=1)
    assert contents(tmp_path / "a.zarr") == contents(tmp_path / "b.zarr")


def command(path, *more):
    """A command that renders more than it has time for."""
    path.parent.joinpath("ball.toml").unlink(missing_ok=True)
    ball().save(path.parent / "ball.toml")
    vary = [
        word for name, ends in VARY.items() for word in ("--vary", f"{name}={ends[0]}:{ends[1]}")
    ]
    about = ["-o", str(path), "--count", str(MANY), "--batch", "1"]
    words = ["sweep", str(path.parent / "ball.toml"), *vary, *about, *more]
    return [sys.executable, "-m", "whitted", *words], words


def started(path, *more):
    """A process that has done some tasks, and has many more to do."""
    process = subprocess.Popen(command(path, *more)[0], stderr=subprocess.PIPE, text=True)
    while len(store.marks(path) if path.exists() else ()) < 3:
        assert process.poll() is None
        time.sleep(0.01)
    return process


@pytest.mark.parametrize("more", [[], ["--workers", "2"]], ids=["here", "workers"])
def test_a_client_that_is_killed_loses_nothing(many, tmp_path, capsys, more):
    """`kill -9` of the command; --resume ends with the same bytes as a command that was not."""
    path = tmp_path / "a.zarr"
    process = started(path, *more)
    process.kill()
    process.wait()
    process.stderr.close()
    done = len(store.marks(path))
    assert 3 <= done < MANY
    words = command(path)[1]
    assert run([*words, "--resume"]) == 0
    left = int(
        re.search(rf"{MANY} pictures, (\d+) of {MANY} tasks now", capsys.readouterr().out)[1]
    )
    # Workers that had lost their client may have ended a task each
    assert MANY - done - 2 <= left <= MANY - done
    assert contents(path) == contents(many)


@pytest.mark.parametrize("more", [[], ["--workers", "1"]], ids=["here", "workers"])
def test_ctrl_c_keeps_what_is_done(tmp_path, more):
    path = tmp_path / "a.zarr"
    process = started(path, *more)
    process.send_signal(signal.SIGINT)
    told = process.communicate()[1]
    assert process.returncode == 130
    assert told == f"{path}: what is done is kept; --resume goes on\n"
    assert 3 <= len(store.marks(path)) < MANY


def test_a_scheduler_that_is_killed_loses_nothing(whole, tmp_path):
    """The scheduler and the worker are processes of their own."""
    address = tmp_path / "address.json"
    dask = [sys.executable, "-m", "dask"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    about = ["--scheduler-file", str(address)]
    places = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    scheduler = subprocess.Popen([*dask, "scheduler", *about, *places], **quiet)
    threads = ["--nthreads", "1", "--no-nanny", "--no-dashboard"]
    worker = subprocess.Popen([*dask, "worker", *about, *threads], cwd=tmp_path, **quiet)
    try:
        while not address.exists() or not address.read_text().endswith("}"):
            time.sleep(0.01)
        place = re.search(r'"address": "(tcp:[^"]*)"', address.read_text())[1]
        with connect.connected(place, None) as client:
            message = (
                "^the scheduler has gone; what is done is kept; start another one, and resume$"
            )
            with pytest.raises(ConnectionError, match=message):
                sweep(tmp_path / "a.zarr", client, progress=lambda fraction: scheduler.kill())
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.wait()
    assert 0 < len(store.marks(tmp_path / "a.zarr")) < 6
    sweep(tmp_path / "a.zarr", resume=True)
    assert contents(tmp_path / "a.zarr") == contents(whole)


@pytest.mark.parametrize("moment", range(3))
def test_data_comes_before_its_mark(whole, tmp_path, monkeypatch, moment):
    """The process ends before the data, after it, or after the mark."""

    class Killed(BaseException):
        pass

    def die(*given):
        raise Killed

    with monkeypatch.context() as patch:
        name = ("write", "_to_disk", "finish")[moment]
        patch.setattr(store, name, die)
        with pytest.raises(Killed):
            sweep(tmp_path / "a.zarr")
    done = store.marks(tmp_path / "a.zarr")
    assert len(done) == (0, 0, 6)[moment]
    assert (tmp_path / "a.zarr/image/c/0").exists() == (moment > 0)
    # What is left is overwritten, not trusted
    sweep(tmp_path / "a.zarr", resume=True)
    assert contents(tmp_path / "a.zarr") == contents(whole)


def test_a_store_appears_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(samplers.Samples, "values", lambda *given: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        sweep(tmp_path / "a.zarr")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_ends_the_sweep(whole, tmp_path, monkeypatch, capsys):
    """At once, as all other tasks would meet it; what is done is kept."""
    path, tasks = tmp_path / "a.zarr", []

    def full(*given):
        tasks.append(1)
        if len(tasks) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path / "image"))

    with monkeypatch.context() as patch:
        patch.setattr(store, "_to_disk", full)
        ball().save(tmp_path / "ball.toml")
        words = [f"--vary={name}={low}:{high}" for name, (low, high) in VARY.items()]
        words += ["--count", "12", "--batch", "2", "-o", str(path)]
        assert run(["sweep", str(tmp_path / "ball.toml"), *words]) == 2
    assert len(tasks) == 3
    told = "No space left on device; what is done is kept, and resume goes on"
    assert capsys.readouterr().err == f"{path}: cannot be read or written: {told}\n"
    assert sorted(store.marks(path)) == [0, 1]
    sweep(path, resume=True)
    assert contents(path) == contents(whole)


def test_a_task_that_fails_three_times_is_recorded(whole, tmp_path, monkeypatch):
    path, tried = tmp_path / "a.zarr", []
    write = store.write

    def fails(path, plan, task, *rest):
        tried.append(task)
        if task == 4 or (task == 1 and tried.count(1) < 3):
            raise RuntimeError("no luck\nat all")
        write(path, plan, task, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(store, "write", fails)
        result = sweep(path)
    assert tried == [0, 1, 1, 1, 2, 3, 4, 4, 4, 5]
    group = zarr.open_group(str(path), mode="r")
    recorded = [
        {
            "picture": picture,
            "values": {name: float(group[name][picture]) for name in VARY},
            "reason": "RuntimeError: no luck",
        }
        for picture in (8, 9)
    ]
    assert result.failed == recorded
    assert group.attrs["failed"] == recorded
    assert np.isnan(group["image"][8:10]).all()
    # Tried again, and no trace is left
    assert sweep(path, resume=True).failed == []
    assert contents(path) == contents(whole)


@pytest.mark.parametrize("batch", [1, 3])
def test_a_picture_that_the_scene_refuses_is_recorded(tmp_path, capsys, batch):
    """The rest is rendered, of its task or of others; --resume looks again, and says the same."""
    ball().save(tmp_path / "ball.toml")
    words = ["sweep", str(tmp_path / "ball.toml"), "-o", str(tmp_path / "a.zarr")]
    words += ["--vary", "camera.position.z=3,0,2", "--vary", "camera.position.y=0.8,0,0.5"]
    words += ["--batch", str(batch)]
    for more in ([], ["--resume"]):
        assert run([*words, *more]) == 3
        out, error = capsys.readouterr()
        tasks = 3 // batch
        now = 1 if more else tasks
        assert f"3 pictures, 1 of them missing, {now} of {tasks} tasks now" in out
        assert error.startswith("picture 1 (camera.position.z = 0, camera.position.y = 0): camera.")
        assert error.count("\n") == 1
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="r")
    assert np.isnan(group["image"][:]).all(axis=(1, 2, 3)).tolist() == [False, True, False]
    assert group["done"][:].tolist() == {1: [1, 2, 1], 3: [2]}[batch]


# The engine


@pytest.mark.parametrize("where", ["here", "workers"])
def test_tasks_that_fail_let_the_rest_go_on(request, where):
    client = request.getfixturevalue("client") if where == "workers" else None
    done = {one.task: one for one in outcomes(client, picky, "shared", range(6))}
    assert {task: one.value for task, one in done.items() if one.error is None} == {
        task: task for task in (0, 1, 2, 4, 5)
    }
    assert done[3].error == "shared: no task 3 here"


def test_a_task_that_ends_its_workers_is_given_up(client, monkeypatch):
    """As one does that takes all memory. Dask gives it up after some workers."""
    monkeypatch.setattr(client.cluster.scheduler, "allowed_failures", 0)
    done = {one.task: one for one in outcomes(client, deadly, None, range(6))}
    assert sorted(done) == list(range(6))
    died = "each worker that ran it has died, perhaps for want of memory"
    assert done[3].error == died
    client.wait_for_workers(2)


def test_workers_have_the_threads_that_dask_gave_them(client):
    own = list(client.nthreads().values())
    found = [one.value for one in outcomes(client, threads, None, range(4))]
    assert set(found) == set(own)


def test_few_tasks_are_with_the_scheduler_at_once(client):
    """However many there are."""
    asked = []

    def tasks():
        for task in range(1000):
            asked.append(task)
            yield task

    run = outcomes(client, doubled, 2, tasks())
    assert next(run).value in (0, 2)
    for _ in range(10):
        next(run)
    assert len(asked) < 40
    run.close()


def test_without_a_client_dask_is_not_imported(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[2]); from cluster_scene import *\n"
        "from whitted import cluster\n"
        "cluster.sweep(ball(), VARY, sys.argv[1], count=2)\n"
        "assert not {'dask', 'distributed'} & set(sys.modules)"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "a.zarr"), os.path.dirname(__file__)]
    assert subprocess.run(words, check=False).returncode == 0


# Bad input


REFUSED = [
    (
        {"vary": {"materials.glass.ior": (-1, 2)}},
        "materials.glass.ior: expected a number > 0, got -1",
    ),
    ({"vary": {IOR: (1.5, 1.2)}}, f"{IOR}: the lowest, 1.5, is above the highest, 1.2"),
    ({"vary": {IOR: (1, float("inf"))}}, f"{IOR}: expected a number > 0, got inf"),
    ({"vary": {"materials.glass.reflection": [0.5, 2]}}, "materials.glass.reflection: expected a"),
    ({"vary": {IOR: "high"}}, f"{IOR}: expected (low, high) or a list of numbers, got 'high'"),
    ({"vary": {IOR: [[1, 2]]}}, f"{IOR}: expected (low, high) or a list of numbers, got [[1, 2]]"),
    ({"vary": {}}, "vary: expected a dictionary such as {'materials.glass.ior': (1.3, 1.8)}, got"),
    ({"vary": [IOR]}, "vary: expected a dictionary"),
    ({"vary": {3: (1, 2)}}, "vary: expected the name of a parameter, got 3"),
    ({"vary": {IOR: lambda *_: 1.5}}, f"{IOR}: expected (low, high) or a list of numbers, got 1.5"),
    ({"derivatives": None}, "derivatives: expected names of parameters, got None"),
    ({"derivatives": [IOR, IOR]}, f"derivatives: '{IOR}' is named twice"),
    ({"boundary": "no"}, "boundary: expected True or False, got 'no'"),
    ({"path": None}, "path: expected the name of a folder that ends in .zarr, got None"),
    (
        {"count": 1 << 20, "batch": 1 << 20, "resolution": (512, 512)},
        "batch: 1048576 pictures take 3072.0 GiB, too much; take a smaller one",
    ),
    (
        {"vary": {X: (0, 1), "spheres.ball.center": (0, 1)}},
        f"vary: '{X}' is named twice",
    ),
    ({"vary": {IOR: [1.2, 1.3]}}, f"{IOR}: has 2 values for 12 pictures; give one for each, or"),
    ({"count": None}, "count: say how many pictures there are to be"),
    ({"count": None, "sampler": "grid"}, "count: say how many pictures a grid over ranges has"),
    (
        {"count": None, "vary": {IOR: lambda *_: 1}},
        f"count: say how many values of {IOR} are to be",
    ),
    ({"count": 0}, "count: expected a whole number from 1 on, got 0"),
    ({"count": 2.5}, "count: expected a whole number from 1 on, got 2.5"),
    (
        {"count": 10, "sampler": "grid"},
        "count: a grid over 2 ranges has a whole number of values along each; take 9 or 16 in "
        "place of 10, or another sampler",
    ),
    (
        {"count": 3, "sampler": "grid", "vary": {IOR: [1.2, 1.3]}},
        "count: a grid over 0 ranges has a whole number of values along each; take 2 in place of 3",
    ),
    (
        {"count": 1 << 34, "batch": 2},
        "count: 17179869184 pictures are more than 2^31; give fewer, or cut the sweep into several",
    ),
    ({"sampler": "latin"}, "sampler: expected one of grid, sobol, random, got 'latin'"),
    ({"seed": -1}, "seed: expected a whole number from 0 on, got -1"),
    ({"batch": 0}, "batch: expected a whole number from 1 on, got 0"),
    ({"spp": 3}, "spp: expected a perfect square"),
    ({"max_depth": 0}, "max_depth: expected a whole number from 1 to 256, got 0"),
    ({"resolution": (0, 8)}, "resolution: expected (width, height)"),
    ({"path": "a.zip"}, "a.zip: expected a name that ends in .zarr"),
    ({"path": "none/a.zarr"}, "make it first"),
    ({"path": "s3://bucket/a.zarr"}, "expected a folder that all workers see, not an address"),
]


@pytest.mark.parametrize(("options", "message"), REFUSED, ids=range(len(REFUSED)))
def test_bad_input_is_refused(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    given = {"vary": VARY, "path": "a.zarr", "count": COUNT, **options}
    with pytest.raises(ValueError, match=re.escape(message)):
        cluster.sweep(ball(), given.pop("vary"), given.pop("path"), **given)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name",
    ["spheres.bal.radius", "spheres.ball.center.w", "lamps.*", "ior"],
)
def test_unknown_names_are_refused(tmp_path, name):
    with pytest.raises(KeyError, match=re.escape(f"no parameter '{name}'; nearest: ")):
        cluster.sweep(ball(), {name: (0, 1)}, tmp_path / "a.zarr", count=2)


def test_no_scene_is_refused(tmp_path):
    with pytest.raises(TypeError, match="load one with"):
        cluster.sweep("cornell", VARY, tmp_path / "a.zarr", count=2)


def test_a_store_that_is_there_is_kept(whole, tmp_path):
    before = contents(whole)
    message = f"^{re.escape(str(whole))}: is there already; resume it, or choose another name$"
    with pytest.raises(ValueError, match=message):
        sweep(whole)
    for options, what in (
        ({"count": 14}, "count (12 there, 14 here)"),
        ({"seed": 1}, "seed (0 there, 1 here)"),
        ({"spp": 4}, "spp (1 there, 4 here)"),
        ({"batch": 3}, "batch (2 there, 3 here)"),
        ({"derivatives": [IOR]}, "derivatives ("),
        ({"seed": 2, "spp": 9}, "seed (0 there, 2 here), spp (1 there, 9 here)"),
    ):
        message = f"{re.escape(str(whole))}: holds another sweep, of another {re.escape(what)}"
        with pytest.raises(ValueError, match=message):
            sweep(whole, resume=True, **options)
    # The sampler gives the first number its first values
    with pytest.raises(ValueError, match=r"holds another sweep, of another vary \("):
        cluster.sweep(
            ball(), dict(reversed(VARY.items())), whole, count=COUNT, batch=BATCH, resume=True
        )
    other = ball().replace({"ambient": (0.3, 0.2, 0.2)})
    message = f"{re.escape(str(whole))}: holds another sweep, of another scene; choose another name"
    with pytest.raises(ValueError, match=message):
        cluster.sweep(other, VARY, whole, count=COUNT, batch=BATCH, resume=True)
    assert contents(whole) == before
    (tmp_path / "b.zarr").mkdir()
    with pytest.raises(ValueError, match=r"b\.zarr: is no sweep of whitted; choose another name"):
        sweep(tmp_path / "b.zarr", resume=True)


def test_workers_of_other_versions_are_named(client, monkeypatch, tmp_path):
    worker = re.escape(min(client.nthreads()))
    monkeypatch.setattr(connect, "PACKAGES", ("whitted", "pip"))
    versions = {"whitted": connect.metadata.version("whitted"), "pip": "0.1"}
    monkeypatch.setattr(connect, "own_version", versions.get)
    with pytest.raises(
        ValueError, match=rf"worker {worker}: has pip [\d.]+, and this machine 0\.1"
    ):
        sweep(tmp_path / "a.zarr", client)


def test_workers_without_the_package_are_named(client, monkeypatch, tmp_path):
    monkeypatch.setattr(connect, "PACKAGES", ("no-such-package",))
    monkeypatch.setattr(connect, "own_version", lambda package: "1.0")
    message = (
        "has no no-such-package, and this machine 1.0; .*; install the same versions everywhere"
    )
    with pytest.raises(ValueError, match=message):
        sweep(tmp_path / "a.zarr", client)


@pytest.mark.parametrize(
    ("module", "message"),
    [
        ("zarr", "a Zarr store needs zarr: pip install 'whitted[cluster]' on Python 3.11 or newer"),
        ("scipy.stats.qmc", "a Sobol sequence needs scipy: pip install 'whitted[cluster]'"),
        ("distributed", "a cluster needs distributed: pip install 'whitted[cluster]'"),
    ],
)
def test_missing_libraries_are_named(tmp_path, monkeypatch, module, message):
    monkeypatch.setitem(sys.modules, module, None)
    with (
        pytest.raises(RuntimeError, match=f"^{re.escape(message)}$"),
        connect.connected(None, 1 if module == "distributed" else None),
    ):
        sweep(tmp_path / "a.zarr")


def test_a_name_that_no_array_can_have(tmp_path):
    ball_of_glass = wt.Sphere("a/b", center=(0, 0, 0), radius=0.4, material="glass")
    scene, name = ball().add(ball_of_glass), "spheres.a/b.radius"
    message = f"vary: '{name}' cannot be the name of an array, for its '/'; rename the thing in the"
    with pytest.raises(ValueError, match=re.escape(message)):
        cluster.sweep(scene, {name: (0.1, 0.2)}, tmp_path / "a.zarr", count=2)


def test_numbers_of_numpy_are_numbers(whole, tmp_path):
    options = {"count": np.int64(COUNT), "batch": np.int32(BATCH), "spp": np.int64(1)}
    sweep(tmp_path / "a.zarr", **options, boundary=np.bool_(True), max_depth=np.int8(8))
    attributes = zarr.open_group(str(tmp_path / "a.zarr"), mode="r").attrs["sweep"]
    assert attributes["batch"] == BATCH


def test_what_is_no_client_is_refused(client, tmp_path):
    message = "client: expected a distributed.Client, got str; Client(cluster) or"
    with pytest.raises(TypeError, match=re.escape(message)):
        sweep(tmp_path / "a.zarr", "127.0.0.1:8786")
    closed = distributed.Client(client.scheduler.address)
    closed.close()
    with pytest.raises(ValueError, match="client: is closed; connect again"):
        sweep(tmp_path / "b.zarr", closed)


def test_a_chunk_that_is_gone_is_rendered_again(whole, tmp_path):
    copy = tmp_path / "copy.zarr"
    shutil.copytree(whole, copy)
    shutil.rmtree(copy / "image" / "c" / "3")
    assert sweep(copy, resume=True).rendered == 1
    assert contents(copy) == contents(whole)
    (copy / "done" / "zarr.json").write_text("{")
    with pytest.raises(ValueError, match=r"copy\.zarr: is damaged, its marks cannot be read"):
        sweep(copy, resume=True)


def test_what_killed_processes_have_not_renamed_is_removed(whole, tmp_path):
    copy = tmp_path / "copy.zarr"
    shutil.copytree(whole, copy)
    (copy / "done" / "c" / "3").unlink()
    for left in ("done/c/3", "image/c/3/0/0/0", "zarr.json"):
        (copy / left).with_suffix(".0a1b2c.partial").write_bytes(b"half")
    assert sweep(copy, resume=True).rendered == 1
    assert contents(copy) == contents(whole)


def test_a_thousand_failures_are_recorded(whole, tmp_path):
    copy = tmp_path / "copy.zarr"
    shutil.copytree(whole, copy)
    store.finish(copy, [{"picture": k} for k in range(1005)])
    failed = zarr.open_group(str(copy), mode="r").attrs["failed"]
    assert failed[-2:] == [{"picture": 999}, {"more": 5}]


def test_a_worker_that_does_not_see_the_store_says_so(tmp_path):
    planned = plan.Plan(ball(), (), Samples((), "random", 1, 0), (), (4, 4), 1, True, 1, 1)
    message = "on this worker; all workers have to see it"
    with pytest.raises(FileNotFoundError, match=message):
        store.write(tmp_path / "none.zarr", planned, 0, {})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--scheduler 127.0.0.1:9", "--scheduler: '127.0.0.1:9' does not answer within 1 s; start"),
        ("--scheduler nonsense", "--scheduler: 'nonsense' does not answer within 1 s; start one"),
        (
            "--scheduler a --workers 2",
            "--scheduler: has workers of its own; leave out --workers, or --scheduler",
        ),
        ("--workers 0", "--workers: expected a whole number from 1 on, got 0"),
        (f"--vary {IOR}=2:3", f"--vary: '{IOR}' is given twice; give it once"),
        ("--vary camera.fov", "--vary: expected NAME=LOW:HIGH, as in materials.glass.ior=1.3:1.8,"),
        ("--vary camera.fov=a:b", "or NAME=A,B,C, got 'camera.fov=a:b'"),
        ("--vary camera.fov=0:190", "camera.fov: expected an angle in degrees, in (0, 180), got 0"),
        ("--vary camera.fog=0:1", "no parameter 'camera.fog'; nearest: camera.fov"),
        ("--sampler latin", "--sampler"),
        ("--wrt camera.fog", "no parameter 'camera.fog'; nearest: camera.fov"),
        ("-o a.zip", "-o"),
    ],
)
def test_command_refuses_bad_input(tmp_path, capfd, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(connect, "TIMEOUT", 1)
    status = run(f"sweep cornell --vary {IOR}=1:2 --count 4 -o a.zarr {words}".split())
    printed, error = capfd.readouterr()
    assert (status, printed, error.count("\n")) == (2, "", 1)
    assert message in error
    assert list(tmp_path.iterdir()) == []
