// The line below: what goes on, what a picture cost, and the frames of a sequence.

const PASSES = ["light_pass", "view_pass", "orders"];

class Status {
  constructor(app) {
    this.app = app;
    this.message = make("span", { className: "message", role: "status", "aria-live": "polite" });
    this.bar = make("progress", { max: 1, hidden: true, "aria-label": "Progress" });
    this.work = make("span", { className: "work" });
    this.costs = make("span", { className: "costs", "aria-label": "What the last picture cost" });
    this.clients = make("span", { className: "clients", hidden: true });
    this.element = make("footer", { className: "status" }, this.bar, this.work, this.message, this.costs, this.clients);
    const { model } = app;
    model.on("work", ({ stage, fraction }) => this.#work(stage, fraction));
    model.on("cost", (cost) => this.#cost(cost));
    model.on("clients", ({ count }) => {
      this.clients.hidden = count < 2;
      this.clients.textContent = `${count} viewers`;
    });
    model.on("connection", () => this.#work("", 1));
  }

  #work(stage, fraction) {
    const isOn = stage !== "" && !(fraction >= 1);
    const isMeasured = Number.isFinite(fraction) && fraction > 0;
    if (stage !== this.stage) Object.assign(this, { stage, since: performance.now() });
    const say = () => {
      const seconds = Math.floor((performance.now() - this.since) / 1000);
      this.work.textContent = !isOn ? "" : isMeasured || seconds < 1 ? stage : `${stage}, ${seconds} s`;
    };
    this.close();
    if (isOn && !isMeasured) this.ticking = setInterval(say, 1000);
    say();
    this.bar.hidden = !isOn;
    if (isMeasured) this.bar.value = fraction;
    else this.bar.removeAttribute("value");
  }

  /** Count no seconds any more. */
  close() {
    clearInterval(this.ticking);
  }

  #cost({ quality, resolution, seconds, made, rate, latency }) {
    const chip = (text, title, className = "") => make("span", { className: `chip ${className}`, textContent: text, title });
    const size = resolution ? chip(`${quality === "full" ? "full" : "moving"} ${resolution[0]} × ${resolution[1]}`, quality === "full" ? "The picture as tfm render makes it" : "A small picture while something moves", quality) : null;
    const passes = PASSES.filter((name) => seconds?.[name] >= 5e-5)
      .map((name) => chip(`${spaced(name)} ${duration(seconds[name])}`, `Time of the ${spaced(name)} on the device`, name));
    const all = Object.entries(seconds ?? {}).map(([name, time]) => `${spaced(name)} ${duration(time)}`).join("\n");
    if (Number.isFinite(seconds?.total)) passes.push(chip(`total ${duration(seconds.total)}`, all, "total"));
    const names = Object.entries(made ?? {}).filter(([, count]) => count > 0).map(([name, count]) => `${count > 1 ? `${count} × ` : ""}${spaced(name)}`);
    const what = `Made anew: ${names.join(", ") || "nothing"}; all else was kept`;
    const anew = made?.map > 0 ? chip(made.map > 1 ? `${made.map} new maps` : "new map", what, "made") : chip("no new map", what, "kept");
    const speed = quality === "low" && rate > 0 ? chip(`${number(rate, 3)} frames/s`, "While it moves", "rate") : null;
    const late = Number.isFinite(latency) ? chip(`${duration(latency)} after input`, "From the last change to this picture", "latency") : null;
    this.costs.replaceChildren(...[size, anew, ...passes, speed, late].filter((part) => part !== null));
    this.#work("", 1);
  }

  say(line) {
    this.message.textContent = line;
    clearTimeout(this.fading);
    if (line) this.fading = setTimeout(() => this.say(""), 8000);
  }
}

/** The frames of a sequence, and playing them. */
class Timeline {
  constructor(app) {
    Object.assign(this, { app, playing: false });
    this.button = iconButton("play", "Play", "P", () => this.toggle());
    this.slider = make("input", { type: "range", step: 1, "aria-label": "Frame" });
    this.field = numberInput("Frame number");
    this.last = make("span", { className: "note" });
    this.element = make("div", { className: "timeline", hidden: true, role: "group", "aria-label": "Time" }, this.button, this.slider, this.field, this.last);
    this.slider.addEventListener("input", () => this.go(Number(this.slider.value), true));
    this.slider.addEventListener("change", () => this.go(Number(this.slider.value), false));
    this.field.addEventListener("change", () => { const frame = this.field.read(); if (frame !== null) this.go(frame, false); });
    app.model.on("state", () => this.draw());
    app.model.on("connection", () => { if (!app.model.connected) this.stop(); });
  }

  draw() {
    const { frame, frames } = this.app.model.state;
    this.element.hidden = !frames;
    if (!frames) {
      this.stop();
      return;
    }
    Object.assign(this.slider, { min: frames[0], max: frames[1] });
    if (!this.pending) {
      this.slider.value = frame ?? frames[0];
      this.field.put(frame ?? frames[0]);
    }
    this.last.textContent = `of ${number(frames[0])} – ${number(frames[1])}`;
  }

  go(frame, drag) {
    const { frames } = this.app.model.state;
    if (!frames) return;
    const to = clamp(frame, frames[0], frames[1]);
    this.slider.value = to;
    this.field.put(to);
    this.to = { frame: to, drag };
    if (!drag) this.#send();
    else this.pending ??= requestAnimationFrame(() => this.#send());
  }

  step(by) {
    const { frame, frames } = this.app.model.state ?? {};
    if (frames) this.go((frame ?? frames[0]) + by, false);
  }

  toggle() {
    if (this.playing) this.stop();
    else if (this.app.model.state?.frames) {
      this.playing = true;
      this.#face();
      this.#next();
    }
  }

  stop() {
    if (!this.playing) return;
    this.playing = false;
    this.#face();
    const { frame, frames } = this.app.model.state ?? {};
    if (frames && this.app.model.connected) this.go(this.to?.frame ?? frame, false);
  }

  /** Each frame is asked for when the one before has been seen: no faster than they are made. */
  onPicture({ which, revision }) {
    if (this.playing && which === "a" && revision >= this.app.model.state.revision) setTimeout(() => this.#next(), 1000 / 30);
  }

  #next() {
    const { frames } = this.app.model.state ?? {};
    if (!this.playing || !frames) return;
    const now = this.to?.frame ?? this.app.model.state.frame ?? frames[0];
    this.go(now + 1 > frames[1] ? frames[0] : Math.floor(now) + 1, true);
  }

  #send() {
    if (this.pending) cancelAnimationFrame(this.pending);
    this.pending = null;
    this.app.model.send({ type: "frame", ...this.to });
  }

  #face() {
    this.button.replaceChildren(icon(this.playing ? "pause" : "play"));
    this.button.setAttribute("aria-label", this.playing ? "Pause" : "Play");
  }
}
