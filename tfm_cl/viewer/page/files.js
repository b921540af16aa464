// Opening, choosing, dropping and saving files.

/** Asks for a file of the folder, of a kind; it is listed there, or sent there first. */
class FilesDialog {
  /** `none`: what is said of a folder without such files; `does(path)`: what is done with the one that is chosen. */
  constructor(app, { title, kind, none, does = null }) {
    Object.assign(this, { app, kind, none, does });
    this.where = make("span", { className: "where" });
    this.list = make("ul", { className: "files", "aria-label": "Files" });
    this.path = textInput("Path within the folder");
    this.chosen = make("input", { type: "file", hidden: true });
    const upload = make("button", { type: "button", textContent: "Upload a file …" });
    upload.addEventListener("click", () => this.chosen.click());
    this.chosen.addEventListener("change", () => {
      if (this.chosen.files.length > 0) this.upload(this.chosen.files[0]);
      this.chosen.value = "";
    });
    this.dialog = dialog(title, make("p", { className: "note" }, "In ", this.where), this.list, labelled("Or a path within the folder", this.path), make("div", { className: "buttons" }, upload, this.chosen));
    this.path.addEventListener("keydown", (event) => { if (event.key === "Enter" && this.path.value) this.choose(this.path.value); });
    app.model.on("listing", (listing) => { if (listing.kind === kind) this.#show(listing); });
  }

  ask(does = this.does) {
    if (this.app.model.welcome?.can.open === false) return;
    this.does = does;
    this.#list("");
    this.list.replaceChildren(make("li", { className: "note", textContent: "Reading the folder …" }));
    openOver(this.dialog).then(() => this.#focus()); // if the listing was there first
  }

  choose(path) {
    this.dialog.close();
    this.does(path);
  }

  #list(path) {
    this.app.model.send({ type: "list", kind: this.kind, path });
  }

  #show({ path, folders, files }) {
    this.where.textContent = [this.app.model.welcome?.folder, path].filter(Boolean).join("/");
    const within = (name) => (path ? `${path}/${name}` : name);
    const entry = (kind, name, does) => {
      const button = make("button", { type: "button" }, icon(kind), make("span", { textContent: name }));
      button.addEventListener("click", does);
      return make("li", {}, button);
    };
    const list = (to) => () => this.#list(to);
    const up = path ? [entry("folder", "..", list(path.split("/").slice(0, -1).join("/")))] : [];
    this.list.replaceChildren(...up, ...folders.map((name) => entry("folder", name, list(within(name)))), ...files.map((name) => entry("file", name, () => this.choose(within(name)))));
    if (this.list.childElementCount === 0) this.list.append(make("li", { className: "note", textContent: this.none }));
    this.#focus();
  }

  #focus() {
    if (this.dialog.open) this.list.querySelector("button")?.focus();
  }

  /** Send a file of the reader's, and choose it. */
  async upload(file) {
    const { welcome, transport } = this.app.model;
    if (this.dialog.open) this.dialog.close();
    if (welcome?.most_upload && file.size > welcome.most_upload) {
      this.app.complain(`${file.name}: ${sizeText(file.size)}; at most ${sizeText(welcome.most_upload)} can be sent`);
      return;
    }
    const tell = (part) => this.app.say(`Sending ${file.name}, ${sizeText(file.size)}${part > 0 ? `: ${Math.floor(100 * part)} %` : ""} …`);
    tell(0);
    try {
      const path = await transport.upload(file, this.kind, tell);
      this.app.say(`Sent ${file.name}`);
      this.choose(path);
    } catch (error) {
      this.app.complain(error.message || `${file.name}: could not be sent`);
    }
  }

  /** Take files that are dropped onto an element. */
  listen(element) {
    const hasFiles = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
    element.addEventListener("dragover", (event) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      element.classList.add("dropping");
    });
    for (const end of ["dragleave", "drop"]) element.addEventListener(end, (event) => { if (end === "drop" || event.target === element || !element.contains(event.relatedTarget)) element.classList.remove("dropping"); });
    element.addEventListener("drop", (event) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      if (event.dataTransfer.files.length > 0) this.upload(event.dataTransfer.files[0]);
    });
  }
}

/** What a scene names a file of the folder by: scene files may lie elsewhere. */
function wholePath(folder, path) {
  return /^([A-Za-z]:|[\\/~])/.test(path) ? path : `${folder.replace(/[\\/]$/, "")}/${path}`;
}

/** The same as people see it: within the folder. */
function pathWithin(folder, path) {
  const root = folder.replace(/[\\/]$/, "");
  return path.startsWith(root) && /[\\/]/.test(path[root.length] ?? "") ? path.slice(root.length + 1) : path;
}

class SaveDialog {
  constructor(app) {
    this.app = app;
    this.what = choiceButtons("What to save", [
      { value: "scene", text: "Scene", title: "A .toml that renders this view to the same bytes" },
      { value: "exr", text: "EXR", title: "The picture, scene-linear" },
      { value: "png", text: "PNG", title: "The picture, as it is shown" },
    ], (value) => this.choose(value));
    this.name = textInput("Name of the file");
    this.suffix = make("span", { className: "suffix" });
    this.where = make("p", { className: "note" });
    this.button = make("button", { type: "submit", className: "primary", textContent: "Save" });
    const form = make("form", { method: "dialog" }, this.what, make("label", { className: "save-name" }, this.name, this.suffix), this.where, make("div", { className: "buttons" }, this.button));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.save();
    });
    this.dialog = dialog("Save", form);
    app.model.on("saved", ({ what, path }) => app.say(`Saved ${what === "scene" ? "the scene" : "the picture"}: ${path}`));
  }

  ask(what = "scene") {
    if (this.app.model.welcome?.can.save === false || this.app.model.state === null) return;
    this.name.value ||= fileName(this.app.model.state.source).replace(/\.[^.]*$/, "").replace(/#+/g, "frame") + "_view";
    this.where.textContent = `Into ${this.app.model.welcome?.folder ?? "the viewer's folder"}`;
    this.choose(what);
    openOver(this.dialog).then(() => this.name.select());
  }

  choose(what) {
    this.chosen = what;
    this.what.set(what);
    this.suffix.textContent = what === "scene" ? ".toml" : `.${what}`;
  }

  /** What is seen is what is saved: the stage's exposure and view go into the scene. */
  save() {
    const name = this.name.value.trim();
    if (!name) return;
    const { model } = this.app;
    const { exposure, view } = model.state.show;
    const { image } = model.options;
    const changes = { ...(same(exposure, image.exposure) ? {} : { "image.exposure": exposure }), ...(view === image.view ? {} : { "image.view": view }) };
    if (this.chosen !== "exr" && Object.keys(changes).length > 0) model.edit(changes);
    model.send({ type: "save", what: this.chosen, name });
    this.dialog.close();
  }
}

function dialog(title, ...children) {
  const close = iconButton("remove", "Close", "Escape");
  const element = make("dialog", { "aria-label": title }, make("div", { className: "dialog-head" }, make("h2", { textContent: title }), close), ...children);
  close.addEventListener("click", () => element.close());
  element.addEventListener("click", (event) => { if (event.target === element) element.close(); });
  return element;
}

/** Open a dialog in the middle of what is seen of the viewer: a notebook's frame may be far taller than its window. */
function openOver(element) {
  return new Promise((opened) => {
    new IntersectionObserver(([{ intersectionRect: seen }], observer) => {
      observer.disconnect();
      const sides = { above: seen.top, after: window.innerWidth - seen.right, below: window.innerHeight - seen.bottom, before: seen.left };
      if (seen.height > 0) for (const [side, size] of Object.entries(sides)) element.style.setProperty(`--${side}`, `${Math.max(size, 0)}px`);
      if (element.isConnected && !element.open) element.showModal();
      opened();
    }).observe(element.closest(".tfm-viewer"));
  });
}

function sizeText(size) {
  return size >= 1e9 ? `${number(size / 1e9, 3)} GB` : size >= 1e6 ? `${number(size / 1e6, 3)} MB` : `${number(size / 1e3, 3)} kB`;
}
