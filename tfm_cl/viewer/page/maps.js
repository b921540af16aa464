// The coefficients of a light's map, one at a time, as a picture.

const LAST_COEFFICIENT = 511;

class Maps {
  constructor(app) {
    Object.assign(this, { app, isOn: false, coefficient: 0, fields: [] });
    this.light = make("select", { "aria-label": "Light of the map" });
    this.which = make("input", { type: "number", className: "number", min: 0, max: LAST_COEFFICIENT, value: 0, "aria-label": "Coefficient" });
    this.field = make("select", { "aria-label": "Field of the map", title: "Media of different colours have maps of their own" });
    const close = iconButton("remove", "Close the coefficient map", "", () => this.toggle(false));
    this.element = make("div", { className: "tool-group maps", hidden: true, role: "group", "aria-label": "Coefficient map" },
      labelled("Coefficient", this.which), this.light, this.field, close);
    this.field.addEventListener("change", () => this.#ask());
    this.light.addEventListener("change", () => this.#ask());
    this.which.addEventListener("change", () => this.#ask());
    app.model.on("picture", ({ header }) => { if (header.which === "map") this.#drawFields(header); });
    app.model.on("opened", () => { if (this.isOn) this.toggle(false); });
  }

  get label() {
    const field = this.fields.length > 1 ? `, field ${this.fields[this.fieldIndex]}` : "";
    return `coefficient ${this.coefficient} of ${this.app.lightName(this.lightIndex)}${field}`;
  }

  get lightIndex() {
    return Number(this.light.value || 0);
  }

  get fieldIndex() {
    return Number(this.field.value || 0);
  }

  #send(coefficient) {
    this.app.model.send({ type: "map", light: this.lightIndex, coefficient, field: this.fieldIndex });
  }

  /** Three fields are red, green and blue; fewer are media of one colour each. */
  #drawFields({ field, fields }) {
    this.fields = fields === 3 ? ["red", "green", "blue"] : ["1", "2"].slice(0, fields);
    setOptions(this.field, this.fields.map((text, value) => ({ value, text })), field);
    this.field.hidden = fields < 2;
    this.app.compare.draw();
  }

  toggle(isOn = !this.isOn) {
    this.isOn = isOn;
    this.element.hidden = !isOn;
    this.draw();
    if (isOn) {
      this.app.stage.flip.shown = "map";
      this.app.stage.flip.wiping = false;
      this.#ask();
    } else {
      this.#send(-1);
      this.app.stage.drop("map");
    }
    this.app.stage.frame();
    this.app.compare.draw();
    this.app.drawTools();
  }

  #ask() {
    this.coefficient = clamp(Math.round(Number(this.which.value) || 0), 0, LAST_COEFFICIENT);
    this.which.value = this.coefficient;
    this.#send(this.coefficient);
    this.app.compare.draw();
  }

  draw() {
    if (!this.isOn) return;
    const lights = this.app.lightChoices();
    setOptions(this.light, lights, Math.min(this.lightIndex, Math.max(lights.length - 1, 0)));
    this.light.hidden = lights.length < 2;
    this.field.hidden = this.fields.length < 2;
  }
}
