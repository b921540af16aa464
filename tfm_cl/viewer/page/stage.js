// The stage: the pictures that come, on each other, and the pointer over them.

const CLICK = 4; // pixels that a click may move
const REST = 250; // milliseconds after which turning a wheel is over
const WHICH = ["a", "b", "error", "map"];

class Stage {
  constructor(app, element) {
    Object.assign(this, { app, element, shown: new Map(), decoding: new Map(), gain: 1, part: [0, 0, 1, 1] });
    this.size = [0, 0]; // of the picture on the screen; asking the browser for it each time would be slow
    this.flip = new Flip(element, { label: "Picture of the scene", pair: ["a", "b"], fit: (...room) => this.#fit(...room), onChange: () => app.compare.draw() });
    this.flip.stage.setAttribute("aria-describedby", "tfm-stage-keys");
    this.flip.stage.setAttribute("role", "application");
    for (const which of WHICH) this.flip.add(which, make("canvas", { className: "picture", role: "img", width: 1, height: 1 }));
    this.over = drawn("svg", { class: "gizmos", "aria-label": "Handles" });
    this.flip.layers.append(this.over);
    this.ends = [make("span"), make("span")];
    this.colours = make("i", { "aria-hidden": "true" });
    this.scaleBar = make("p", { className: "scale-bar", hidden: true }, this.ends[0], this.colours, this.ends[1]);
    element.append(this.scaleBar);
    this.say("Waiting for the first picture …");
    app.model.on("picture", (picture) => this.#take(picture));
    app.model.on("connection", () => { if (app.model.connected) this.shown.clear(); });
    app.model.on("options", () => this.frame());
    this.resized = new ResizeObserver(() => {
      this.size = [this.flip.layers.clientWidth, this.flip.layers.clientHeight];
      app.drawGizmos();
    });
    this.resized.observe(this.flip.layers);
    this.#listen();
  }

  close() {
    this.resized.disconnect();
    this.flip.close();
  }

  say(line) {
    this.flip.notice.textContent = line;
    this.flip.notice.hidden = line === "";
  }

  /** Where a pointer is in the picture, 0 to 1; beyond outside. */
  place(event) {
    const box = this.flip.layers.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  view() {
    const { options: { camera }, extent } = this.app.model;
    return new View(camera, Math.max(norm(minus(extent.centre, placed(camera).from)), 1e-6));
  }

  // ------------------------------------------------------------------------------------------- pictures

  /** A picture is older than what shows, or a low one of what shows in full. */
  #isOld({ which, revision, quality }) {
    const shown = this.shown.get(which);
    return shown !== undefined && (revision < shown.revision || (revision === shown.revision && quality === "low" && shown.quality === "full"));
  }

  async #take({ header, bytes }) {
    const { which, picture, mime } = header;
    const isLast = () => (this.decoding.get(which) ?? 0) <= picture;
    if (!WHICH.includes(which) || this.#isOld(header)) return this.#seen(header);
    this.decoding.set(which, picture);
    let bitmap = null;
    try {
      bitmap = await createImageBitmap(new Blob([bytes], { type: mime }));
    } catch {
      this.app.complain("a picture could not be read; the next one may");
    }
    // Decoding takes its time: a newer one may have come meanwhile.
    if (bitmap !== null && isLast() && !this.#isOld(header)) this.#draw(header, bitmap);
    bitmap?.close();
    return this.#seen(header);
  }

  #draw(header, bitmap) {
    const { which } = header;
    const { node } = this.flip.named.get(which);
    if (node.width !== bitmap.width || node.height !== bitmap.height) Object.assign(node, { width: bitmap.width, height: bitmap.height });
    node.getContext("2d").drawImage(bitmap, 0, 0);
    node.dataset.quality = header.quality;
    this.shown.set(which, header);
    this.flip.has(which, true);
    if (which === "error") this.gain = header.gain ?? 1;
    if (which === "a") {
      this.say("");
      this.#crop(header);
      this.#drawScale(header);
    }
    this.app.compare.draw();
    this.app.onPicture(header);
  }

  #seen({ picture }) {
    this.app.model.send({ type: "seen", picture });
  }

  /** A picture that is no longer asked for. */
  drop(which) {
    this.flip.has(which, false);
    this.shown.delete(which);
    if (this.flip.shown === which) this.flip.show("a");
  }

  /** What the colours of a layer mean that has none of its own. */
  #drawScale({ range, colours }) {
    this.scaleBar.hidden = !range || !colours;
    if (this.scaleBar.hidden) return;
    this.colours.className = colours;
    this.ends.forEach((end, index) => { end.textContent = number(range[index], 3); });
  }

  /** A part of the frame lies where it belongs. */
  #crop(header) {
    const { crop } = this.app.model.options?.image ?? {};
    const [width, height] = this.app.model.options?.camera.res ?? [1, 1];
    const isPart = crop && header.quality === "full" && header.width === crop[2] - crop[0] && header.height === crop[3] - crop[1];
    const [x0, y0, x1, y1] = isPart ? crop : [0, 0, width, height];
    for (const which of ["a", "b", "error"]) {
      const { node } = this.flip.named.get(which);
      Object.assign(node.style, {
        left: `${(100 * x0) / width}%`, top: `${(100 * y0) / height}%`, width: `${(100 * (x1 - x0)) / width}%`, height: `${(100 * (y1 - y0)) / height}%`,
      });
    }
    this.part = isPart ? [x0 / width, y0 / height, (x1 - x0) / width, (y1 - y0) / height] : [0, 0, 1, 1];
  }

  /** All pictures are as large on the screen as the full one is. */
  frame() {
    const frame = this.flip.shown === "map" ? null : this.app.model.options?.camera.res ?? null;
    if (same(frame, this.flip.frame)) return;
    this.flip.frame = frame;
    this.flip.size();
  }

  /** Whole pixels of the screen for each of the picture's, where that leaves little room empty. */
  #fit(width, height, stage) {
    const ratio = window.devicePixelRatio || 1;
    const zoom = Math.min(stage.clientWidth / width, stage.clientHeight / height);
    const whole = Math.floor(zoom * ratio) / ratio;
    const isWhole = whole >= 1 && whole > 0.8 * zoom;
    this.element.classList.toggle("smooth", !isWhole);
    return isWhole ? whole : zoom;
  }

  // ------------------------------------------------------------------------------------------- pointer

  #listen() {
    const { stage } = this.flip;
    let drag = null;
    stage.addEventListener("pointerdown", (event) => {
      stage.focus({ preventScroll: true });
      if (this.app.model.state === null || event.target.closest(".divider")) return;
      const isSecond = drag?.isTouch && event.pointerType === "touch" && drag.at.size === 1;
      const does = isSecond ? "pinch" : this.#meant(event);
      if ((drag !== null && !isSecond) || does === null) return;
      event.preventDefault();
      stage.setPointerCapture(event.pointerId);
      drag ??= { at: new Map(), isTouch: event.pointerType === "touch", moved: false, start: this.place(event) };
      drag.at.set(event.pointerId, [event.clientX, event.clientY]);
      drag.does = does;
      if (does === "pinch") drag.from = this.#pinched(drag.at);
    });
    stage.addEventListener("pointermove", (event) => {
      const at = drag?.at.get(event.pointerId);
      if (at === undefined) return;
      const now = [event.clientX, event.clientY];
      if (!drag.moved && distance2(at, now) < CLICK) return;
      drag.at.set(event.pointerId, now);
      drag.moved = true;
      const height = this.size[1] || 1;
      if (drag.does === "pinch") this.#pinch(drag, height);
      else this.#drag(drag.does, ...times(minus(now, at), 1 / height));
    });
    const end = (event) => {
      if (!drag?.at.has(event.pointerId)) return;
      if (drag.moved) this.app.model.drop();
      else if (event.type === "pointerup" && drag.at.size === 1) this.#click(drag);
      drag = null; // a finger that stays does nothing more
    };
    stage.addEventListener("pointerup", end);
    stage.addEventListener("pointercancel", end);
    stage.addEventListener("contextmenu", (event) => event.preventDefault());
    let resting = null;
    stage.addEventListener("wheel", (event) => {
      if (this.app.model.state === null || event.ctrlKey) return;
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 40 : 1;
      const [view, factor] = [this.view(), Math.exp(clamp(event.deltaY * lines, -240, 240) * 0.0015)];
      this.move(dollied(view, factor, this.#least, view.aside(...this.place(event))));
      clearTimeout(resting);
      resting = setTimeout(() => this.app.model.drop(), REST);
    }, { passive: false });
  }

  /** What a button does with what is held, as in other 3D programs. */
  #meant(event) {
    if (event.button === 1) return "pan";
    if (event.button === 2) return "dolly";
    if (event.button !== 0) return null;
    if (event.ctrlKey || event.metaKey) return "pick";
    if (event.shiftKey) return "pan";
    if (this.app.keys.held.has("l") && this.app.gizmos.turnable()) return "light";
    return "orbit";
  }

  /** Where two fingers begin. */
  #pinched(at) {
    const [view, { middle, span }] = [this.view(), held(at)];
    return { view, middle, span, aside: view.aside(...this.place({ clientX: middle[0], clientY: middle[1] })) };
  }

  /** What is at the target's distance stays under two fingers; they move one after the other, so both count from where they began. */
  #pinch({ at, from }, height) {
    const { middle, span } = held(at);
    const factor = from.span / span;
    const [x, y] = times(minus(middle, from.middle), factor / height);
    this.move(dollied(panned(from.view, x, y), factor, this.#least, from.aside));
  }

  #drag(does, x, y) {
    const view = this.view();
    if (does === "orbit") this.move(orbited(view, x, y));
    else if (does === "pan") this.move(panned(view, x, y));
    else if (does === "dolly") this.move(dollied(view, Math.exp(2 * (y - x)), this.#least));
    else if (does === "light") this.app.gizmos.turnLight(x, y);
  }

  #click({ does, start }) {
    if (does === "pick" || this.app.picking) this.app.pick(...start);
    else if (does === "orbit") this.app.gizmos.select(null);
  }

  /** How near the target the camera goes. */
  get #least() {
    return 0.04 * this.app.model.extent.radius;
  }

  /** Move the camera; more may follow. */
  move({ from, to }, drag = true) {
    const changes = { "camera.from": rounded(from), "camera.to": rounded(to) };
    // A camera of a matrix has an `up` of its own.
    if (this.app.model.options.camera.matrix) changes["camera.up"] = rounded(this.view().up);
    this.app.model.edit(changes, drag);
  }

  orbit(x, y) {
    this.move(orbited(this.view(), x, y), false);
  }

  pan(x, y) {
    this.move(panned(this.view(), x, y), false);
  }

  /** Look at all there is. */
  frameAll() {
    this.move(framed(this.view(), this.app.model.extent), false);
  }

  /** Look from where the file says. */
  home() {
    this.app.model.takeBack("camera.from", "camera.to", "camera.up", "camera.matrix");
  }
}

/** Where two fingers are on the screen: the middle between them, and how far apart they are. */
function held(at) {
  const [one, other] = at.values();
  return { middle: times(plus(one, other), 1 / 2), span: Math.max(distance2(one, other), 1) };
}
