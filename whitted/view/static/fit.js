// A fit: its target, what it finds, and how it goes.

import { make, short } from "./dom.js";
import { draw } from "./picture.js";

const LARGEST = 64 << 20; // bytes of a file

export function fit(app) {
  app.ticked = new Set();
  const names = make("p", { className: "ticked" });
  const file = make("input", {
    type: "file", accept: ".exr,.png", onchange: () => file.files[0] && upload(app, file.files[0]),
  });
  const now = make("button", {
    title: "take the picture as it is now for the target",
    onclick: () => app.send({ kind: "target", source: "now" }),
  }, "the picture now");
  const none = make("button", { onclick: () => app.send({ kind: "target", source: "none" }) }, "none");
  const picture = make("img", { className: "target", alt: "the target", hidden: true });
  const difference = make("canvas", { className: "difference", hidden: true });
  const caption = make("p", { className: "caption", hidden: true });
  const curve = make("canvas", { className: "curve", width: 300, height: 90, hidden: true });
  const start = make("button", { className: "start", onclick: () => begin() }, "start");
  const stop = make("button", { className: "stop", onclick: () => app.send({ kind: "stop" }), disabled: true }, "stop");
  const told = make("p", { className: "told" });
  const table = make("table", { className: "found" });
  let losses = [];

  app.tick = (name, on) => {
    app.ticked[on ? "add" : "delete"](name);
    names.textContent = [...app.ticked].join(", ") || "tick parameters below";
  };
  app.tick("", false);

  function begin() {
    if (app.ticked.size === 0) return app.tell("fit: tick the parameters to find, below", "refused");
    app.send({ kind: "fit", wrt: [...app.ticked] });
  }
  function running(is) {
    start.disabled = is;
    stop.disabled = !is;
    app.state.fitting = is;
  }
  app.on("scene", (scene) => running(scene.fitting));
  app.on("target", ({ size, picture: data }) => {
    app.state.target = size;
    picture.hidden = difference.hidden = caption.hidden = !size;
    if (size) picture.src = `data:image/jpeg;base64,${data}`;
  });
  app.on("frame", ({ blobs, scales }) => {
    if (!blobs.difference) return;
    draw(difference, blobs.difference);
    caption.textContent = `picture - target; colours end at ${scales.difference.toPrecision(2)}`;
  });
  app.on("fitting", () => {
    losses = [];
    running(true);
    table.replaceChildren();
    told.textContent = "compiling";
  });
  app.on("step", (step) => {
    losses.push(step.loss);
    curve.hidden = false;
    plot(curve, losses);
    told.textContent = `iteration ${step.iteration}, ${step.size.join(" x ")}, loss ${short(step.loss)}`;
  });
  app.on("fitted", ({ numbers, summary, notes }) => {
    running(false);
    start.textContent = "continue";
    app.state.found = numbers;
    told.textContent = [summary, ...notes].join("; ");
    table.replaceChildren(...numbers.map(([label, value, deviation]) =>
      make("tr", {}, ...[label, short(value), `± ${deviation === null ? "unknown" : deviation.toPrecision(2)}`]
        .map((text) => make("td", {}, text)))));
  });
  app.on("failed", ({ error }) => {
    running(false);
    told.textContent = "";
    app.tell(error, "refused");
  });
  dropping(app);
  return make("section", { className: "fit" }, make("h2", {}, "Fit"),
    make("div", {}, "target: ", file, " ", now, " ", none),
    make("div", { className: "thumbs" }, picture, difference),
    caption,
    names, make("div", {}, start, " ", stop), told, curve, table);
}

async function upload(app, file) {
  if (file.size > LARGEST) {
    return app.tell(`${file.name}: more than ${LARGEST >> 20} MiB; scale the picture`, "refused");
  }
  const query = new URLSearchParams({ token: app.options.token, name: file.name });
  try {
    const answer = await fetch(`/target?${query}`, { method: "POST", body: file });
    if (!answer.ok) app.tell(await answer.text(), "refused");
  } catch {
    app.tell(`${file.name}: was not sent, as there is no connection`, "refused");
  }
}

/** A picture that is dropped anywhere on the page is the target. */
function dropping(app) {
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    const file = event.dataTransfer?.files[0];
    if (file) upload(app, file);
  });
}

/** The losses of all iterations, on a logarithmic scale. */
function plot(canvas, losses) {
  const context = canvas.getContext("2d");
  const logs = losses.map((loss) => Math.log10(Math.max(loss, 1e-30)));
  const [low, high] = [Math.min(...logs), Math.max(...logs)];
  const { width, height } = canvas;
  context.clearRect(0, 0, width, height);
  context.beginPath();
  logs.forEach((log, k) => {
    const x = 4 + (k / Math.max(1, logs.length - 1)) * (width - 8);
    context.lineTo(x, 14 + ((high - log) / (high - low || 1)) * (height - 28));
  });
  context.strokeStyle = "#2166ac";
  context.lineWidth = 1.5;
  context.stroke();
  context.fillStyle = "#555";
  context.fillText(`loss ${(10 ** high).toExponential(1)}`, 4, 10);
  context.fillText((10 ** low).toExponential(1), 4, height - 3);
}
