// The app in a cell of a notebook: a widget, whose model is in Python.

import { mount } from "./app.js";

function render({ model, el }) {
  let handle = () => {};
  const receive = (message, buffers) => handle(withBlobs(message, buffers));
  const link = {
    // Python does not wait to hear that a frame was shown
    send: (message) => message.kind === "shown" || model.send(message),
    receive(handler) {
      handle = handler;
      handler({ kind: "connected" });
    },
  };
  model.on("msg:custom", receive);
  const app = mount(el, link, { page: false });
  el.whitted = app.state;
  return () => model.off("msg:custom", receive);
}

/** A frame has the names of its pictures, which come as buffers. */
function withBlobs(message, buffers) {
  if (message.kind !== "frame") return message;
  const pairs = message.pictures.map((name, k) => [name, new Blob([buffers[k]], { type: "image/jpeg" })]);
  return { ...message, blobs: Object.fromEntries(pairs) };
}

export default { render };
