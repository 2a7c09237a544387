"""Ctrl-C at any moment: `KeyboardInterrupt`, the best so far of a fit, and right images afterwards.

And several threads that differentiate at once.
"""

import gc
import signal
import subprocess
import sys

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from samples import camera, light, material, plane, sphere

import whitted as wt
from whitted.core import interrupts
from whitted.core.frozen import frozen

CENTER = "spheres.ball.center"
TEXT = (
    camera((0, 0, 3), resolution=(24, 16))
    + material("red", color=(0.8, 0.2, 0.1))
    + sphere((0, 0, 0), 0.5, "red", "ball")
    + plane((0, 1, 0), 1, "red", "floor")
    + light((1, 3, 2))
)


@pytest.fixture(autouse=True)
def python_s_handler():
    """What pytest and its workers do about Ctrl-C is restored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def loaded(load):
    return load(TEXT, "single")


def press(*_):
    signal.raise_signal(signal.SIGINT)


def test_a_signal_waits_while_a_function_is_recorded():
    @frozen
    def doubled(x):
        press()
        return x * 2

    interrupts.heed()
    with pytest.raises(KeyboardInterrupt):
        doubled(dr.opaque(ad.Float, 3))
    assert gc.isenabled()
    assert doubled(dr.opaque(ad.Float, 4)).numpy() == [8]


def test_a_signal_ends_an_image_and_a_derivative(loaded):
    image, derivative = wt.render(loaded).numpy(), wt.gradient(loaded, CENTER, "x").numpy()
    calls = []

    def second(_):
        calls.append(1)
        if len(calls) == 2:
            press()

    with pytest.raises(KeyboardInterrupt):
        wt.render(loaded, progress=press)
    with pytest.raises(KeyboardInterrupt):
        wt.gradient(loaded, CENTER, "x", progress=second)
    np.testing.assert_array_equal(wt.render(loaded).numpy(), image)
    np.testing.assert_array_equal(wt.gradient(loaded, CENTER, "x").numpy(), derivative)


def test_an_error_within_a_derivative_comes_out_as_it_is(loaded):
    def fail(fraction):
        if fraction > 0.5:
            raise LookupError("mine")

    with pytest.raises(LookupError, match="mine"):
        wt.gradient(loaded, CENTER, "x", progress=fail)


def test_another_handler_is_called_and_nothing_is_interrupted(loaded):
    expected, seen = wt.gradient(loaded, CENTER, "x").numpy(), []
    signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    found = wt.gradient(loaded, CENTER, "x", progress=press)
    np.testing.assert_array_equal(found.numpy(), expected)
    assert seen == [signal.SIGINT] * 2


def test_an_ignored_signal_stays_ignored(loaded):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    wt.render(loaded, progress=press)
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_held_pieces_within_each_other():
    """A signal waits for the end of the innermost piece that may be interrupted."""
    interrupts.heed()
    done = []

    def inner():
        press()
        done.append("inner")

    def middle():
        interrupts.held(inner)
        done.append("not here")

    def outer():
        press()
        done.append("outer")
        with pytest.raises(KeyboardInterrupt):
            interrupts.interruptible(done.append, "not here either")
        with pytest.raises(KeyboardInterrupt):
            interrupts.interruptible(middle)
        press()
        assert interrupts.forget()

    interrupts.held(outer)
    assert done == ["outer", "inner"]


def test_insisting():
    interrupts.heed()
    calls = []

    def work():
        calls.append(1)
        if len(calls) == 1:
            press()
        return len(calls)

    assert interrupts.held(interrupts.insist, work) == (2, True)
    assert interrupts.held(interrupts.insist, work, True) == (3, True)
    assert interrupts.held(interrupts.insist, work) == (4, False)
    calls.clear()
    with pytest.raises(KeyboardInterrupt):
        interrupts.held(interrupts.insist, work, True)


def test_a_fit_that_is_interrupted_at_once_gives_its_start(loaded):
    target = wt.render(loaded)
    start = loaded.replace({CENTER: [0.1, 0, 0]})
    result = interrupts.held(lambda: press() or wt.fit(start, target, wrt=[CENTER], spp=1))
    assert result.stopped == "interrupted"
    np.testing.assert_allclose(result.parameters[CENTER], [0.1, 0, 0], rtol=1e-6)
    assert [step.loss for step in result.history] == [result.loss]


# Signals at random moments, as a terminal sends them
SIGNALS = """
import gc, os, queue, random, signal, sys, threading, time
import drjit as dr
import numpy as np
import whitted as wt

scene, name = wt.load_scene(sys.argv[1]), "spheres.ball.center"
moved = scene.replace({name: [0.1, 0, 0]})
target, draw = wt.render(moved), random.Random(1)

def backward():
    values = scene.parameters(name)
    dr.enable_grad(values)
    dr.backward(dr.mean(dr.square(wt.render(scene.replace(values)) - target)))
    return dr.grad(values[name]).numpy()

def fit():
    return wt.fit(
        scene, target, wrt=[name], method=method, spp=1, iterations=10**6, tolerance=0, levels=1,
        budget=None,
    )

calls = {
    "render": lambda: wt.render(scene).numpy(),
    "gradient": lambda: wt.gradient(scene, name, "x").numpy(),
    "backward": backward,
}
expected = {what: call() for what, call in calls.items()}

wanted, sent = queue.SimpleQueue(), queue.SimpleQueue()

def press():
    while True:
        time.sleep(wanted.get())
        sent.put(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=press, daemon=True).start()

def interrupted(call, within, presses=1):
    found = None
    try:
        for _ in range(presses):
            wanted.put(draw.uniform(0, within))
        found = call()
        delay = time.perf_counter() - sent.get()
        # A second one may still come
        time.sleep((presses - 1) * (within + 0.1))
    except KeyboardInterrupt:
        delay = time.perf_counter() - sent.get()
        try:
            time.sleep((presses - 1) * (within + 0.1))
        except KeyboardInterrupt:
            pass
    while not sent.empty():
        sent.get()
    return found, delay

def forever(call):
    while True: call()

for what, call in calls.items():
    start = time.perf_counter()
    call()
    once = time.perf_counter() - start
    for k in range(20):
        found, delay = interrupted(lambda: forever(call), 3 * once)
        assert delay < 0.5, delay
        assert gc.isenabled()
    for what, call in calls.items():
        np.testing.assert_allclose(call(), expected[what], rtol=1e-4, atol=1e-6)

for method in ("lm", "adam"):
    for k in range(8):
        found, delay = interrupted(fit, 0.1)
        assert delay < 0.5, delay
        assert found.stopped == "interrupted", found.stopped
        assert found.history
    # A second one may come while the result is being made
    for k in range(6):
        found, delay = interrupted(fit, 0.05, presses=2)
        assert found is None or found.stopped == "interrupted"
for what, call in calls.items():
    np.testing.assert_allclose(call(), expected[what], rtol=1e-4, atol=1e-6)
"""

COMMAND = """
import os, signal, sys, threading
from pathlib import Path
import whitted as wt
from whitted import cli
from whitted.inverse import report
from whitted.inverse.loss import Objective

scene, folder = sys.argv[1], Path(sys.argv[2])
moved = wt.load_scene(scene).replace({"spheres.ball.center": [0.2, 0, 0]})
wt.write_image(folder / "target.exr", wt.render(moved))
signal.signal(signal.SIGINT, signal.default_int_handler)
write = report.write_image

def press(*_):
    report.write_image = write
    os.kill(os.getpid(), signal.SIGINT)
    write(*_)

def press_soon(step):
    # From step to step, however fast they are
    def gradient(*arguments):
        steps.append(step)
        if len(steps) == step:
            threading.Timer(0.003, os.kill, (os.getpid(), signal.SIGINT)).start()
        return own(*arguments)
    steps.clear()
    Objective.gradient = gradient

own, steps = Objective.gradient, []
# While it searches, and while it writes files
for moment in (1, 5, None):
    out = folder / f"out {moment}"
    names = "--wrt", "spheres.ball.center", "--method", "adam", "--spp", "1", "--once"
    sys.argv = ["whitted", "fit", scene, str(folder / "target.exr"), *names, "-o", str(out)]
    if moment is None:
        sys.argv += ["--iterations", "1"]
        Objective.gradient = own
        report.write_image = press
    else:
        sys.argv += ["--iterations", "1000000"]
        press_soon(moment)
    try:
        cli.main()
    except SystemExit as end:
        assert end.code == 130, end.code
    assert len(list(out.iterdir())) == 7
    wt.load_scene(out / "scene.toml")
"""

THREADS = """
import sys, threading, time
import drjit as dr
import numpy as np
import whitted as wt

# Python passes on from thread to thread wherever it may
sys.setswitchinterval(1e-6)
scene, name = wt.load_scene(sys.argv[1]), "spheres.ball.center"
target = wt.render(scene.replace({name: [0.1, 0, 0]}))

def backward():
    values = scene.parameters(name)
    dr.enable_grad(values)
    dr.backward(dr.mean(dr.square(wt.render(scene.replace(values)) - target)))
    return dr.grad(values[name]).numpy()

calls = [
    backward,
    lambda: wt.gradient(scene, name, "x").numpy(),
    lambda: wt.fit(
        scene, target, wrt=[name], spp=1, iterations=1, levels=1, budget=None
    ).history[-1].x,
]
expected = [call() for call in calls]
end, counts, errors = time.monotonic() + 5, [0] * 4, []

def work(k):
    try:
        while time.monotonic() < end:
            which = (counts[k] + k) % len(calls)
            np.testing.assert_allclose(calls[which](), expected[which], rtol=1e-3, atol=1e-5)
            counts[k] += 1
    except BaseException as error:
        errors.append(error)

threads = [threading.Thread(target=work, args=[k]) for k in range(4)]
for thread in threads: thread.start()
for thread in threads: thread.join()
assert not errors, errors
assert min(counts) > 5, counts
"""


@pytest.mark.parametrize("script", [SIGNALS, COMMAND, THREADS], ids=["calls", "command", "threads"])
def test_in_a_process_of_its_own(load, tmp_path, script):
    """Threads that wait for each other would hang this one."""
    load(TEXT, "single")
    command = [sys.executable, "-c", script, str(tmp_path / "scene.toml"), str(tmp_path)]
    heed = lambda: signal.signal(signal.SIGINT, signal.default_int_handler)  # noqa: E731
    done = subprocess.run(command, preexec_fn=heed, timeout=100, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
