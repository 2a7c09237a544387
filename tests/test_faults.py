"""What a machine does to a render: full disks, folders that go, broken caches of kernels, signals,
little memory.

A file is whole, the old one or the new one, or there is none; a message is one line, and the exit
status is not 0.
"""

import os
import resource
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import whitted as wt
from whitted.cli import run

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "scenes" / "three_diffuse.toml"
SMALL = ["--size", "16x16", "--no-boundary"]


def start(out, *options, limits=(), cache=None, **more):
    """A render from the command line in a process of its own, under limits."""

    def limit():
        signal.signal(
            signal.SIGXFSZ, signal.SIG_IGN
        )  # a full disk is an error of the write, not a signal
        signal.signal(
            signal.SIGINT, signal.SIG_DFL
        )  # what a shell runs in the background ignores it
        for kind, value in limits:
            resource.setrlimit(kind, (value, value))

    command = [sys.executable, "-m", "whitted.cli", "render", str(SCENE), "-o", str(out), *options]
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        **({"DRJIT_CACHE_DIR": str(cache)} if cache else {}),
    }
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(
        command, env=environment, preexec_fn=limit, restore_signals=False, **pipes, **more
    )


def finish(process):
    """Exit status, and the lines on standard error."""
    _, error = process.communicate(timeout=100)
    assert "Traceback" not in error
    return process.returncode, error.splitlines()


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("limit", [0, 500, 20_000])
def test_full_disk_leaves_the_old_image(tmp_path, limit):
    """A disk that takes no byte, less than a buffer, or a part of the file."""
    out, size = tmp_path / "a.exr", ["--size", "96x96" if limit > 500 else "8x8", "--no-boundary"]
    assert (
        run(["render", str(SCENE), "-o", str(out), *size]) == 0
    )  # compiles, so that no cache is written to later
    old = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    status, error = finish(
        start(out, *size, "--depth", "1", limits=[(resource.RLIMIT_FSIZE, limit)])
    )
    assert (status, error) == (
        2,
        [f"{out}: cannot be read or written: cannot be written; is the disk full?"],
    )
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == old


WRITE = """
import resource, signal, sys
import numpy as np
import whitted as wt
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
for height in (1, 15, 16, 17, 60):
    image = np.random.default_rng(height).normal(size=(height, 9, 3)).astype(np.float32)
    wt.write_image("whole.exr", image)
    size = len(open("whole.exr", "rb").read())
    for limit in (0, 1, 8, 50, 300, 350, 400, size // 2, size - 500, size - 1, size):
        resource.setrlimit(resource.RLIMIT_FSIZE, (max(limit, 0), resource.RLIM_INFINITY))
        try:
            wt.write_image(f"{height}-{limit}.exr", image)
        except OSError as error:
            assert "is the disk full?" in str(error), error
            assert limit < size, (height, limit)
        else:
            assert limit == size, (height, limit)
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    np.testing.assert_array_equal(wt.read_image(f"{height}-{size}.exr").numpy(), image)
"""


def test_no_part_of_an_exr_is_taken_for_the_whole(tmp_path):
    """Wherever the disk is full, in the header, in the offsets or in the pixels."""
    command, environment = [sys.executable, "-c", WRITE], {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr
    assert len(names(tmp_path)) == 6


def test_folder_that_vanishes_is_one_line_of_error(tmp_path, capsys, monkeypatch):
    folder, render = tmp_path / "folder", wt.render
    folder.mkdir()

    def render_and_remove(*arguments, **options):
        folder.rmdir()
        return render(*arguments, **options)

    monkeypatch.setattr(wt, "render", render_and_remove)
    assert run(["render", str(SCENE), "-o", str(folder / "a.exr"), *SMALL]) == 2
    assert (
        capsys.readouterr().err
        == f"{folder / 'a.exr'}: cannot be read or written: No such file or directory\n"
    )
    assert names(tmp_path) == []


def test_folder_that_turns_read_only_is_one_line_of_error(tmp_path, capsys, monkeypatch):
    if os.geteuid() == 0:
        pytest.skip("nothing is read-only to root")
    render = wt.render

    def render_and_close(*arguments, **options):
        tmp_path.chmod(0o555)
        return render(*arguments, **options)

    monkeypatch.setattr(wt, "render", render_and_close)
    assert run(["render", str(SCENE), "-o", str(tmp_path / "a.exr"), *SMALL]) == 2
    tmp_path.chmod(0o755)
    assert "a.exr: cannot be read or written: Permission denied\n" in capsys.readouterr().err
    assert names(tmp_path) == []


@pytest.fixture
def expected():
    return wt.render(wt.load_scene(SCENE), boundary=False, resolution=(16, 16)).numpy()


def damage_none(path):
    pass


def damage_flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x55
    path.write_bytes(data)


def damage_noise(path):
    path.write_bytes(np.random.default_rng(0).bytes(path.stat().st_size))


def damage_cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def damage_folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.slow
def test_damaged_cache_of_kernels_changes_no_image(tmp_path, expected):
    """Kernels are compiled anew, and the image is the same."""
    cache, out = tmp_path / "cache", tmp_path / "a.exr"
    cache.mkdir()
    for damage in (damage_none, damage_flip, damage_noise, damage_cut, damage_folder):
        kernels = list(cache.glob("*.bin"))
        assert damage is damage_none or kernels
        for path in kernels:
            damage(path)
        assert finish(start(out, *SMALL, cache=cache)) == (0, []), damage
        np.testing.assert_array_equal(wt.read_image(out).numpy(), expected)
        out.unlink()


def test_cache_of_kernels_that_cannot_be_written_stops_nothing(tmp_path, expected):
    """Dr.Jit says so, and goes on without."""
    (tmp_path / "file").write_text("")
    status, error = finish(start(tmp_path / "a.exr", *SMALL, cache=tmp_path / "file"))
    assert status == 0
    assert len(error) == 1
    assert "kernel cache" in error[0]
    np.testing.assert_array_equal(wt.read_image(tmp_path / "a.exr").numpy(), expected)


def test_processes_share_a_cache_of_kernels_while_it_fills(tmp_path, expected):
    (tmp_path / "cache").mkdir()
    processes = [start(tmp_path / f"{k}.exr", *SMALL, cache=tmp_path / "cache") for k in range(4)]
    assert [finish(process) for process in processes] == [(0, [])] * 4
    for k in range(4):
        np.testing.assert_array_equal(wt.read_image(tmp_path / f"{k}.exr").numpy(), expected)
    assert not list((tmp_path / "cache").glob("*.tmp"))


def cpu_seconds(pid):
    """What a process has spent, which tells how far it is on a machine of any load."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, -signal.SIGTERM)]
)
def test_signal_leaves_the_old_image(tmp_path, number, status):
    """In a render that would take minutes."""
    out = tmp_path / "a.exr"
    out.write_bytes(b"old")
    process = start(out, "--spp", "65536", "--no-boundary", start_new_session=True)
    while cpu_seconds(process.pid) < 4:
        assert process.poll() is None
        time.sleep(0.1)
    os.killpg(process.pid, number)
    code, error = finish(process)
    assert (code, error) == (status, [])
    assert names(tmp_path) == ["a.exr"]
    assert out.read_bytes() == b"old"


@pytest.mark.parametrize("module", ["drjit", "typer"])
def test_interrupt_while_the_command_starts_ends_it_without_a_word(tmp_path, module):
    """In the half second in which it imports what it needs."""
    (tmp_path / f"{module}.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(1)"
    )
    script = tmp_path / "whitted"
    script.write_text("from whitted.cli import main\nmain()")
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    heeded = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    done = subprocess.run(
        [sys.executable, script, "info"], env=environment, preexec_fn=heeded, capture_output=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")


def test_memory_that_runs_out_is_one_line_of_error(tmp_path):
    """An image of 1648 MiB in 1500 MiB of address space."""
    out = tmp_path / "a.exr"
    out.write_bytes(b"old")
    status, error = finish(
        start(
            out, "--size", "12000x12000", "--no-boundary", limits=[(resource.RLIMIT_AS, 1500 << 20)]
        )
    )
    assert (status, error) == (2, ["not enough memory; use a smaller resolution"])
    assert names(tmp_path) == ["a.exr"]
    assert out.read_bytes() == b"old"


def test_cache_is_kept_where_it_is_said_to_be(tmp_path):
    """`whitted info` names the folder that Dr.Jit uses."""
    cache = tmp_path / "cache"
    cache.mkdir()
    assert finish(start(tmp_path / "a.exr", *SMALL, cache=cache)) == (0, [])
    assert list(cache.glob("*.bin"))
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DRJIT_CACHE_DIR": str(cache)}
    told = subprocess.run(
        [sys.executable, "-m", "whitted.cli", "info"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"{cache}\n" in told.stdout
