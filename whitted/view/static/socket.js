// The way to the server: a socket that comes back by itself.

const BUSY = 4409;
const AGAIN = 1000; // milliseconds until the next try

/** A link: `send(object)`, and `receive(handler)`, whose handler gets objects and frames. */
export function connect(token) {
  const address = `ws://${location.host}/socket?token=${encodeURIComponent(token)}`;
  let socket = null;
  let handle = () => {};

  function open() {
    socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => handle({ kind: "connected" });
    socket.onmessage = ({ data }) =>
      handle(typeof data === "string" ? JSON.parse(data) : unpacked(data));
    socket.onclose = (event) => lost(event);
  }

  async function lost(event) {
    handle({ kind: "lost", text: event.code === BUSY ? event.reason : await reason(token) });
    setTimeout(open, AGAIN);
  }

  return {
    send(message) {
      if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    },
    receive(handler) {
      handle = handler;
      open();
    },
  };
}

/** Why there is no connection, in words. */
async function reason(token) {
  try {
    const answer = await fetch(`/?token=${encodeURIComponent(token)}`, { method: "HEAD" });
    if (answer.status === 403) {
      return "whitted has been started again: open the address that it has printed";
    }
    return "the connection broke; trying again";
  } catch {
    return "whitted has ended, or is busy; start it again: whitted view SCENE";
  }
}

/** A frame: its header, with "blobs", the pictures by name. See `packed` in worker.py. */
function unpacked(data) {
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  let start = 4 + length;
  header.blobs = {};
  for (const [name, size] of header.pictures) {
    header.blobs[name] = new Blob([new Uint8Array(data, start, size)], { type: "image/jpeg" });
    start += size;
  }
  return header;
}
