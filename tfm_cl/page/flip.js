// Pictures that lie on each other: one shows, a flip shows another, and a divider wipes between two.

const ZOOMS = ["fit", "1", "2", "4", "8"];

class Flip {
  /**
   * Fill an element. `pair` names the two layers that a flip exchanges; `fit(width, height, stage)` is the zoom that
   * "fit" means; a click flips, or moves the divider, where `clicks` says so; `onChange()` is called after what the
   * reader did. `stage` takes the focus and scrolls; `layers` is as large as the picture: what lies over it, too,
   * belongs in there.
   */
  constructor(element, { label = "Picture", pair, fit = Flip.whole, clicks = false, onChange = () => {} }) {
    Object.assign(this, { pair, fit, onChange, shown: pair[0], wiping: false, zoom: "fit", at: 0.5, frame: null });
    this.named = new Map();
    this.layers = make("div", { className: "layers" });
    this.divider = make("div", {
      className: "divider", role: "slider", tabIndex: 0, hidden: true, "aria-label": "Divider between the two pictures",
      "aria-orientation": "horizontal", "aria-valuemin": "0", "aria-valuemax": "100",
    });
    this.layers.append(this.divider);
    this.notice = make("p", { className: "stage-notice", hidden: true });
    this.stage = make("div", { className: "stage", tabIndex: 0, role: "group", "aria-label": label }, this.layers, this.notice);
    this.badges = ["left", "right"].map((side) => make("p", { className: `badge ${side}`, "aria-live": "polite" }));
    element.classList.add("flip");
    element.append(this.stage, ...this.badges);
    this.#listenToDivider();
    if (clicks) this.stage.addEventListener("click", (event) => this.#click(event));
    this.resized = new ResizeObserver(() => this.size());
    this.resized.observe(this.stage);
  }

  /** Below 1 what there is room for, above it whole numbers: pixels of the screen for each of the picture's. */
  static whole(width, height, stage) {
    const zoom = Math.min(stage.clientWidth / width, (0.8 * window.innerHeight) / height);
    return zoom >= 1 ? Math.floor(zoom) : zoom;
  }

  /** Add an image or a canvas on top. */
  add(name, node) {
    node.classList.add("layer");
    if (node.tagName === "IMG") node.addEventListener("load", () => this.size());
    this.named.set(name, { node, has: false });
    this.divider.before(node);
    return node;
  }

  /** Tell whether a layer has a picture now; one without is not shown. */
  has(name, yes) {
    this.named.get(name).has = yes;
  }

  show(name) {
    this.shown = name;
    this.draw();
  }

  /** The layer right of the divider while wiping, else null. */
  get over() {
    const [one, other] = this.pair;
    const name = this.shown === other ? one : other;
    return this.wiping && this.named.get(name).has && this.named.get(this.shown).has ? name : null;
  }

  flip() {
    this.show(this.shown === this.pair[1] ? this.pair[0] : this.pair[1]);
    this.onChange();
  }

  wipe(yes = !this.wiping) {
    this.wiping = yes;
    this.draw();
    this.onChange();
  }

  stepZoom(by) {
    this.setZoom(ZOOMS[clamp(ZOOMS.indexOf(this.zoom) + by, 0, ZOOMS.length - 1)]);
    this.onChange();
  }

  setZoom(zoom) {
    this.zoom = zoom;
    this.size();
  }

  /** What the left picture is, and the right one while wiping. */
  label(left, right = "") {
    [left, right].forEach((text, index) => {
      this.badges[index].textContent = text;
      this.badges[index].hidden = text === "";
    });
  }

  draw() {
    const { over } = this;
    for (const [name, { node, has }] of this.named) {
      node.classList.toggle("shown", has && name === this.shown);
      node.classList.toggle("over", name === over);
      node.setAttribute("aria-hidden", String(name !== this.shown && name !== over));
      node.style.clipPath = name === over ? `inset(0 0 0 ${100 * this.at}%)` : "";
    }
    this.divider.hidden = over === null;
    this.divider.style.left = `${100 * this.at}%`;
    this.divider.setAttribute("aria-valuenow", String(Math.round(100 * this.at)));
    this.layers.hidden = !this.named.get(this.shown).has;
    this.size();
  }

  /** Place the divider: 0 is the left edge, 1 the right one. */
  moveDivider(at) {
    this.at = clamp(at, 0, 1);
    this.draw();
  }

  /** Width and height of a layer in pixels of its own. */
  natural(name = this.shown) {
    const { node } = this.named.get(name);
    return node.tagName === "IMG" ? [node.naturalWidth, node.naturalHeight] : [node.width, node.height];
  }

  /** Give `layers` its size: that of `frame`, or else of the picture that shows, times the zoom. */
  size() {
    const [width, height] = this.frame ?? this.natural();
    if (!width || !height) return;
    const zoom = this.zoom === "fit" ? this.fit(width, height, this.stage) : Number(this.zoom);
    this.layers.style.width = `${width * zoom}px`;
    this.layers.style.height = `${height * zoom}px`;
    // Enlarged pixels are sharp squares, but not those of a coarser picture that stands for another.
    for (const [name, { node }] of this.named) node.classList.toggle("nearest", zoom >= 1 && this.natural(name)[0] >= width);
  }

  /** The pixel of the shown layer under the pointer; null beside the picture. */
  pixel(event) {
    const box = this.layers.getBoundingClientRect();
    const [width, height] = this.natural();
    const [x, y] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    return x < 0 || y < 0 || x >= 1 || y >= 1 ? null : [Math.floor(x * width), Math.floor(y * height)];
  }

  /** Do what a key means; returns whether it means anything. Select boxes and buttons keep theirs. */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || ["SELECT", "INPUT", "TEXTAREA"].includes(event.target.tagName)) return false;
    if (event.key === " " && event.target.tagName === "BUTTON") return false;
    const chosen = [...this.named.keys()][Number(event.key) - 1];
    const does = { " ": () => this.flip(), w: () => this.wipe(), "+": () => this.stepZoom(1), "=": () => this.stepZoom(1), "-": () => this.stepZoom(-1) };
    if (event.key !== " " && chosen !== undefined) {
      this.show(chosen);
      this.onChange();
    } else if (Object.hasOwn(does, event.key)) does[event.key]();
    else return false;
    event.preventDefault();
    return true;
  }

  close() {
    this.resized.disconnect();
  }

  #across(event) {
    const box = this.layers.getBoundingClientRect();
    return (event.clientX - box.left) / box.width;
  }

  #click(event) {
    if (this.over === null) this.flip();
    else this.moveDivider(this.#across(event));
  }

  #listenToDivider() {
    const { divider } = this;
    let grip = null;
    divider.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      event.stopPropagation();
      event.preventDefault(); // nothing is selected or dragged along
      divider.focus();
      divider.setPointerCapture(event.pointerId);
      grip = this.at - this.#across(event);
    });
    divider.addEventListener("pointermove", (event) => {
      if (grip === null) return;
      event.stopPropagation();
      this.moveDivider(this.#across(event) + grip);
    });
    for (const end of ["pointerup", "pointercancel"]) divider.addEventListener(end, () => { grip = null; });
    divider.addEventListener("click", (event) => event.stopPropagation());
    divider.addEventListener("keydown", (event) => {
      const by = event.shiftKey ? 0.1 : 0.01;
      const to = {
        ArrowLeft: this.at - by, ArrowDown: this.at - by, ArrowRight: this.at + by, ArrowUp: this.at + by,
        PageDown: this.at - 0.1, PageUp: this.at + 0.1, Home: 0, End: 1,
      }[event.key];
      if (to === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      event.stopPropagation();
      this.moveDivider(to);
    });
  }
}
