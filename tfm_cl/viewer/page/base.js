// Numbers, vectors, dotted keys, drawings, controls.

const SVG = "http://www.w3.org/2000/svg";

/** Few digits, without an exponent where that can be read. */
function number(value, digits = 4) {
  if (typeof value !== "number" || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e-4 || size >= 1e7) return value.toExponential(2).replace(/\.?0+e/, "e").replace("e+", "e");
  return String(Number(value.toPrecision(digits)));
}

/** As a scene file should have it: no digits that nobody asked for. */
const rounded = (value) => (Array.isArray(value) ? value.map(rounded) : Number(value.toPrecision(6)));

function duration(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  return seconds < 1 ? `${number(1000 * seconds, seconds < 0.01 ? 2 : 3)} ms` : `${number(seconds, 3)} s`;
}

/** A name of keys and layers as people write it. */
const spaced = (name) => name.replaceAll("_", " ");
const fileName = (path) => path.split(/[\\/]/).pop();

/** A key that nobody guesses: 32 hexadecimal digits. */
function randomKey() {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

const plus = (a, b, factor = 1) => a.map((value, index) => value + factor * b[index]);
const minus = (a, b) => a.map((value, index) => value - b[index]);
const times = (a, factor) => a.map((value) => value * factor);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.hypot(...a);
const unit = (a) => times(a, 1 / (norm(a) || 1));
const degrees = (angle) => (angle * 180) / Math.PI;
const radians = (angle) => (angle * Math.PI) / 180;
const AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const isPoint = (value) => Array.isArray(value) && value.length === 3 && value.every(Number.isFinite);

/** Turn a vector about a unit axis. */
function turned(vector, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return plus(plus(times(vector, c), cross(axis, vector), s), axis, (1 - c) * dot(axis, vector));
}

/** Two unit vectors at right angles to one and to each other. */
function across(axis, hint = [0, 1, 0]) {
  const away = Math.abs(dot(axis, unit(hint))) > 0.99 ? [axis[1], axis[2], axis[0]] : hint;
  const one = unit(cross(axis, away));
  return [one, cross(one, axis)];
}

/** A matrix as rows: scene files may say it as 16 numbers. */
const rowsOf = (matrix) => (matrix?.length === 16 ? [0, 4, 8, 12].map((at) => matrix.slice(at, at + 4)) : matrix);
const columnOf = (rows, index) => [rows[0][index], rows[1][index], rows[2][index]];

/** Corners of what lies in bounds, its middle, and the radius of a ball around it; of a cube where there are no such bounds. */
function extentOf(bounds) {
  const isUsable = bounds && bounds.every(isPoint) && norm(minus(bounds[1], bounds[0])) < 1e12;
  const [low, high] = isUsable ? bounds : [[-1, -1, -1], [1, 1, 1]];
  return { low, high, centre: times(plus(low, high), 0.5), radius: norm(minus(high, low)) / 2 || 1 };
}

/** What a dotted key says in tables and lists: "light.0.from". */
const valueAt = (tables, key) => key.split(".").reduce((table, part) => table?.[part], tables);

/** Tables and lists with another value at a dotted key; the others are shared. */
function withValue(tables, key, value) {
  const [part, ...rest] = key.split(".");
  const copy = Array.isArray(tables) ? [...tables] : { ...tables };
  copy[part] = rest.length === 0 ? value : withValue(copy[part] ?? {}, rest.join("."), value);
  return copy;
}

/** Whether values are the same, but for digits that were rounded off. */
function same(a, b) {
  if (typeof a === "number" && typeof b === "number") return a === b || Math.abs(a - b) <= 2e-6 * Math.max(Math.abs(a), Math.abs(b));
  if (a === null || b === null || typeof a !== "object" || typeof b !== "object") return (a ?? null) === (b ?? null);
  const keys = new Set([...Object.keys(a), ...Object.keys(b)]);
  return [...keys].every((key) => same(a[key], b[key]));
}

/** Make an element of a drawing. */
function drawn(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  setAttributes(element, attributes);
  element.append(...children);
  return element;
}

/** Change what is to change: each is compared first, null takes it away. */
function setAttributes(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined) element.removeAttribute(name);
    else if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value);
  }
}

/** A drawing of 24 by 24 for a button. */
function icon(name) {
  return drawn("svg", { class: "icon", viewBox: "0 0 24 24", "aria-hidden": "true" }, drawn("path", { d: ICONS[name] }));
}

const ICONS = {
  save: "M12 4v11m0 0-4-4m4 4 4-4M4 19h16",
  undo: "M9 14 4 9l5-5M4 9h10a6 6 0 0 1 0 12h-3",
  redo: "m15 14 5-5-5-5m5 5H10a6 6 0 0 0 0 12h3",
  move: "M12 3v18M3 12h18M12 3 9 6m3-3 3 3m-3 15-3-3m3 3 3-3M3 12l3-3m-3 3 3 3m15-3-3-3m3 3-3 3",
  rotate: "M20 12a8 8 0 1 1-2.5-5.8M20 3v4.5h-4.5",
  scale: "M4 20V11h9v9zm11-11 5-5m0 0h-5m5 0v5",
  gizmos: "M12 12 4 17m8-5 8 5m-8-5V3m-8 14 .6-3.4M4 17l3.4.6M20 17l-.6-3.4M20 17l-3.4.6M12 3 9.6 5.6M12 3l2.4 2.6",
  pick: "M4 19C8 19 8 6 12 6s4 9 8 9M4 4v16h16",
  frame: "M4 9V4h5m6 0h5v5m0 6v5h-5m-6 0H4v-5M9 9h6v6H9z",
  home: "m3 12 9-8 9 8M6 10v10h12V10M10 20v-6h4v6",
  panel: "M4 5h16v14H4zM14 5v14",
  grid: "M4 4h16v16H4zM4 12h16M12 4v16",
  help: "M9 9a3 3 0 1 1 4.2 2.7c-.8.4-1.2 1-1.2 2.3m0 3v.5M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18z",
  play: "M7 4.5v15l12-7.5z",
  pause: "M8 5v14M16 5v14",
  reset: "M4 12a8 8 0 1 0 2.5-5.8M4 3v4.5h4.5",
  remove: "M6 6l12 12M18 6 6 18",
  folder: "M3 7a2 2 0 0 1 2-2h4l2 2h8a2 2 0 0 1 2 2v8a2 2 0 0 1-2 2H5a2 2 0 0 1-2-2z",
  file: "M6 3h8l4 4v14H6zM14 3v4h4",
};

/** A button of an icon, with a name that is read out, and a key that does the same. */
function iconButton(name, label, key = "", onClick = null) {
  const button = make("button", { type: "button", className: "icon-button", title: key ? `${label} (${key})` : label, "aria-label": label }, icon(name));
  if (key) button.setAttribute("aria-keyshortcuts", key.replace("Ctrl", "Control"));
  if (onClick) button.addEventListener("click", onClick);
  return button;
}

/** A control with its name before it. */
const labelled = (name, control) => make("label", {}, make("span", { className: "legend", textContent: name }), control);

/** A field of a line of text. */
function textInput(label, properties = {}) {
  return make("input", { type: "text", className: "text", autocomplete: "off", spellcheck: false, "aria-label": label, ...properties });
}

/** One of a few, as buttons beside each other; `choose(value)` is called, `set(value)` shows what holds. */
function choiceButtons(label, options, choose) {
  const group = make("div", { className: "join", role: "group", "aria-label": label });
  const buttons = new Map(options.map(({ value, text, title = "" }) => {
    const button = make("button", { type: "button", textContent: text, title, "aria-pressed": "false" });
    button.addEventListener("click", () => choose(value));
    group.append(button);
    return [value, button];
  }));
  group.set = (chosen) => buttons.forEach((button, value) => button.setAttribute("aria-pressed", String(value === chosen)));
  group.enable = (value, yes) => { buttons.get(value).disabled = !yes; };
  return group;
}

/** Options of a select box, only where they are others than before. */
function setOptions(select, options, chosen) {
  const wanted = JSON.stringify(options);
  if (select.wanted !== wanted) {
    select.wanted = wanted;
    select.replaceChildren(...options.map(({ value, text, title = "" }) => make("option", { value, textContent: text, title })));
  }
  if (select.value !== String(chosen)) select.value = String(chosen);
}
