// The page of a browser: the app on a socket.

import { mount } from "./app.js";
import { connect } from "./socket.js";

const query = new URLSearchParams(location.search);
const token = query.get("token") ?? "";
const app = mount(document.getElementById("app"), connect(token), { page: true, token });
// For tests: what the page knows
window.whitted = app.state;
