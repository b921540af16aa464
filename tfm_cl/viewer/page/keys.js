// Keys, and the sheet that tells them.

const KEY_SHEET = [
  ["Look", [
    ["Left drag, Alt + left drag", "turn about the target"], ["Middle drag, Shift + left drag", "shift"], ["Wheel", "nearer, away, where the pointer is"], ["Right drag", "nearer to the target, away"],
    ["One finger", "turn"], ["Two fingers", "shift; apart or together: nearer, away"],
    ["F", "frame everything"], ["H", "back to the file's camera"], ["Arrows", "turn; with Shift: shift"], ["+ −", "zoom into pixels"],
  ]],
  ["Light and things", [
    ["L + left drag", "turn the light"], ["Click a handle", "choose it; drag to move"], ["Tab, then arrows", "the same without a mouse; Shift: larger steps"],
    ["W E R", "handles that move, turn, scale"], ["G", "hide the handles"], ["Delete", "remove what is chosen"],
  ]],
  ["Compare", [
    ["K", "keep the settings as B"], ["D", "compare with the dual march"], ["B", "compare with B"], ["Space, held", "the other picture"], ["V", "wipe"], ["1 2 3", "A, B, error"],
  ]],
  ["Measure", [["C, then click", "T(z) through that point"], ["Ctrl + click", "the same at once"], ["M", "coefficients of the map"], ["[ ]", "exposure, a third of a stop"]]],
  ["Else", [
    ["Ctrl + Z", "undo"], ["Ctrl + Shift + Z", "redo"], ["Ctrl + O", "open"], ["Ctrl + S", "save"], ["/", "search settings"], ["N", "hide the panel"],
    ["P", "play"], [", .", "frame before, next"], ["Esc", "choose nothing, close"], ["?", "this sheet"],
  ]],
];

/** Which key it is, whether or not Shift is held. */
const keyOf = (event) => (event.key.length === 1 ? event.key.toLowerCase() : event.key);

class Keys {
  constructor(app, root) {
    Object.assign(this, { app, held: new Set() });
    this.down = (event) => this.#down(event);
    this.up = (event) => this.#up(event);
    this.blur = () => {
      if (this.held.has(" ")) this.app.compare.hold(false);
      this.held.clear();
    };
    // The body has the focus where nothing else has; in a notebook keys there are the notebook's.
    this.target = root.parentElement === document.body ? document : root;
    this.target.addEventListener("keydown", this.down);
    this.target.addEventListener("keyup", this.up);
    window.addEventListener("blur", this.blur);
    const groups = KEY_SHEET.map(([title, rows]) => make("div", {}, make("h3", { textContent: title }), make("dl", {}, ...rows.map(([keys, does]) => make("div", {}, make("dt", { textContent: keys }), make("dd", { textContent: does }))))));
    this.sheet = dialog("Keys and mouse", make("div", { className: "key-sheet" }, ...groups));
    this.sheet.classList.add("wide");
  }

  close() {
    this.target.removeEventListener("keydown", this.down);
    this.target.removeEventListener("keyup", this.up);
    window.removeEventListener("blur", this.blur);
  }

  #up(event) {
    const key = keyOf(event);
    if (key === " " && this.held.has(" ")) this.app.compare.hold(false);
    this.held.delete(key);
  }

  #down(event) {
    const { app } = this;
    const { target } = event;
    if (event.defaultPrevented || app.model.state === null || target.closest?.("dialog")) return;
    const isTyping = /^(INPUT|SELECT|TEXTAREA)$/.test(target.tagName) && !["range", "checkbox", "color"].includes(target.type);
    const control = event.ctrlKey || event.metaKey;
    const key = keyOf(event);
    const does = control ? this.#withControl(key, event.shiftKey, isTyping) : event.altKey || isTyping ? null : this.#plain(key, event);
    if (!does) return;
    event.preventDefault();
    event.stopPropagation();
    does();
  }

  #withControl(key, isShifted, isTyping) {
    const { app } = this;
    if (isTyping && ["z", "y"].includes(key)) return null;
    return {
      z: () => app.model.send({ type: isShifted ? "redo" : "undo" }), y: () => app.model.send({ type: "redo" }),
      o: () => app.files.ask(), s: () => app.saving.ask(),
    }[key];
  }

  #plain(key, event) {
    const { app } = this;
    const isOnStage = event.target === app.stage.flip.stage || event.target === document.body || event.target === app.element;
    const isButton = ["BUTTON", "SUMMARY", "A"].includes(event.target.tagName) || event.target.type === "checkbox";
    if (key === " ") {
      if (isButton) return null;
      return () => {
        if (!event.repeat) app.compare.hold(true);
        this.held.add(" ");
      };
    }
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
    if (arrow) {
      if (!isOnStage) return null;
      const [x, y] = times(arrow, 0.025);
      return () => (event.shiftKey ? app.stage.pan(-x, -y) : app.stage.orbit(-x, -y));
    }
    if (key === "l") return () => this.held.add("l");
    if (event.repeat && !["[", "]", "+", "-", ",", "."].includes(key)) return null;
    const { compare, gizmos, stage } = app;
    return {
      f: () => stage.frameAll(), h: () => stage.home(), g: () => gizmos.toggle(),
      w: () => gizmos.setTool("move"), e: () => gizmos.setTool("rotate"), r: () => gizmos.setTool("scale"),
      c: () => app.setPicking(), k: () => compare.keepNow(), d: () => compare.with(compare.against === "dual" ? "nothing" : "dual"),
      b: () => compare.with(compare.against === "kept" ? "nothing" : "kept"), v: () => compare.show(stage.flip.wiping ? "a" : "wipe"),
      1: () => compare.show("a"), 2: () => compare.show("b"), 3: () => compare.show("error"), m: () => app.maps.toggle(),
      "[": () => app.expose(-1 / 3), "]": () => app.expose(1 / 3), "+": () => stage.flip.stepZoom(1), "=": () => stage.flip.stepZoom(1), "-": () => stage.flip.stepZoom(-1),
      "/": () => { app.showPanel(true); app.panel.search.focus(); }, n: () => app.showPanel(), p: () => app.timeline.toggle(),
      ",": () => app.timeline.step(-1), ".": () => app.timeline.step(1), "?": () => openOver(this.sheet),
      Delete: () => app.removeChosen(), Escape: () => app.giveUp(),
    }[key];
  }
}
