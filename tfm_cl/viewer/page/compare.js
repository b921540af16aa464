// Comparing: the picture (A) with the dual march or with settings that were kept (B).

class Compare {
  constructor(app) {
    Object.assign(this, { app, against: "nothing", figures: null, kept: false, before: null });
    this.choice = choiceButtons("Compare with", [
      { value: "nothing", text: "Off", title: "Only the picture" },
      { value: "dual", text: "Dual march", title: "Against the dual march: the reference that the map approximates (D)" },
      { value: "kept", text: "B", title: "Against the settings that were kept as B" },
    ], (value) => this.with(value));
    this.keep = make("button", { type: "button", textContent: "Keep as B", title: "Keep the settings as they are now, to compare with (K)" });
    this.keep.addEventListener("click", () => this.keepNow());
    this.sides = choiceButtons("Shown", [
      { value: "a", text: "A", title: "The picture (1); hold Space to see B" },
      { value: "wipe", text: "Wipe", title: "A left of a divider that can be dragged, B right of it (V)" },
      { value: "b", text: "B", title: "What it is compared with (2)" },
      { value: "error", text: "Error", title: "Blue is too dark, orange too bright (3)" },
    ], (value) => this.show(value));
    this.numbers = make("span", { className: "figures", "aria-live": "polite" });
    this.shown = make("span", { className: "shown", hidden: true }, this.sides, this.numbers);
    this.bar = make("div", { className: "tool-group compare", role: "group", "aria-label": "Compare" }, make("span", { className: "legend", textContent: "Compare" }), this.choice, this.keep, this.shown);
    app.model.on("compared", (message) => {
      if (message.with === this.against) this.figures = message;
      this.draw();
    });
    app.model.on("opened", () => {
      this.kept = false;
      this.off();
    });
    app.model.on("connection", () => {
      // A session that was lost has kept nothing.
      if (app.model.connected && this.against !== "nothing") this.with(this.against === "kept" ? "nothing" : this.against);
    });
  }

  get name() {
    return { dual: "dual march", kept: "B, kept settings", nothing: "" }[this.against];
  }

  with(against) {
    if (against === "kept" && !this.kept) return;
    this.off();
    this.against = against;
    this.app.stage.flip.wiping = against !== "nothing";
    this.app.model.send({ type: "compare", with: against });
    this.draw();
  }

  /** Nothing is compared any more: another scene is open, or something else is compared. */
  off() {
    this.against = "nothing";
    this.figures = null;
    for (const which of ["b", "error"]) this.app.stage.drop(which);
    this.app.stage.flip.wiping = false;
    this.app.stage.flip.shown = "a";
    this.draw();
  }

  keepNow() {
    this.kept = true;
    this.app.model.send({ type: "keep" });
    this.app.say("Kept as B: change something, and compare");
    if (this.against === "kept") this.with("kept");
    this.draw();
  }

  show(side) {
    const { flip } = this.app.stage;
    flip.wiping = side === "wipe";
    flip.shown = side === "wipe" ? "a" : side;
    this.draw();
  }

  /** Another picture for as long as a key is held. */
  hold(isHeld) {
    const { flip } = this.app.stage;
    if (!flip.named.get("b").has) return;
    if (isHeld) this.before = { shown: flip.shown, wiping: flip.wiping };
    Object.assign(flip, isHeld ? { wiping: false, shown: flip.shown === "b" ? "a" : "b" } : this.before);
    this.draw();
  }

  draw() {
    const { stage, stage: { flip } } = this.app;
    const isOn = this.against !== "nothing";
    if (flip.shown !== "map" && !flip.named.get(flip.shown).has && flip.named.get("a").has) flip.shown = "a";
    this.choice.set(this.against);
    this.choice.enable("kept", this.kept);
    this.shown.hidden = !isOn;
    this.bar.classList.toggle("on", isOn);
    this.sides.set(flip.wiping ? "wipe" : flip.shown);
    for (const side of ["b", "error"]) this.sides.enable(side, flip.named.get(side).has);
    this.sides.enable("wipe", flip.named.get("b").has);
    this.numbers.textContent = !isOn ? "" : this.figures === null ? "comparing …" : figureText(this.figures);
    const names = { a: isOn ? "A" : "", b: this.name, error: `error ×${number(stage.gain, 3)}: blue too dark, orange too bright`, map: this.app.maps.label };
    flip.label(names[flip.shown], flip.over === null ? "" : names[flip.over]);
    const alt = { a: "The scene", b: `The scene: ${this.name}`, error: "Error of the picture", map: names.map };
    for (const [which, { node }] of flip.named) node.setAttribute("aria-label", alt[which]);
    stage.scaleBar.classList.toggle("aside", flip.shown === "error" || flip.shown === "map");
    flip.draw();
  }
}

function figureText({ ssim, psnr, rmse }) {
  const parts = [];
  if (Number.isFinite(ssim)) parts.push(`SSIM ${ssim.toFixed(4)}`);
  if (rmse === 0) parts.push("PSNR ∞");
  else if (Number.isFinite(psnr)) parts.push(`PSNR ${psnr.toFixed(1)} dB`);
  if (Number.isFinite(rmse)) parts.push(`RMSE ${number(rmse, 3)}`);
  return parts.join(" · ");
}
