// Small helpers to make elements.

/** An element with properties, and with children: elements or texts. Texts are never markup. */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element) element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** A label with a control in it. */
export function labelled(text, control, title = "") {
  return make("label", { title }, `${text} `, control);
}

/** A list to choose from: pairs of a value and its text. */
export function choice(pairs, properties = {}) {
  const options = pairs.map(([value, text]) => make("option", { value }, text));
  return make("select", properties, ...options);
}

/** A number in a few digits. */
export function short(number) {
  if (number === 0 || !Number.isFinite(number)) return String(number);
  const size = Math.abs(number);
  return size >= 1e5 || size < 1e-4 ? number.toExponential(3) : String(+number.toPrecision(6));
}
