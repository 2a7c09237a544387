"""The page of `whitted view` in Chromium: how fast it is, and the pictures of it in results/.

./setup browser && .venv/bin/python benchmarks/view.py speed
.venv/bin/python benchmarks/view.py pictures
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
CENTER = "spheres.ball.center"
# Places of the Cornell box, in parts of the picture, and seconds that anything may take
BALL, PATIENCE = (0.6, 0.75), 60
# The mouse crosses a part of the picture in so many moves, one each 16 ms, as a browser has them.
# Where it is tells which move a frame shows
MOVES = 250
DRAG = """async moves => {
  const cover = document.querySelector(".cover"), box = cover.getBoundingClientRect();
  const wait = (time) => new Promise((done) => setTimeout(done, time));
  const fire = (type, x) => cover.dispatchEvent(new PointerEvent(type, { pointerId: 1,
    bubbles: true, button: 0, clientX: box.left + x, clientY: box.top + 0.75 * box.height }));
  cover.setPointerCapture = () => {};
  const sent = [], frames = [];
  let last = whitted.shown, open = true;
  const watch = () => {
    if (whitted.shown !== last && whitted.shown.values["spheres.ball.center"]) {
      last = whitted.shown;
      frames.push([performance.now(), last.values["spheres.ball.center"][0],
        last.milliseconds]);
    }
    if (open) setTimeout(watch, 0);
  };
  const x = (k) => (0.4 + (0.4 * k) / moves) * box.width;
  fire("pointerdown", x(0.5 * moves));
  await wait(500);
  watch();
  const start = performance.now();
  for (let k = 0; k <= moves; k++) {
    await wait(Math.max(0, start + 16 * k - performance.now()));
    sent.push(performance.now());
    fire("pointermove", x(k));
  }
  const end = performance.now();
  await wait(1500);
  open = false;
  fire("pointerup", x(moves));
  return { sent, frames, start, end };
}"""


@contextmanager
def served(scene: str) -> Iterator[Any]:
    """A page of a scene in a browser without a screen, once its first pictures are there."""
    from playwright.sync_api import sync_playwright

    command = [sys.executable, "-m", "whitted", "view", scene, "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert server.stdout
    found = re.search(r"http://\S+", server.stdout.readline())
    assert found
    try:
        with sync_playwright() as running:
            options = ["--no-sandbox"] if os.geteuid() == 0 else []
            browser = running.chromium.launch(
                executable_path=shutil.which("chromium"), args=options
            )
            page = browser.new_page(viewport={"width": 1000, "height": 780})
            page.goto(found[0])
            rested(page)
            yield page
            browser.close()
    finally:
        server.send_signal(signal.SIGINT)
        server.wait()


def until(page: Any, expression: str) -> None:
    """Wait until something that the page knows is true."""
    end = time.monotonic() + PATIENCE
    while not page.evaluate(f"!!(window.whitted && ({expression}))"):
        if time.monotonic() > end:
            raise TimeoutError(expression)
        time.sleep(0.02)


def rested(page: Any) -> None:
    until(page, "whitted.shown && !whitted.shown.moving")


def speed() -> None:
    """Print frames a second, and the time from the mouse to the picture."""
    with served("cornell") as page:
        print(f"Cornell box, 512 x 512, depth 8; load {os.getloadavg()[0]:.1f}")
        for title, edges in (("plain", False), ("with edges", True)):
            page.locator("[data-look=moving]").set_checked(edges)
            page.wait_for_timeout(1000)
            page.evaluate(DRAG, 20)
            rested(page)
            told = page.evaluate(DRAG, MOVES)
            rates, waits, drawn = measured(told)
            print(
                f"{title}: {rates:.0f} frames a second, from mouse to picture "
                f"{np.median(waits):.0f} ms at the median, {np.percentile(waits, 95):.0f} ms at "
                f"the 95th percentile; a frame takes the server {drawn:.0f} ms"
            )
            page.get_by_role("button", name="reset", exact=True).click()
            rested(page)


def measured(told: dict[str, Any]) -> tuple[float, np.ndarray, float]:
    """Frames a second, milliseconds from each frame's last move to the frame, and the server's."""
    times, x, drawn = (np.array(part, float) for part in zip(*told["frames"], strict=True))
    sent = np.array(told["sent"])
    # The last frame shows the last move; the ball goes as far in each move
    moves = np.rint((x - x.min()) / (x[-1] - x.min()) * (len(sent) - 1)).astype(int)
    within = (times > told["start"]) & (times <= told["end"])
    waits = (times - sent[np.clip(moves, 0, len(sent) - 1)])[within]
    return (
        1e3 * within.sum() / (told["end"] - told["start"]),
        waits,
        float(np.median(drawn[within])),
    )


def pictures() -> None:
    """Write the pictures of the page that the documentation shows."""
    with served("cornell") as page:
        drag(page, BALL, (0.75, 0.55))
        shot(page, "view_page")
        choose_derivative(page)
        shot(page, "view_derivative")
    with served("cornell") as page:
        recover(page)
        shot(page, "view_fit")


def choose_derivative(page: Any) -> None:
    page.locator(".derivative select").nth(0).select_option(f"{CENTER} x")
    until(page, "whitted.shown.derivative")
    rested(page)


def recover(page: Any) -> None:
    """Make the picture a target, move the ball, and fit it."""
    page.get_by_role("button", name="the picture now").click()
    until(page, "whitted.target")
    drag(page, BALL, (0.62, 0.72))
    page.locator(f'.tick[title="fit {CENTER}"]').check()
    page.locator('.tick[title="fit spheres.ball.radius"]').check()
    page.get_by_role("button", name="start", exact=True).click()
    until(page, "whitted.found")
    page.wait_for_timeout(1500)


def drag(page: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    box = page.locator(".cover").bounding_box()
    places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in (start, end)]
    page.mouse.move(*places[0])
    page.mouse.down()
    page.mouse.move(*places[1], steps=10)
    page.mouse.up()
    until(page, "whitted.shown.undo")
    rested(page)


def shot(page: Any, name: str) -> None:
    path = RESULTS / f"{name}.png"
    page.screenshot(path=path)
    print(f"wrote {path}")


if __name__ == "__main__":
    {"speed": speed, "pictures": pictures}[sys.argv[1]]()
