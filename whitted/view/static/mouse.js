// What the mouse does over the picture.

const QUIET = 400; // milliseconds without a turn of the wheel until its turns are kept
const STEP = 100; // of a wheel's delta

/** Follow the mouse over an element that covers the picture. */
export function follow(app, cover) {
  let held = null;
  let turned = 0;
  let keeping = 0;

  function place(event) {
    const box = cover.getBoundingClientRect();
    return { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height };
  }

  function down(event) {
    const light = event.target.closest?.(".light");
    const camera = event.button > 0 || app.state.mouse === "camera";
    const what = camera ? "camera" : light ? "light" : "shape";
    const at = place(event);
    if (at.x < 0 || at.x > 1 || at.y < 0 || at.y > 1) return;
    event.preventDefault();
    cover.focus({ preventScroll: true });
    cover.setPointerCapture(event.pointerId);
    held = { what, button: event.button };
    const name = what === "light" ? light.dataset.name : null;
    app.send({ kind: "grab", ...at, what, name, through: what === "shape" && event.altKey });
  }

  function move(event) {
    if (!held) return;
    const pan = held.button === 1 || (held.what === "camera" && event.shiftKey);
    const other = held.what === "camera" ? (pan ? "pan" : "turn") : "across";
    const how = held.what !== "camera" && event.shiftKey ? "along" : other;
    app.live({ kind: "drag", ...place(event), how });
  }

  function up() {
    if (held) app.send({ kind: "keep" });
    held = null;
  }

  function wheel(event) {
    event.preventDefault();
    if (!turned) requestAnimationFrame(() => send(event.ctrlKey || app.state.mouse === "camera"));
    turned -= event.deltaY / STEP;
  }

  function send(camera) {
    app.send({ kind: "wheel", steps: Math.max(-50, Math.min(50, turned)), camera });
    turned = 0;
    clearTimeout(keeping);
    keeping = setTimeout(() => app.send({ kind: "keep" }), QUIET);
  }

  cover.addEventListener("pointerdown", down);
  cover.addEventListener("pointermove", move);
  cover.addEventListener("pointerup", up);
  cover.addEventListener("pointercancel", up);
  cover.addEventListener("wheel", wheel, { passive: false });
  cover.addEventListener("contextmenu", (event) => event.preventDefault());
  cover.addEventListener("keydown", (event) => {
    if (event.key === "Escape") app.send({ kind: "select", name: null });
  });
}
