// The app: what is known, how it is told to its parts, and what the parts say to the server.

import { derivative } from "./derivative.js";
import { make } from "./dom.js";
import { fit } from "./fit.js";
import { panel } from "./panel.js";
import { picture } from "./picture.js";
import { toolbar } from "./toolbar.js";

const REST = 150; // milliseconds without a message until a better picture is asked for
const WINDOW = 2; // messages on the way, at most, of those that only say where the mouse is
const PATIENCE = 500; // milliseconds after which one is taken for lost

/**
 * Build the app in an element.
 *
 * `link` has send(message) and receive(handler). Of the options, `page` adds what a notebook does
 * not have: saving and fitting; `token` is that of the address.
 */
export function mount(root, link, options) {
  const handlers = {};
  const state = { scene: null, frame: null, frames: 0, refused: [], connected: false };
  const status = make("p", { className: "status", role: "status" });
  let resting = 0;
  let waiting = null;
  let onWay = 0;
  let sentAt = 0;

  const app = { state, options, send, live, on, tell, values: (name) => valueOf(state, name) };
  app.acknowledge = () => link.send({ kind: "shown" });

  function on(kind, handler) {
    (handlers[kind] ??= []).push(handler);
  }

  function send(message) {
    flush();
    link.send(message);
    postpone();
  }

  /** Ask for a better picture later. */
  function postpone() {
    clearTimeout(resting);
    resting = setTimeout(() => link.send({ kind: "rest" }), REST);
  }

  /** Send a message of which only the last one counts; it may wait for the next frame. */
  function live(message) {
    if (onWay >= WINDOW && performance.now() - sentAt < PATIENCE) {
      waiting = message;
      postpone();
      return;
    }
    waiting = null;
    send(message);
    onWay += 1;
    sentAt = performance.now();
  }

  function flush() {
    const message = waiting;
    waiting = null;
    if (message) link.send(message);
  }

  function arrived() {
    onWay = 0;
    if (waiting) live(waiting);
  }

  function tell(text, kind = "note") {
    status.textContent = text;
    status.className = `status ${kind}`;
  }

  /** The scene is there. A server that was started again is told what had changed before. */
  function opened(scene) {
    const before = state.scene?.session !== scene.session && state.scene ? state.frame : null;
    state.scene = scene;
    if (!before) return;
    for (const [name, value] of Object.entries(before.values)) send({ kind: "set", name, value });
    send({ kind: "keep" });
    send({ kind: "look", ...before.look });
  }

  function receive(message) {
    if (message.kind === "frame" && state.scene && message.session !== state.scene.session) {
      // Of a new server, before it is known here
      app.acknowledge();
      return;
    }
    if (message.kind === "frame") {
      state.frame = message;
      state.frames += 1;
    }
    if (message.kind === "scene") opened(message);
    for (const handler of handlers[message.kind] ?? []) handler(message);
    if (message.kind === "frame" || message.kind === "refused") arrived();
  }

  on("connected", () => {
    state.connected = true;
    root.classList.remove("lost");
    tell("connected; the first picture is on its way");
    send({ kind: "open" });
  });
  on("lost", ({ text }) => {
    state.connected = false;
    root.classList.add("lost");
    tell(text, "refused");
  });
  on("refused", ({ text }) => {
    state.refused.push(text);
    tell(text, "refused");
  });
  on("working", () => tell("working: kernels are compiled, or the picture takes its time"));
  on("frame", () => status.classList.contains("note") && tell("", "idle"));
  on("saved", ({ text }) => tell(text, "done"));

  const side = make("div", { className: "side" }, derivative(app), panel(app));
  if (options.page) side.prepend(fit(app));
  const middle = make("div", { className: "middle" }, picture(app), side);
  root.classList.add("whitted");
  root.replaceChildren(toolbar(app), middle, status);
  link.receive(receive);
  return app;
}

/** The numbers of a parameter as the last frame shows it. */
function valueOf(state, name) {
  const known = state.frame?.values?.[name];
  return known ?? state.scene?.start?.get(name)?.value;
}
