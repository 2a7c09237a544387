// The derivative of the picture by a number: which one, which terms, and its scale.

import { choice, labelled, make, short } from "./dom.js";

const AXES = ["x", "y", "z"];

export function derivative(app) {
  const number = choice([["", "none"]], { onchange: () => ask(), className: "wide" });
  const terms = choice(
    [["both", "both terms"], ["interior", "interior"], ["boundary", "boundary"]],
    { onchange: () => ask(), title: "between edges, of moving edges, or their sum" });
  const shown = choice([["over", "over the picture"], ["beside", "beside it"]],
    { onchange: () => ask() });
  const scale = make("div", { className: "scale", hidden: true });

  function ask() {
    const [name, component] = number.value.split(" ");
    app.send({
      kind: "differentiate", name: name || null, component: component || null,
      terms: terms.value, shown: shown.value,
    });
  }
  app.differentiate = (name, component) => {
    const value = component ? `${name} ${component}` : name;
    // The same once more: none
    number.value = number.value === value ? "" : value;
    ask();
  };
  app.on("scene", (scene) => {
    const pairs = scene.groups.flatMap((group) => group.parameters).flatMap(({ name, value }) =>
      value.length === 1 ? [[name, name]] : AXES.map((axis) => [`${name} ${axis}`, `${name}.${axis}`]));
    const options = [["", "none"], ...pairs].map(([value, text]) => make("option", { value }, text));
    number.replaceChildren(...options);
  });
  app.on("frame", (frame) => {
    const asked = frame.derivative;
    scale.hidden = !asked;
    if (document.activeElement !== number) {
      number.value = asked ? [asked.name, asked.component].filter(Boolean).join(" ") : "";
    }
    if (asked) {
      const end = short(+frame.scales.derivative.toPrecision(3));
      scale.replaceChildren(make("span", {}, `-${end}`), make("span", {}, "0"), make("span", {}, end));
      terms.value = asked.terms;
      shown.value = asked.shown;
    }
  });
  return make("section", { className: "derivative" }, make("h2", {}, "Derivative"),
    labelled("d picture / d", number), make("div", {}, terms, " ", shown), scale);
}
