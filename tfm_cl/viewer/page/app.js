// The viewer: its parts, and how they lie.

class App {
  constructor(element, transport) {
    this.element = element;
    element.classList.add("tfm", "tfm-viewer");
    element.replaceChildren();
    this.model = new Model(transport);
    this.schema = null;
    this.picking = false;
    this.picked = null;

    this.compare = new Compare(this);
    this.maps = new Maps(this);
    const stageElement = make("div", { className: "view" });
    this.stage = new Stage(this, stageElement);
    this.gizmos = new Gizmos(this, this.stage.over);
    this.curve = new Curve(this);
    this.timeline = new Timeline(this);
    this.status = new Status(this);
    const side = make("aside", { className: "panel", "aria-label": "Settings" });
    this.panel = new Panel(this, side);
    this.files = new FilesDialog(this, { title: "Open", kind: "scene", none: "There is no scene and no volume here.", does: (path) => this.openFile(path) });
    this.tables = new FilesDialog(this, { title: "Choose a table of a phase function", kind: "phase", none: "There is no text file here." });
    this.saving = new SaveDialog(this);
    this.keys = new Keys(this, element);

    this.alert = make("p", { className: "alert", role: "alert", hidden: true });
    this.warnings = make("ul", { className: "warnings", hidden: true, "aria-label": "Warnings" });
    const notes = make("div", { className: "notes" }, this.alert, this.warnings);
    const keys = make("p", { id: "tfm-stage-keys", className: "off-screen", textContent: "Arrow keys turn the camera, with Shift they shift it, F frames everything, Tab goes to the handles, question mark tells all keys." });
    const middle = make("div", { className: "middle" }, this.#tools(), stageElement, notes);
    const left = make("div", { className: "left" }, middle, this.curve.element, this.timeline.element);
    element.append(this.#header(), make("div", { className: "body" }, left, side), this.status.element, this.files.dialog, this.tables.dialog, this.saving.dialog, this.keys.sheet, keys);
    this.files.listen(element);
    this.#listen();
    this.compare.draw();
  }

  close() {
    this.keys.close();
    this.stage.close();
    this.status.close();
    this.curve.resized.disconnect();
    this.element.replaceChildren();
  }

  // ------------------------------------------------------------------------------------------- layout

  #header() {
    const { model } = this;
    const send = (type) => () => model.send({ type });
    this.open = iconButton("folder", "Open a file", "Ctrl+O", () => this.files.ask());
    this.save = iconButton("save", "Save scene or picture", "Ctrl+S", () => this.saving.ask());
    this.undo = iconButton("undo", "Undo", "Ctrl+Z", send("undo"));
    this.redo = iconButton("redo", "Redo", "Ctrl+Shift+Z", send("redo"));
    this.source = make("h1", { className: "source" });
    this.layer = make("select", { "aria-label": "Layer" });
    this.light = make("select", { "aria-label": "Light whose layer is shown" });
    this.look = make("select", { "aria-label": "View transform" });
    this.exposure = slider("Exposure, stops", { key: "exposure", least: -10, most: 10 }, (value) => this.#show({ exposure: Number(value.toFixed(2)) }));
    this.stops = numberInput("Exposure, stops", { step: 1 / 3 });
    this.stops.addEventListener("change", () => { const value = this.stops.read(); if (value !== null) this.#show({ exposure: clamp(value, -100, 100) }); });
    this.auto = make("button", { type: "button", className: "small", textContent: "auto", "aria-pressed": "false", title: "By how bright what is lit is" });
    this.auto.addEventListener("click", () => this.#show({ exposure: "auto" }));
    this.layer.addEventListener("change", () => this.#show({ layer: this.layer.value }));
    this.light.addEventListener("change", () => this.#show({ light: Number(this.light.value) }));
    this.look.addEventListener("change", () => this.#show({ view: this.look.value }));
    const theme = make("button", { type: "button", className: "theme" });
    followTheme(this.element, theme, () => this.curve.draw());
    const group = (label, ...parts) => make("div", { className: "tool-group", role: "group", "aria-label": label }, ...parts);
    return make("header", { className: "top" },
      group("File", this.open, this.save, this.undo, this.redo), this.source,
      group("Layer", labelled("Layer", this.layer), this.light),
      group("Exposure and view", labelled("Exposure", this.exposure), this.stops, this.auto, this.look),
      this.compare.bar, this.maps.element,
      make("div", { className: "tool-group end" }, theme, iconButton("panel", "Panel", "N", () => this.showPanel()), iconButton("help", "Keys and mouse", "?", () => openOver(this.keys.sheet))));
  }

  #tools() {
    const tool = (name, label, key) => iconButton(name, label, key, () => this.gizmos.setTool(name));
    this.toolButtons = { move: tool("move", "Move", "W"), rotate: tool("rotate", "Turn", "E"), scale: tool("scale", "Scale", "R") };
    this.gizmoButton = iconButton("gizmos", "Handles", "G", () => this.gizmos.toggle());
    this.pickButton = iconButton("pick", "T(z) through a point: click it", "C", () => this.setPicking());
    this.mapButton = iconButton("grid", "Coefficients of the map", "M", () => this.maps.toggle());
    const rule = () => make("span", { className: "rule", role: "separator" });
    return make("div", { className: "strip", role: "toolbar", "aria-label": "Tools", "aria-orientation": "vertical" },
      ...Object.values(this.toolButtons), this.gizmoButton, rule(), this.pickButton, this.mapButton, rule(),
      iconButton("frame", "Frame everything", "F", () => this.stage.frameAll()), iconButton("home", "The file's camera", "H", () => this.stage.home()));
  }

  #listen() {
    const { model } = this;
    model.on("welcome", (welcome) => {
      this.schema = new Schema(welcome.schema);
      this.open.disabled = welcome.can.open === false;
      this.save.disabled = welcome.can.save === false;
    });
    model.on("state", (state) => this.#drawState(state));
    model.on("options", () => {
      this.maps.draw();
      this.drawGizmos();
    });
    model.on("failed", ({ line }) => this.complain(line));
    model.on("cleared", () => this.complain(""));
    model.on("connection", () => this.#drawConnection());
    this.drawTools();
  }

  #drawConnection() {
    const { connected, line } = this.model;
    this.element.classList.toggle("lost", !connected);
    if (!connected) this.complain(line || "The viewer does not answer; trying again …");
    else if (this.wasLost) {
      this.complain("");
      this.say("Connected again");
    }
    this.wasLost = !connected;
  }

  #drawState({ source, show, undo, redo, warnings }) {
    const name = fileName(source);
    this.source.textContent = name;
    this.source.title = source;
    if (this.element.parentElement === document.body) document.title = `${name} · tfm view`;
    this.undo.disabled = !undo;
    this.redo.disabled = !redo;
    const { welcome } = this.model;
    const layers = welcome?.layers ?? [];
    setOptions(this.layer, layers.map((layer) => ({ value: layer.name, text: spaced(layer.name), title: layer.meaning })), show.layer);
    this.layer.title = layers.find((layer) => layer.name === show.layer)?.meaning ?? "";
    const lights = show.layer === "lights" ? this.lightChoices() : [];
    setOptions(this.light, lights, show.light);
    this.light.hidden = lights.length < 2;
    setOptions(this.look, (welcome?.views ?? []).map(({ name: value, summary }) => ({ value, text: value, title: summary })), show.view);
    this.auto.setAttribute("aria-pressed", String(show.exposure === "auto"));
    this.exposure.put(show.exposure === "auto" ? 0 : show.exposure);
    this.stops.put(show.exposure);
    this.warnings.hidden = !warnings?.length;
    if (!same(warnings, this.warned)) this.warnings.replaceChildren(...(warnings ?? []).map((line) => make("li", { textContent: line })));
    this.warned = warnings;
  }

  drawTools() {
    for (const [name, button] of Object.entries(this.toolButtons)) button.setAttribute("aria-pressed", String(!this.gizmos.hidden && this.gizmos.tool === name));
    this.gizmoButton.setAttribute("aria-pressed", String(!this.gizmos.hidden));
    this.pickButton.setAttribute("aria-pressed", String(this.picking));
    this.mapButton.setAttribute("aria-pressed", String(this.maps.isOn));
  }

  /** Once for each frame of the screen. */
  drawGizmos() {
    this.drawing ??= requestAnimationFrame(() => {
      this.drawing = null;
      if (this.model.state !== null) this.gizmos.draw();
      this.#drawPicked();
    });
  }

  /** Mark the place that was picked, while the camera shows the same. */
  #drawPicked() {
    const [width, height] = this.stage.size;
    const at = this.picked && [this.picked.x * width, this.picked.y * height];
    this.picker ??= this.stage.over.appendChild(drawn("path", { class: "picked" }));
    const isSame = this.picked && same(this.picked.camera, this.model.options?.camera);
    setAttributes(this.picker, { d: isSame ? cross2(at, 7 * (this.gizmos.scale ?? 1)) : "M0 0" });
  }

  // ------------------------------------------------------------------------------------------- what is said

  say(line) {
    this.status.say(line);
  }

  complain(line) {
    this.alert.textContent = line;
    this.alert.hidden = line === "";
    if (line) this.say("");
  }

  onPicture(header) {
    this.timeline.onPicture(header);
    if (header.which === "a") this.drawGizmos();
  }

  lightName(index) {
    const lights = this.model.options?.light ?? [];
    return lights[index] ? itemName("light", lights[index], index, lights.length) : `light ${index + 1}`;
  }

  /** Options of a select box. */
  lightChoices() {
    return (this.model.options?.light ?? []).map((_, index) => ({ value: index, text: this.lightName(index) }));
  }

  // ------------------------------------------------------------------------------------------- what is done

  #show(changes) {
    this.model.send({ type: "show", ...changes });
  }

  openFile(path) {
    this.model.send({ type: "open", path });
    this.say(`Opening ${path} …`);
  }

  expose(by) {
    const { exposure } = this.model.state.show;
    this.#show({ exposure: Number(clamp((exposure === "auto" ? 0 : exposure) + by, -100, 100).toFixed(3)) });
  }

  setPicking(yes = !this.picking) {
    this.picking = yes;
    this.element.classList.toggle("picking", yes);
    this.drawTools();
    this.say(yes ? "Click a point of the picture: T(z) along the light's ray through it" : "");
  }

  pick(x, y) {
    const [left, top, width, height] = this.stage.part;
    const [u, v] = [(x - left) / width, (y - top) / height];
    this.setPicking(false);
    if (u < 0 || v < 0 || u > 1 || v > 1) return;
    const chosen = /^light\.(\d+)$/.exec(this.gizmos.selected ?? "");
    this.picked = { x, y, camera: this.model.options.camera };
    this.model.send({ type: "pick", x: u, y: v, light: chosen ? Number(chosen[1]) : 0 });
    this.drawGizmos();
  }

  showPanel(yes = this.element.classList.contains("no-panel")) {
    this.element.classList.toggle("no-panel", !yes);
  }

  /** Add a light or a solid that suits what is there; the whole list is set. */
  addItem(section, kind) {
    const { options } = this.model;
    const { key, one } = this.schema.named(section).find(({ name }) => name === kind);
    const { low, high, centre, radius } = this.model.extent;
    const view = this.stage.view();
    const table = { [key]: kind };
    if (section === "light") {
      if (one.properties.from) table.from = rounded(plus(plus(plus(centre, view.above, 2 * radius), view.right, 1.4 * radius), view.forward, -0.8 * radius));
      if (one.properties.to) table.to = rounded(centre);
      const others = (options.light ?? []).map((light) => Math.max(...[light.intensity].flat())).filter((value) => value > 0);
      if (["spot", "sun", "point"].includes(kind)) table.intensity = Array(3).fill(rounded((others.length > 0 ? Math.max(...others) : 5) / 2));
    } else if (kind === "sphere") Object.assign(table, { centre: rounded(plus(centre, view.right, 1.2 * radius)), radius: rounded(0.25 * radius) });
    else if (kind === "box") {
      const middle = plus(centre, view.right, 1.2 * radius);
      Object.assign(table, { from: rounded(middle.map((v) => v - 0.2 * radius)), to: rounded(middle.map((v) => v + 0.2 * radius)) });
    } else if (kind === "plane") {
      const up = unit(placed(options.camera).up);
      const least = Math.min(...[0, 1].map((side) => dot(side ? high : low, up)));
      Object.assign(table, { point: rounded(plus(centre, up, least - dot(centre, up))), normal: rounded(up) });
    }
    this.#setList(section, [...(options[section] ?? []), table]);
    setTimeout(() => this.gizmos.select(`${section}.${(options[section] ?? []).length}`), 0);
  }

  removeItem({ section, index }) {
    this.gizmos.select(null);
    this.#setList(section, this.model.options[section].filter((_, at) => at !== index));
  }

  removeChosen() {
    const [section, index] = (this.gizmos.selected ?? "").split(".");
    if (CAN_ADD.has(section)) this.removeItem({ section, index: Number(index) });
  }

  /** Another kind of light in the same place, with what both have. */
  changeKind({ section, index, table }, kind) {
    const { key, one } = this.schema.named(section).find(({ name }) => name === kind);
    const kept = Object.entries(table).filter(([name, value]) => name in one.properties && one.properties[name].const === undefined && value !== null);
    const next = { [key]: kind, ...Object.fromEntries(kept) };
    const { centre, radius } = this.model.extent;
    if (one.properties.from && !next.from) next.from = rounded(plus(centre, [0.5, 1, 0.5], 2 * radius));
    if (one.properties.to && !next.to) next.to = rounded(centre);
    this.#setList(section, this.model.options[section].map((old, at) => (at === index ? next : old)));
  }

  #setList(section, tables) {
    const said = tables.map((table) => Object.fromEntries(Object.entries(table).filter(([, value]) => value !== null)));
    this.model.edit({ [section]: said });
  }

  giveUp() {
    if (this.picking) this.setPicking(false);
    else if (this.maps.isOn) this.maps.toggle(false);
    else if (this.gizmos.selected !== null) this.gizmos.select(null);
    else this.complain("");
  }
}

/** Put a viewer into an element; `close()` of what is returned takes it out again. */
function mount(element, transport) {
  return new App(element, transport);
}
