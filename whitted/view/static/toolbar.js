// The toolbar: history, saving, and how pictures are made.

import { choice, labelled, make } from "./dom.js";

const SAMPLES = [1, 4, 9, 16, 25, 36, 64, 100, 144, 256];

export function toolbar(app) {
  const button = (text, kind, title) =>
    make("button", { title, onclick: () => app.send({ kind }) }, text);
  const undo = button("undo", "undo", "Ctrl-Z");
  const redo = button("redo", "redo", "Ctrl-Shift-Z, Ctrl-Y");
  const reset = button("reset", "reset", "the scene as it was opened; undo takes this back");
  const mouse = choice([["objects", "objects"], ["camera", "camera"]], {
    title: "what the left button moves; the right button turns the camera, the middle one pans it",
    onchange: () => (app.state.mouse = mouse.value),
  });
  const look = lookOf(app);
  const speed = make("span", { className: "speed" });
  app.on("frame", (frame) => {
    undo.disabled = !frame.undo;
    redo.disabled = !frame.redo;
    look.show(frame.look);
    speed.textContent = speedOf(app, frame);
  });
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || !app.options.page) return;
    if (event.target.matches?.("input[type=number], input[type=search], input[type=text]")) return;
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    event.preventDefault();
    app.send({ kind: key === "y" || event.shiftKey ? "redo" : "undo" });
  });
  const parts = [undo, redo, reset, labelled("mouse moves", mouse), ...look.parts, speed];
  if (app.options.page) parts.splice(3, 0, ...saving(app));
  return make("div", { className: "toolbar" }, ...parts);
}

/** How pictures are made: every change sends all of it. */
function lookOf(app) {
  const changed = () => app.send(asked());
  const number = (low, high) =>
    make("input", { type: "number", min: low, max: high, className: "small", onchange: changed });
  const check = () => make("input", { type: "checkbox", onchange: changed });
  const width = number(1, 4096);
  const height = number(1, 4096);
  const depth = number(1, 256);
  const spp = choice(SAMPLES.map((n) => [n, n]), { onchange: changed });
  const [edges, moving, outline, labels] = [check(), check(), check(), check()];
  const asked = () => ({
    kind: "look", size: [Number(width.value), Number(height.value)], spp: Number(spp.value),
    edges: edges.checked, moving_edges: moving.checked, depth: Number(depth.value),
    outline: outline.checked, labels: labels.checked,
  });
  const named = { width, height, depth, spp, edges, moving, outline, labels };
  for (const [name, control] of Object.entries(named)) control.dataset.look = name;
  function show(look) {
    [width.value, height.value] = look.size;
    depth.value = look.depth;
    spp.value = look.spp;
    edges.checked = look.edges;
    moving.checked = look.moving_edges;
    outline.checked = look.outline;
    labels.checked = look.labels;
  }
  const parts = [
    make("span", {}, "size ", width, " x ", height),
    labelled("samples", spp, "a pixel, while nothing moves"),
    labelled("edges", edges, "find edges between samples, while nothing moves"),
    labelled("also moving", moving, "find edges between samples while something moves"),
    labelled("depth", depth, "rays on the longest chain"),
    labelled("outline", outline, "of what is picked"),
    labelled("labels", labels, "draw the edges between labels of samples over the picture"),
  ];
  return { parts: parts, show: (look) => document.activeElement?.dataset.look || show(look) };
}

/** Saving by name into the scene's folder. */
function saving(app) {
  const name = make("input", { type: "text", className: "name", title: ".toml, .png or .exr" });
  let again = "";
  const save = make("button", {
    title: "into the folder of the scene's file",
    onclick: () => app.send({ kind: "save", name: name.value, replace: again === name.value }),
  }, "save");
  app.on("scene", (scene) => (name.value ||= scene.name));
  app.on("there", (reply) => {
    again = reply.name;
    app.tell(reply.text, "refused");
  });
  app.on("saved", () => (again = ""));
  name.addEventListener("input", () => (again = ""));
  return [name, save];
}

/** Frames a second of the last half second, and the time of the last one on the server. */
function speedOf(app, frame) {
  const since = performance.now() - 500;
  const count = (app.state.times ?? []).filter((time) => time > since).length;
  const rate = frame.moving && count > 2 ? `${2 * count} a second, ` : "";
  return `${rate}${frame.milliseconds.toFixed(0)} ms`;
}
