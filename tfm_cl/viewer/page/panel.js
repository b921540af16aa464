// The panel: every key of the scene file, those first that are used most.

const ORDER = ["light", "medium", "volume", "map", "march", "solid", "camera", "image", "ambient", "shadow"];
const TITLES = { light: "Lights", medium: "Medium", volume: "Volume", map: "Light map", march: "March", solid: "Solids", camera: "Camera", image: "Image", ambient: "Ambient light", shadow: "Shadows of solids" };
const OPEN = new Set(["light", "medium", "volume", "map"]);
const CAN_ADD = new Set(["light", "solid"]); // and remove
/** Keys that are seen at once, in this order; the others are under "more". */
const FIRST = {
  light: ["type", "intensity", "cone", "blend", "elevation", "azimuth", "turbidity", "from", "to", "falloff", "reach", "radius", "samples", "sun"],
  medium: ["preset", "sigma_s", "sigma_a", "phase", "emission", "orders", "octaves"],
  volume: ["density_scale", "density", "opacity", "centre", "radius", "from", "to", "translate", "rotate", "scale"],
  map: ["basis", "coeffs", "density_weighting", "range", "lookup", "res", "steps"],
  march: ["method", "steps", "sampling"],
  solid: ["albedo", "translate", "rotate", "scale", "centre", "radius", "point", "normal", "from", "to", "height", "visible"],
  camera: ["from", "to", "fov", "focal_length", "res"],
  image: ["exposure", "view", "samples", "background", "transparent"],
  ambient: ["radiance"],
  shadow: ["res", "filter"],
};
const MOST_OPEN = 3; // items of a list that are opened by themselves
const MOST_SEARCHED = 40; // items of a list that a search looks into

class Panel {
  constructor(app, element) {
    Object.assign(this, { app, sections: new Map() });
    this.search = textInput("Search settings", { type: "search", className: "" });
    this.search.addEventListener("input", () => this.filter());
    this.search.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      this.search.value = "";
      this.filter();
      app.stage.flip.stage.focus();
    });
    this.resetAll = iconButton("reset", "Take all changes back", "", () => app.model.send({ type: "reset" }));
    this.nothing = make("p", { className: "none", textContent: "No setting has these words.", hidden: true });
    this.body = make("div", { className: "sections" });
    element.append(make("div", { className: "panel-head" }, labelled("Search", this.search), this.resetAll), this.nothing, this.body);
    // Once for each frame of the screen, however much is said.
    app.model.on("options", () => { this.drawing ??= requestAnimationFrame(() => this.draw()); });
  }

  draw() {
    this.drawing = null;
    const { model, schema } = this.app;
    if (model.options === null || schema === null) return;
    for (const name of ORDER) {
      if (!this.sections.has(name) && name in schema.sections) this.#add(name);
      this.sections.get(name)?.draw();
    }
    this.resetAll.disabled = Object.keys(model.state.edits).length === 0;
  }

  #add(name) {
    const section = new Section(this.app, name);
    this.sections.set(name, section);
    this.body.append(section.element);
  }

  filter() {
    const words = this.search.value.trim().toLowerCase();
    let found = 0;
    for (const section of this.sections.values()) found += section.filter(words);
    this.nothing.hidden = found > 0 || words === "";
  }

  /** Show the item whose handles are on the stage. */
  mark(path) {
    for (const section of this.sections.values()) section.mark(path);
  }
}

/** A section: one table, or a list of them. */
class Section {
  constructor(app, name) {
    Object.assign(this, { app, name, canAdd: CAN_ADD.has(name), tables: new Map(), words: "" });
    this.count = make("span", { className: "count" });
    this.dot = make("span", { className: "dot", title: "changed since the file was opened" });
    const head = make("summary", { title: app.schema.sections[name].description ?? "" }, make("span", { className: "title", textContent: TITLES[name] }), this.count, this.dot);
    this.body = make("div", { className: "section-body" });
    this.element = make("details", { className: "section", open: OPEN.has(name) }, head, this.body);
    this.element.dataset.section = name;
    this.element.addEventListener("toggle", () => this.draw());
    if (this.canAdd) this.#addAdder();
    this.element.addEventListener("keydown", (event) => event.target === head && event.key === "Delete" && event.preventDefault());
  }

  #addAdder() {
    const kinds = this.app.schema.named(this.name);
    const select = make("select", { className: "adder", "aria-label": `Add a ${this.name}` }, make("option", { value: "", textContent: `+ Add a ${this.name} …` }), ...kinds.map(({ name, one }) => make("option", { value: name, textContent: name, title: one.description ?? "" })));
    select.addEventListener("change", () => {
      if (select.value) this.app.addItem(this.name, select.value);
      select.value = "";
    });
    this.body.append(select);
    this.adder = select;
  }

  draw() {
    const { model } = this.app;
    const found = items(model.options, this.name);
    this.count.textContent = this.canAdd || found.length > 1 ? found.length : "";
    this.element.classList.toggle("many", found.length > MOST_SEARCHED);
    this.dot.hidden = !model.isEdited(this.name);
    if (!this.element.open && this.words === "") return;
    for (const item of found) {
      if (!this.tables.has(item.path)) this.#addTable(item, found.length);
      this.tables.get(item.path).draw(item);
    }
    const paths = new Set(found.map(({ path }) => path));
    for (const [path, table] of this.tables) {
      if (paths.has(path)) continue;
      table.element.remove();
      this.tables.delete(path);
    }
  }

  #addTable(item, count) {
    const isList = this.canAdd || count > 1;
    const table = new Table(this.app, item, isList, count <= MOST_OPEN && this.name !== "solid");
    this.tables.set(item.path, table);
    if (this.adder) this.adder.before(table.element);
    else this.body.append(table.element);
  }

  filter(words) {
    this.words = words;
    this.element.classList.toggle("searched", words !== "");
    if (words !== "") this.draw();
    const isTitle = words !== "" && TITLES[this.name].toLowerCase().includes(words);
    let found = 0;
    [...this.tables.values()].forEach((table, index) => { found += index < MOST_SEARCHED ? table.filter(isTitle ? "" : words, words !== "") : 0; });
    if (this.adder) this.adder.hidden = words !== "" && !isTitle;
    this.element.hidden = words !== "" && found === 0;
    if (words !== "" && found > 0) this.element.open = true;
    return found;
  }

  mark(path) {
    const isHere = path !== null && path.split(".")[0] === this.name;
    if (isHere && !this.element.open) this.element.open = true;
    if (isHere) this.draw();
    for (const [one, table] of this.tables) table.mark(one === path);
  }
}

/** Rows of the keys of one table. */
class Table {
  constructor(app, item, isList, isOpen) {
    Object.assign(this, { app, item, isList, rows: [], kind: null, words: "", isSearched: false });
    this.body = make("div", { className: "rows" });
    this.more = make("details", { className: "more" }, make("summary", { textContent: "More" }), make("div", { className: "rows" }));
    if (!isList) this.element = make("div", { className: "table" }, this.body, this.more);
    else {
      this.title = make("span", { className: "title" });
      const remove = iconButton("remove", "Remove", "", (event) => {
        event.preventDefault();
        app.removeItem(this.item);
      });
      remove.classList.add("tiny");
      remove.hidden = item.section === "volume";
      const head = make("summary", {}, this.title, remove);
      this.element = make("details", { className: "item", open: isOpen }, head, this.body, this.more);
      head.addEventListener("click", (event) => {
        if (this.element.open || event.defaultPrevented) return;
        event.preventDefault(); // choosing it opens it, which the click would undo
        app.gizmos.select(this.item.path);
      });
    }
    this.element.addEventListener("toggle", () => this.draw(this.item), true);
    this.element.dataset.path = item.path;
  }

  draw(item) {
    this.item = item;
    if (this.title) this.title.textContent = itemName(item.section, item.table, item.index, item.count);
    if (this.isList && !this.element.open && !this.isSearched) return;
    const kind = `${this.app.schema.of(item.section, item.table).title} ${isSheared(item.table)}`;
    if (this.kind !== kind) this.#build(kind);
    for (const row of this.rows) row.draw();
  }

  #build(kind) {
    this.kind = kind;
    this.rows = [];
    const { section, table, path } = this.item;
    const keys = this.app.schema.keys(section, table);
    const first = isSheared(table) ? FIRST[section].map((key) => (key === "translate" ? "transform" : key)) : FIRST[section];
    const order = (key) => (first.includes(key) ? first.indexOf(key) : 100);
    const rest = this.more.lastChild;
    this.body.replaceChildren();
    rest.replaceChildren();
    for (const key of keys.toSorted((a, b) => order(a.key) - order(b.key))) {
      const isTold = key.kind === "fixed";
      const isStep = STEPS.includes(key.key);
      if (isStep && isSheared(table)) continue; // they cannot say it
      if (isTold && (key.key !== "type" || section !== "light")) continue;
      if (key.kind === "medium") {
        this.#addMedium(rest, path, table);
        continue;
      }
      const row = new (isTold ? KindRow : isStep ? StepRow : Row)(this.app, this, key);
      this.rows.push(row);
      (order(key.key) < 100 ? this.body : rest).append(row.element);
    }
    this.more.hidden = rest.childElementCount === 0;
    if (this.isSearched) this.filter(this.words, true);
  }

  /** Keys of the medium of a body that has one of its own. */
  #addMedium(rest, path, table) {
    if (!table.medium) return;
    rest.append(make("p", { className: "subtitle", textContent: "Medium of this body" }));
    for (const key of this.app.schema.keys("medium", table.medium)) {
      if (!FIELDS[key.kind] || table.medium[key.key] === undefined) continue;
      const row = new Row(this.app, this, { ...key, path: `medium.${key.key}` });
      this.rows.push(row);
      rest.append(row.element);
    }
  }

  filter(words, isSearched) {
    this.words = words;
    this.isSearched = isSearched;
    if (isSearched) this.draw(this.item);
    let found = 0;
    for (const row of this.rows) {
      const isFound = words === "" || row.text.includes(words);
      row.element.hidden = !isFound;
      found += isFound ? 1 : 0;
    }
    this.element.hidden = isSearched && found === 0;
    this.element.classList.toggle("searched", isSearched);
    if (isSearched && found > 0) {
      if (this.isList) this.element.open = true;
      this.more.open = true;
    } else if (!isSearched) this.more.open = false;
    return found;
  }

  mark(isMarked) {
    this.element.classList.toggle("chosen", isMarked);
    if (!isMarked) return;
    if (this.isList) this.element.open = true;
    this.draw(this.item);
    // When its rows have their places.
    requestAnimationFrame(() => {
      const { body } = this.app.panel;
      const [box, room, head] = [this.element, body, this.element.closest(".section").firstChild].map((element) => element.getBoundingClientRect());
      if (box.top < room.top + head.height || box.bottom > room.bottom) body.scrollTop += box.top - room.top - 1.2 * head.height;
    });
  }
}

/** A key: its name, its control, and whether it was changed. */
class Row {
  constructor(app, table, key) {
    Object.assign(this, { app, table, key });
    const path = key.path ?? key.key;
    this.text = `${path} ${spaced(path)} ${key.description} ${(key.choices ?? []).join(" ")}`.toLowerCase();
    this.field = FIELDS[key.kind](key, spaced(path), (value, drag) => app.model.edit(this.changes(value), drag), app);
    this.back = iconButton("reset", `${path}: as the file says`, "", () => this.takeBack());
    this.back.classList.add("back");
    const name = make("span", { className: "name", textContent: spaced(key.key) });
    this.element = make("div", { className: `row of-${key.kind}`, title: `${this.path}\n${key.description}` }, name, this.field.element, this.back);
    this.element.dataset.key = key.key;
  }

  get path() {
    return `${this.table.item.path}.${this.key.path ?? this.key.key}`;
  }

  get value() {
    return this.app.model.value(this.path);
  }

  changes(value) {
    return { [this.path]: value };
  }

  get isEdited() {
    return this.app.model.isEdited(this.path);
  }

  takeBack() {
    this.app.model.takeBack(this.path);
  }

  draw() {
    const { model } = this.app;
    this.field.set(this.value);
    this.back.hidden = !(this.isEdited && model.canTakeBack(this.path));
    this.element.classList.toggle("edited", this.isEdited);
    this.element.classList.toggle("keyed", (model.state.changing ?? []).includes(this.path));
  }
}

/** A step of where something is, also where the file has a matrix that says the same: then all steps take its place. */
class StepRow extends Row {
  get value() {
    const { table } = this.table.item;
    return isOfMatrix(table) ? stepsOf(matrixOf(table))[this.key.key] : super.value ?? this.key.initial;
  }

  changes(value) {
    const { path, table } = this.table.item;
    if (!isOfMatrix(table)) return super.changes(value);
    return saidAt(path, { ...stepsOf(matrixOf(table)), [this.key.key]: value }, STEPS);
  }

  /** The matrix that the file has, if it has one. */
  get inFile() {
    const table = this.app.model.original && valueAt(this.app.model.original, this.table.item.path);
    return isOfMatrix(table) ? matrixOf(table) : null;
  }

  get isEdited() {
    const before = this.inFile && stepsOf(this.inFile);
    return before ? !same(before[this.key.key], this.value) : super.isEdited;
  }

  /** One step alone would say that the others are none, where the file has a matrix. */
  takeBack() {
    const { model } = this.app;
    const all = STEPS.map((step) => `${this.table.item.path}.${step}`);
    const areOne = model.original === null ? all.every((key) => model.canTakeBack(key)) : this.inFile !== null;
    if (areOne) model.takeBack(...all);
    else super.takeBack();
  }
}

/** The kind of a light: another kind is another table in the same place. */
class KindRow extends Row {
  constructor(app, table, key) {
    super(app, table, { ...key, kind: "choice", choices: app.schema.named(table.item.section).map(({ name }) => name) });
    const [select] = this.field.element.getElementsByTagName("select");
    select.addEventListener("change", (event) => {
      event.stopImmediatePropagation();
      app.changeKind(table.item, select.value);
    }, true);
  }
}
