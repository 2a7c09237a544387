// The parameters: a slider and a number for each, grouped as in the file, filtered as one types.

import { make, short } from "./dom.js";

const AXES = ["x", "y", "z"];
const CHANNELS = ["red", "green", "blue"];
// Things that can be picked
const PLACED = /^(spheres|discs|planes|lights)\./;
const COLORS = ["color", "intensity", "irradiance", "background", "ambient"];

export function panel(app) {
  const filter = make("input", {
    type: "search", placeholder: "filter, as in ball or ior", className: "filter",
    oninput: () => narrow(),
  });
  const list = make("div", { className: "groups" });
  let groups = [];
  let known = "";

  app.on("scene", (scene) => {
    scene.start = startOf(scene);
    const text = JSON.stringify(scene.groups);
    // After a break of the line what is open stays open
    if (text === known) return;
    known = text;
    groups = scene.groups.map((group) => groupOf(app, group));
    list.replaceChildren(...groups.map((group) => group.element));
    narrow();
  });
  app.on("frame", (frame) => groups.forEach((group) => group.show(frame)));
  app.on("refused", () => groups.forEach((group) => group.refresh()));

  function narrow() {
    const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    groups.forEach((group) => group.narrow(words));
  }
  return make("section", { className: "panel" }, make("h2", {}, "Parameters"), filter, list);
}

/** All parameters of a scene, by name. */
function startOf(scene) {
  const all = scene.groups.flatMap((group) => group.parameters);
  return new Map(all.map((parameter) => [parameter.name, parameter]));
}

/** One thing of the scene. Its rows are made when it is opened, as there may be thousands. */
function groupOf(app, { name, parameters }) {
  const title = make("summary", { onclick: () => pick() }, name);
  const body = make("div");
  const element = make("details", { className: "group", ontoggle: () => open() }, title, body);
  element.dataset.name = name;
  let rows = [];
  let picked = false;

  function pick() {
    if (!element.open && PLACED.test(name)) app.send({ kind: "select", name });
  }
  function open() {
    if (!element.open || rows.length) return;
    rows = parameters.map((parameter) => rowOf(app, parameter));
    body.replaceChildren(...rows.map((row) => row.element));
    narrow(words);
  }
  let words = [];
  function narrow(given) {
    words = given;
    const has = (text) => words.every((word) => text.toLowerCase().includes(word));
    const found = parameters.filter((parameter) => has(parameter.name));
    element.hidden = found.length === 0;
    if (words.length) element.open = found.length > 0;
    open();
    rows.forEach((row) => (row.element.hidden = !has(row.name)));
  }
  return {
    element,
    narrow,
    show(frame) {
      if (frame.picked === name && !picked) {
        element.open = true;
        open();
        element.scrollIntoView({ block: "nearest" });
      }
      picked = frame.picked === name;
      element.classList.toggle("picked", picked);
      rows.forEach((row) => row.show());
    },
    refresh: () => rows.forEach((row) => row.show(true)),
  };
}

/** One parameter: for each of its numbers a slider, a box, and the choice of its derivative. */
function rowOf(app, parameter) {
  const { name, field, value, low, high, step } = parameter;
  const isColor = COLORS.some((word) => field.endsWith(word));
  const names = value.length === 1 ? [""] : isColor ? CHANNELS : AXES;
  let shown = [];
  let touched = false;

  function change(k, text, kept) {
    const number = Number(text);
    if (text === "" || !Number.isFinite(number)) {
      app.tell(`${name}: expected a number, got '${text}'`, "refused");
      show(true);
      return;
    }
    const numbers = [...app.values(name)];
    numbers[k] = number;
    shown[k] = number;
    boxes[k].value = short(number);
    sliders[k].value = number;
    (kept ? app.send : app.live)({ kind: "set", name, value: numbers });
    if (kept) app.send({ kind: "keep" });
  }
  function prepare() {
    if (!touched) app.send({ kind: "prepare", name });
    touched = true;
  }
  const sliders = value.map((_, k) =>
    make("input", {
      type: "range", min: low, max: high, step: "any", title: `${name} ${names[k]}`,
      onpointerdown: prepare, onfocus: prepare,
      oninput: (event) => change(k, event.target.value, false),
      onchange: () => app.send({ kind: "keep" }),
    }));
  const boxes = value.map((_, k) =>
    make("input", {
      type: "number", step, title: `${name} ${names[k]}`, className: "number",
      onchange: (event) => change(k, event.target.value, true),
    }));
  sliders.forEach((slider, k) => (slider.dataset.name = `${name}${k}`));
  boxes.forEach((box, k) => (box.dataset.name = `${name}${k}`));

  function show(always = false) {
    const now = app.values(name) ?? value;
    now.forEach((number, k) => {
      if (!always && number === shown[k]) return;
      if (!always && document.activeElement === boxes[k]) return;
      shown[k] = number;
      sliders[k].value = number;
      boxes[k].value = short(number);
    });
  }
  const lines = value.map((_, k) =>
    make("div", { className: "line" },
      make("span", { className: "axis" }, names[k]), sliders[k], boxes[k],
      make("button", {
        className: "by", title: `the picture's derivative by ${name} ${names[k]}`,
        onclick: () => app.differentiate(name, value.length === 1 ? null : AXES[k]),
      }, "d/d")));
  const head = [make("span", {}, field)];
  if (app.options.page) head.unshift(tick(app, name));
  show(true);
  return { element: make("div", { className: "row" }, make("label", {}, ...head), ...lines), name, show };
}

/** Whether a fit is to find the parameter. */
function tick(app, name) {
  return make("input", {
    type: "checkbox", className: "tick", title: `fit ${name}`, checked: app.ticked.has(name),
    onchange: (event) => app.tick(name, event.target.checked),
  });
}
