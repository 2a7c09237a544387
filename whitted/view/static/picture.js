// The picture in the middle, what lies over it, and pictures beside it.

import { make } from "./dom.js";
import { follow } from "./mouse.js";

const LIGHT = 7; // half the size of the sign of a light, in pixels

export function picture(app) {
  const canvas = make("canvas", { width: 512, height: 512, className: "picture" });
  const beside = make("canvas", { className: "beside", hidden: true, title: "the derivative" });
  const signs = make("div", { className: "signs" });
  const cover = make("div", { className: "cover", tabIndex: 0 }, signs);
  const stage = make("div", { className: "stage" }, canvas, cover);

  async function show(frame) {
    await draw(canvas, frame.blobs.picture);
    beside.hidden = !frame.blobs.derivative;
    if (frame.blobs.derivative) await draw(beside, frame.blobs.derivative);
    showLights(signs, frame);
    app.acknowledge();
    measure(app, frame);
  }
  // One after the other, in the order in which they came
  let last = Promise.resolve();
  app.on("frame", (frame) => (last = last.then(() => show(frame))));
  follow(app, cover);
  return make("div", { className: "pictures" }, stage, beside);
}

/** Draw a JPEG; the canvas takes its size. */
export async function draw(canvas, blob) {
  const bitmap = await createImageBitmap(blob);
  if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
    canvas.width = bitmap.width;
    canvas.height = bitmap.height;
  }
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
  bitmap.close();
}

function showLights(signs, frame) {
  const shown = frame.lights.map(({ name, x, y }) => {
    const sign = make("span", { className: "light", title: name });
    sign.dataset.name = name;
    sign.classList.toggle("picked", name === frame.picked);
    sign.style.left = `calc(${100 * x}% - ${LIGHT}px)`;
    sign.style.top = `calc(${100 * y}% - ${LIGHT}px)`;
    return sign;
  });
  // While the mouse holds one it stays the same element
  if (signs.children.length !== shown.length) signs.replaceChildren(...shown);
  shown.forEach((sign, k) => {
    const old = signs.children[k];
    if (old === sign) return;
    old.style.cssText = sign.style.cssText;
    old.className = sign.className;
    old.title = sign.title;
    old.dataset.name = sign.dataset.name;
  });
}

/** Keep when the last frames were drawn. */
function measure(app, frame) {
  const times = (app.state.times ??= []);
  times.push(performance.now());
  while (times.length > 200) times.shift();
  app.state.shown = frame;
}
