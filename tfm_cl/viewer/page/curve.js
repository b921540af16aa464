// The curve T(z): the transmittance along the light ray through a place of the picture, in the map and marched.

const CHANNELS = ["red", "green", "blue"];

class Curve {
  constructor(app) {
    Object.assign(this, { app, curve: null, at: null });
    this.title = make("h3", { textContent: "Transmittance along the light ray" });
    const close = iconButton("remove", "Close the curve", "", () => this.hide());
    this.svg = drawn("svg", { class: "plot", role: "img", tabindex: "0", "aria-label": "Curve" });
    this.note = make("p", { className: "note", "aria-live": "polite" });
    this.read = make("p", { className: "reading", "aria-live": "off" });
    this.element = make("section", { className: "dock curve", hidden: true, "aria-label": "Transmittance along the light ray" },
      make("div", { className: "dock-head" }, this.title, this.read, close), this.svg, this.note);
    app.model.on("curve", (curve) => this.show(curve));
    app.model.on("opened", () => this.hide());
    this.svg.addEventListener("pointermove", (event) => {
      const box = this.svg.getBoundingClientRect();
      this.#readAt((event.clientX - box.left - this.left) / (box.width - this.left - this.right));
    });
    this.svg.addEventListener("pointerleave", () => this.#readAt(null));
    this.svg.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -0.01, ArrowRight: 0.01 }[event.key];
      if (by === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      this.#readAt(clamp((this.at ?? 0.5) + by * (event.shiftKey ? 10 : 1), 0, 1));
    });
    this.resized = new ResizeObserver(() => this.draw());
    this.resized.observe(this.svg);
  }

  hide() {
    this.element.hidden = true;
    this.curve = null;
    this.app.picked = null;
    this.app.drawGizmos();
  }

  show(curve) {
    this.curve = curve;
    this.element.hidden = false;
    const light = this.app.lightName(curve.light);
    this.title.textContent = `T(z) along the ray of ${light}`;
    this.note.textContent = (curve.lines ?? []).join(" · ");
    this.draw();
    this.#readAt(null);
  }

  /** Whether red, green and blue differ; else one line stands for them. */
  get channels() {
    const { map, marched } = this.curve;
    const differ = [map, marched].some((lines) => lines?.length > 1 && lines.slice(1).some((line) => line.some((value, index) => Math.abs(value - lines[0][index]) > 1e-4)));
    return differ ? [0, 1, 2] : [0];
  }

  draw() {
    if (this.curve === null || this.element.hidden) return;
    const { z, map, marched, z_point: point } = this.curve;
    const { clientWidth: width, clientHeight: height } = this.svg;
    if (!z?.length || width < 40) return;
    const em = parseFloat(getComputedStyle(this.svg).fontSize);
    Object.assign(this, { left: 2.8 * em, right: em, top: 0.7 * em, bottom: 2.7 * em });
    const [low, high] = [z[0], z.at(-1) > z[0] ? z.at(-1) : z[0] + 1];
    const most = Math.max(1, ...[map, marched].flatMap((lines) => (lines ?? []).flat()).filter(Number.isFinite));
    const top = most > 1.02 ? most : 1;
    const x = (value) => this.left + ((value - low) / (high - low)) * (width - this.left - this.right);
    const y = (value) => this.top + (1 - value / top) * (height - this.top - this.bottom);
    Object.assign(this, { x, low, high });
    const line = (values) => z.map((value, index) => `${index ? "L" : "M"}${point2([x(value), y(clamp(values[index] ?? 0, -0.05, top))])}`).join("");
    const parts = [];
    for (const value of ticks(0, top, height < 9 * em ? 3 : 5)) {
      parts.push(drawn("line", { class: "rule", x1: this.left, x2: width - this.right, y1: y(value), y2: y(value) }));
      parts.push(drawn("text", { class: "tick end", x: this.left - 0.4 * em, y: y(value) + 0.32 * em }, number(value)));
    }
    for (const value of ticks(low, high, Math.max(3, Math.floor(width / (7 * em))))) {
      parts.push(drawn("line", { class: "rule", x1: x(value), x2: x(value), y1: this.top, y2: height - this.bottom }));
      parts.push(drawn("text", { class: "tick", x: x(value), y: height - this.bottom + 1.2 * em }, number(value)));
    }
    parts.push(drawn("text", { class: "axis-name end", x: width - this.right, y: height - 0.35 * em }, "z, distance from the light →"));
    parts.push(drawn("text", { class: "axis-name", x: this.left, y: height - 0.35 * em }, "↑ T"));
    const single = this.channels.length === 1;
    for (const channel of this.channels) {
      const colour = single ? "single" : CHANNELS[channel];
      if (marched?.[channel]) parts.push(drawn("path", { class: `marched ${colour}`, d: line(marched[channel]) }));
      if (map?.[channel]) parts.push(drawn("path", { class: `map ${colour}`, d: line(map[channel]) }));
    }
    if (Number.isFinite(point)) {
      parts.push(drawn("line", { class: "point", x1: x(point), x2: x(point), y1: this.top, y2: height - this.bottom }));
      parts.push(drawn("text", { class: "tick point-name", x: x(point) + 0.3 * em, y: this.top + 0.9 * em }, "picked"));
    }
    this.cursor = drawn("line", { class: "cursor", y1: this.top, y2: height - this.bottom, visibility: "hidden" });
    parts.push(this.cursor, ...this.#legend(width, em));
    setAttributes(this.svg, { viewBox: `0 0 ${width} ${height}`, "aria-label": `Transmittance from z ${number(low)} to ${number(high)}; ${this.#largest()}` });
    this.svg.replaceChildren(...parts);
    this.#readAt(this.at);
  }

  #legend(width, em) {
    const at = width - this.right - 11.5 * em;
    return [["marched", "marched"], ["map", "in the map"]].filter(([name]) => this.curve[name]).flatMap(([name, text], index) => [
      drawn("line", { class: `${name} single`, x1: at, x2: at + 2 * em, y1: this.top + (0.7 + 1.4 * index) * em, y2: this.top + (0.7 + 1.4 * index) * em }),
      drawn("text", { class: "tick key-name", x: at + 2.5 * em, y: this.top + (1.05 + 1.4 * index) * em }, text),
    ]);
  }

  #largest() {
    const { map, marched } = this.curve;
    if (!map || !marched) return "";
    const worst = Math.max(...this.channels.flatMap((channel) => map[channel].map((value, index) => Math.abs(value - marched[channel][index]))));
    return `largest difference ${number(worst, 2)}`;
  }

  #readAt(at) {
    this.at = at;
    if (this.curve === null || !this.cursor) return;
    const { z, map, marched } = this.curve;
    const inside = at !== null && at >= 0 && at <= 1;
    this.cursor.setAttribute("visibility", inside ? "visible" : "hidden");
    if (!inside) {
      this.read.textContent = this.#largest();
      return;
    }
    const value = this.low + at * (this.high - this.low);
    const index = z.reduce((best, one, where) => (Math.abs(one - value) < Math.abs(z[best] - value) ? where : best), 0);
    setAttributes(this.cursor, { x1: this.x(z[index]), x2: this.x(z[index]) });
    const of = (lines) => this.channels.map((channel) => (lines?.[channel]?.[index] ?? NaN).toFixed(4)).join(" ");
    this.read.textContent = `z ${number(z[index])} · marched ${of(marched)} · map ${of(map)}`;
  }
}

/** Round numbers within a range. */
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= rough);
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, index) => Number(((first + index) * step).toPrecision(12)));
}
