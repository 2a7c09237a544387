"""The page in a real browser: Chromium without a screen, driven by Playwright."""

import os
import shutil
import signal
import time
from base64 import b64encode
from pathlib import Path

import pytest
from test_view_server import started
from view_scene import TEXT

import whitted as wt

playwright = pytest.importorskip(
    "playwright.sync_api", reason="needs Playwright: ./setup test,browser"
)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: ./setup test,browser")
# Seconds that anything may take: kernels are compiled, and others may use the machine
PATIENCE = 60
CENTER = "spheres.ball.center"
# For a test to break the line
KEEP_SOCKETS = (
    "window.sockets = []; const Own = WebSocket; window.WebSocket = class extends Own "
    "{ constructor(address) { super(address); sockets.push(this); } };"
)
# The colours of all pixels of the picture
COLORS = (
    "(canvas => { const d = canvas.getContext('2d').getImageData(0, 0, canvas.width, "
    "canvas.height).data; return Array.from({length: d.length / 4}, (_, k) => "
    "[d[4 * k], d[4 * k + 1], d[4 * k + 2]]); })(document.querySelector('canvas.picture'))"
)
AT_BALL, AT_LAMP = (0.638, 0.5), (0.5, 0.0976)


@pytest.fixture(scope="module")
def chromium():
    with playwright.sync_playwright() as running:
        options = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = running.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()


class Page:
    """A page of the browser, and what its script knows."""

    def __init__(self, browser, address):
        self.tab = browser.new_page(viewport={"width": 1200, "height": 800})
        self.errors = []
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.add_init_script(KEEP_SOCKETS)
        self.tab.goto(address)

    def state(self, expression):
        return self.tab.evaluate(f"window.whitted && whitted.{expression}")

    def until(self, expression):
        """Wait until something that the page knows is true."""
        end = time.monotonic() + PATIENCE
        while not self.tab.evaluate(f"!!(window.whitted && ({expression}))"):
            assert time.monotonic() < end, (expression, self.errors, self.status())
            time.sleep(0.02)

    def values(self):
        return self.state("shown.values")

    def status(self):
        return self.tab.locator(".status").inner_text()

    def rested(self):
        self.until("whitted.shown && !whitted.shown.moving")

    def place(self, x, y):
        """The place of the window where a place of the picture is."""
        box = self.tab.locator(".cover").bounding_box()
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def drag(self, start, *places, button="left"):
        mouse = self.tab.mouse
        mouse.move(*self.place(*start))
        mouse.down(button=button)
        for place in places:
            mouse.move(*self.place(*place), steps=4)
        mouse.up(button=button)

    def number(self, name, k=0):
        return self.tab.locator(f'.number[data-name="{name}{k}"]')

    def open(self, thing):
        group = self.tab.locator(f'details[data-name="{thing}"]')
        if not group.evaluate("group => group.open"):
            group.locator("summary").click()

    def press(self, name):
        self.tab.get_by_role("button", name=name, exact=True).click()


def ended(process):
    """End a server as Ctrl-C does."""
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=20)
    assert told == ""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    (folder / "scene.toml").write_text(TEXT)
    return folder


@pytest.fixture(scope="module")
def address(folder):
    process, address = started(folder / "scene.toml")
    yield address
    ended(process)


@pytest.fixture
def page(chromium, address):
    """A page of the scene as the file has it."""
    page = Page(chromium, address)
    page.rested()
    page.press("reset")
    page.until("Object.keys(whitted.shown.values).length === 0")
    yield page
    page.tab.close()
    assert page.errors == []


def test_drag_slider_undo_and_save(page, folder):
    """One visit: what it begins with, each step, and the file that it ends with."""
    page.drag(AT_BALL, (0.5, 0.4), (0.45, 0.3))
    page.until("whitted.shown.undo && whitted.shown.picked === 'spheres.ball'")
    page.rested()
    dragged = page.values()[CENTER]
    assert dragged[0] < 0.3
    assert dragged[1] > 0.2
    assert dragged[2] == pytest.approx(0.5)
    # The number beside the picture is the same
    assert float(page.number(CENTER).input_value()) == pytest.approx(dragged[0], rel=1e-5)

    # The wheel, over what is picked
    page.tab.mouse.wheel(0, -200)
    page.until("whitted.shown.values['spheres.ball.radius']")
    assert page.values()["spheres.ball.radius"][0] > 0.4
    page.tab.wait_for_timeout(600)

    # A slider by the keyboard, and a number
    page.open("materials.red")
    slider = page.tab.locator('input[type=range][data-name="materials.red.color1"]')
    slider.focus()
    slider.press("ArrowRight")
    page.until("whitted.shown.values['materials.red.color']")
    page.number("materials.red.color", 2).fill("0.9")
    page.number("materials.red.color", 2).press("Enter")
    page.until("Math.abs(whitted.shown.values['materials.red.color'][2] - 0.9) < 1e-6")

    # A number out of range is refused, and the old one comes back
    page.number("materials.red.color", 2).fill("7")
    page.number("materials.red.color", 2).press("Enter")
    page.until("whitted.refused.length > 0")
    assert "expected three numbers in [0, 1]" in page.status()
    assert float(page.number("materials.red.color", 2).input_value()) == pytest.approx(0.9)

    # So is what is no number
    page.number("materials.red.color", 2).fill("")
    page.number("materials.red.color", 2).press("Enter")
    assert page.status() == "materials.red.color: expected a number, got ''"
    assert float(page.number("materials.red.color", 2).input_value()) == pytest.approx(0.9)

    # Back to the drag, and forth
    page.press("undo")
    page.until("Math.abs(whitted.shown.values['materials.red.color'][2] - 0.1) < 1e-6")
    page.press("redo")
    page.until("Math.abs(whitted.shown.values['materials.red.color'][2] - 0.9) < 1e-6")

    # The file is there: saving again replaces it, with its comments
    page.press("save")
    page.until("document.querySelector('.status').textContent.includes('is there already')")
    page.press("save")
    page.until("document.querySelector('.status').textContent === 'saved scene.toml'")
    saved = folder / "scene.toml"
    assert "# before the mirror" in saved.read_text()
    kept = wt.load_scene(saved).numbers
    assert {name: list(kept[name]) for name in page.values()} == page.values()
    page.press("reset")
    page.until("Object.keys(whitted.shown.values).length === 0")


def test_lamp_camera_and_filter(page):
    page.drag(AT_LAMP, (0.3, 0.2))
    page.until("whitted.shown.values['lights.lamp.position']")
    assert page.state("shown.picked") == "lights.lamp"
    page.press("undo")
    page.drag((0.5, 0.5), (0.6, 0.5), button="right")
    page.until("whitted.shown.values['camera.position']")
    assert page.values()["camera.position"][0] < 0
    page.open("discs.mirror")
    page.until("whitted.shown.picked === 'discs.mirror'")
    page.tab.locator(".cover").press("Escape")
    page.until("whitted.shown.picked === null")
    shown = "details.group:visible"
    everything = page.tab.locator(shown).count()
    page.tab.locator(".filter").fill("mirror ref")
    assert page.tab.locator(shown).count() == 1
    assert page.tab.locator(".row:visible").all_inner_texts()[0].startswith("reflection")
    page.tab.locator(".filter").fill("")
    assert page.tab.locator(shown).count() == everything


def test_derivative_over_and_beside_the_picture(page):
    page.open("spheres.ball")
    page.tab.locator(".row", has_text="center").get_by_text("d/d").first.click()
    page.until("whitted.shown.derivative?.name === 'spheres.ball.center'")
    page.rested()
    assert page.state("shown.derivative.component") == "x"
    red, blue = (
        f"[...{COLORS}].some(([r, g, b]) => {test})" for test in ("r > b + 60", "b > r + 60")
    )
    assert page.tab.evaluate(red)
    assert page.tab.evaluate(blue)
    page.tab.locator(".derivative select").nth(2).select_option("beside")
    page.until("whitted.shown.derivative.shown === 'beside'")
    page.until("!document.querySelector('canvas.beside').hidden")
    page.tab.locator(".derivative select").nth(1).select_option("boundary")
    page.until("whitted.shown.derivative.terms === 'boundary'")
    # It follows a drag
    page.drag(AT_BALL, (0.5, 0.4))
    page.until("whitted.shown.values['spheres.ball.center'] && whitted.shown.scales.derivative")


def test_fit_from_start_to_end(page):
    """The picture is the target; then the ball is moved, and found again."""
    page.press("the picture now")
    page.until("whitted.target")
    page.drag(AT_BALL, (0.6, 0.46))
    page.until("whitted.shown.values['spheres.ball.center']")
    moved = page.values()[CENTER]
    page.tab.locator('.tick[title="fit spheres.ball.center"]').check()
    page.press("start")
    page.until("whitted.fitting")
    # While it runs the scene is its own
    page.tab.keyboard.press("Control+z")
    page.until("whitted.refused.length > 0 || whitted.found")
    page.until("whitted.found")
    found = {label: (value, deviation) for label, value, deviation in page.state("found")}
    for axis, true in zip("xyz", (0.6, 0, 0.5), strict=True):
        value, deviation = found[f"{CENTER}.{axis}"]
        assert value == pytest.approx(true, abs=2e-3)
        assert deviation < 0.01
    assert moved != pytest.approx([0.6, 0, 0.5], abs=0.02)
    page.until("Math.abs(whitted.shown.values['spheres.ball.center'][0] - 0.6) < 2e-3")
    assert page.tab.locator(".found tr").count() == 3
    # It can be taken back
    page.press("undo")
    page.until("Math.abs(whitted.shown.values['spheres.ball.center'][0] - 0.6) > 0.02")


def test_targets_from_files(page, tmp_path):
    """Chosen, dropped, refused by the page and by the server."""
    wt.write_image(tmp_path / "t.exr", wt.render(wt.parse_scene(TEXT), resolution=(30, 20)))
    page.press("start")
    assert page.status() == "fit: tick the parameters to find, below"
    page.tab.set_input_files("input[type=file]", tmp_path / "t.exr")
    page.until("whitted.target && whitted.target[0] === 30 && whitted.shown.look.size[0] === 30")
    page.until("!document.querySelector('canvas.difference').hidden")
    page.press("none")
    page.until("whitted.target === null")
    drop = """([size, name]) => { const data = new DataTransfer();
        data.items.add(new File([new Uint8Array(size)], name));
        dispatchEvent(new DragEvent("drop", { dataTransfer: data })); }"""
    page.tab.evaluate(drop, [8, "a.png"])
    page.until("whitted.refused.length > 0")
    assert "a.png: not a readable PNG" in page.status()
    page.tab.evaluate(drop, [(64 << 20) + 1, "b.png"])
    assert page.status() == "b.png: more than 64 MiB; scale the picture"
    page.tab.locator("[data-look=width]").fill("48")
    page.tab.locator("[data-look=height]").fill("32")
    page.tab.locator("[data-look=height]").press("Enter")
    page.until("whitted.shown.look.size[0] === 48")


def test_second_tab_waits_for_the_first(page, chromium):
    second = Page(chromium, page.tab.url)
    second.until("document.querySelector('.status').textContent.includes('another page is open')")
    page.tab.goto("about:blank")
    second.rested()
    second.tab.close()


def test_broken_line_comes_back(page):
    """The page says that the line broke; then it shows the scene as it was."""
    page.open("spheres.ball")
    page.number("spheres.ball.radius").fill("0.3")
    page.number("spheres.ball.radius").press("Enter")
    page.until("whitted.shown.values['spheres.ball.radius']")
    page.tab.evaluate("sockets.at(-1).close()")
    page.until("document.querySelector('.status').textContent.startsWith('the connection broke')")
    assert not page.state("connected")
    page.until("whitted.connected")
    page.rested()
    assert page.values()["spheres.ball.radius"] == [pytest.approx(0.3)]
    assert page.number("spheres.ball.radius").input_value() == "0.3"


def test_server_that_fails_comes_back_with_its_numbers(chromium, tmp_path):
    (tmp_path / "scene.toml").write_text(TEXT)
    process, address = started(tmp_path / "scene.toml")
    page = Page(chromium, address)
    page.rested()
    page.open("spheres.ball")
    page.number("spheres.ball.radius").fill("0.3")
    page.number("spheres.ball.radius").press("Enter")
    page.until("whitted.shown.values['spheres.ball.radius']")
    session = page.state("scene.session")
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    # Python's own helper of processes is one as well
    servers = [
        pid for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    (server,) = map(int, servers)
    os.kill(server, signal.SIGABRT)
    page.until("!whitted.connected")
    page.until(f"whitted.connected && whitted.scene.session !== '{session}'")
    page.until("whitted.shown.values['spheres.ball.radius'] && whitted.shown.undo")
    page.tab.close()
    assert page.errors == []
    process.send_signal(signal.SIGINT)
    told, errors = process.communicate(timeout=20)
    assert told.splitlines()[-1] == "the server has ended (status -6); it is started again"
    assert errors == ""


def test_server_is_killed_and_started_again(chromium, folder):
    """The page says so, and knows a new server, whose address has another token."""
    process, address = started(folder / "scene.toml")
    page = Page(chromium, address)
    page.rested()
    process.kill()
    process.communicate(timeout=20)
    page.until("!whitted.connected")
    page.until("document.querySelector('.status').textContent.includes('whitted has ended')")
    page.tab.set_input_files("input[type=file]", folder / "scene.toml")
    page.until("document.querySelector('.status').textContent.endsWith('there is no connection')")
    again, other = started(folder / "scene.toml", "--port", address.split(":")[2].split("/")[0])
    try:
        page.until("document.querySelector('.status').textContent.includes('open the address')")
        page.tab.goto(other)
        page.rested()
    finally:
        page.tab.close()
        ended(again)
    assert page.errors == []


# A notebook as far as the widget sees it: a model that sends to Python, and gets what comes back
NOTEBOOK = """async text => {
  const module = await import(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
  const handlers = [];
  const bytes = (data) => new DataView(Uint8Array.from(atob(data), (c) => c.charCodeAt(0)).buffer);
  const model = {
    on: (_, handler) => handlers.push(handler),
    off: () => {},
    send: async (message) => {
      for (const [told, buffers] of await toPython(message)) {
        handlers.forEach((handler) => handler(told, buffers.map(bytes)));
      }
    },
  };
  const el = document.body.appendChild(document.createElement("div"));
  module.default.render({ model, el });
  window.whitted = el.whitted;
}"""


def test_widget_of_a_notebook(chromium):
    """The script that notebooks get, and the Python object behind it."""
    pytest.importorskip("anywidget", reason="needs anywidget: pip install 'whitted[notebook]'")
    view, sent = wt.view(wt.parse_scene(TEXT)), []

    def send(told, buffers=()):
        sent.append([told, [b64encode(data).decode() for data in buffers]])

    def to_python(message):
        sent.clear()
        view._handle_custom_msg(message, [])
        return list(sent)

    view.send = send
    page = Page(chromium, "about:blank")
    page.tab.expose_function("toPython", to_python)
    page.tab.evaluate(NOTEBOOK, view._esm)
    page.tab.add_style_tag(content=view._css)
    page.rested()
    page.drag(AT_BALL, (0.5, 0.4), (0.45, 0.3))
    page.until("whitted.shown.undo")
    page.rested()
    assert view.scene.numbers[CENTER][0] == pytest.approx(page.values()[CENTER][0])
    assert view.scene.numbers[CENTER][1] > 0.2
    page.press("undo")
    page.until("Object.keys(whitted.shown.values).length === 0")
    assert view.scene == wt.parse_scene(TEXT)
    # What needs the server is not there
    assert page.tab.get_by_role("button", name="save").count() == 0
    assert page.tab.locator(".fit").count() == 0
    assert page.errors == []
    page.tab.close()
