// Controls of the panel: one for each kind of value. Each is { element, set(value) }, and says what was changed by
// `change(value, drag)`.

const SLIDER = 1000; // positions

/** A field of a number: `read()` is null where there is none, `put(value)` leaves alone what is being typed. */
function numberInput(label, { whole = false, step = null, digits = 5 } = {}) {
  const input = textInput(label, { inputMode: whole ? "numeric" : "decimal", className: "number" });
  input.read = () => {
    const value = Number(input.value.replace(",", ".").replace("−", "-"));
    return input.value.trim() === "" || !Number.isFinite(value) ? null : whole ? Math.round(value) : value;
  };
  input.put = (value) => {
    if (document.activeElement !== input || !input.isTouched) input.value = typeof value === "number" ? number(value, digits) : typeof value === "string" ? value : "";
  };
  input.addEventListener("input", () => { input.isTouched = true; });
  let before = "";
  input.addEventListener("focus", () => {
    input.isTouched = false;
    before = input.value;
    input.select();
  });
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") input.isTouched = false;
    if (event.key === "Escape") Object.assign(input, { isTouched: false, value: before });
    const by = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    const value = input.read();
    if (by === undefined || value === null) return;
    event.preventDefault();
    const size = step ?? (whole ? 1 : 10 ** Math.floor(Math.log10(Math.max(Math.abs(value), 0.1)) - 1));
    input.isTouched = false;
    input.value = number(value + by * size * (event.shiftKey ? 10 : 1), 6);
    input.dispatchEvent(new Event("change"));
  });
  return input;
}

/** A slider whose ends follow the value, but not while it is held. */
function slider(label, key, change) {
  const input = make("input", { type: "range", min: 0, max: SLIDER, step: 1, "aria-label": label });
  let range = { low: 0, high: 0, isLog: false }; // until there is a value
  let [isHeld, isOpen] = [false, false];
  const toValue = (at) => {
    const t = at / SLIDER;
    const value = range.isLog ? (range.low > 0 ? range.low * (range.high / range.low) ** t : range.high * (t === 0 ? 0 : 1e-4 ** (1 - t))) : range.low + t * (range.high - range.low);
    return key.whole ? Math.round(value) : Number(value.toPrecision(4));
  };
  const toPlace = (value) => {
    const t = range.isLog ? (range.low > 0 ? Math.log(value / range.low) / Math.log(range.high / range.low) : 1 + Math.log(value / range.high) / Math.log(1e4)) : (value - range.low) / (range.high - range.low);
    return Math.round(SLIDER * clamp(Number.isFinite(t) ? t : 0, 0, 1));
  };
  const say = (drag) => {
    isOpen = drag;
    change(within(key, toValue(Number(input.value))), drag);
  };
  // Where it is left as it was, browsers tell no change; the drag ends nevertheless.
  const end = () => setTimeout(() => { if (isOpen) say(false); }, 0);
  input.addEventListener("pointerdown", () => { isHeld = true; });
  for (const name of ["pointerup", "pointercancel", "blur"]) {
    input.addEventListener(name, () => {
      isHeld = false;
      end();
    });
  }
  input.addEventListener("input", () => say(true));
  input.addEventListener("change", () => say(false));
  input.addEventListener("keydown", (event) => {
    const by = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (by === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const next = toValue(clamp(Number(input.value) + (SLIDER / 100) * by, 0, SLIDER));
    const now = toValue(Number(input.value));
    change(within(key, key.whole && next === now ? now + Math.sign(by) : next), false);
  });
  input.put = (value) => {
    if (typeof value !== "number") return;
    const place = (value - range.low) / (range.high - range.low);
    const isTiny = !range.isLog && value !== 0 && Math.abs(value) < 0.02 * range.high;
    const isAtEnd = !(place >= 0 && place < 0.98) || (range.isLog && value > 0 && value < 1.2 * range.low);
    if (!isHeld && (isAtEnd || isTiny)) range = sliderRange(key, value);
    input.value = toPlace(value);
    input.style.setProperty("--part", `${(100 * input.value) / SLIDER}%`);
    input.setAttribute("aria-valuetext", number(value));
  };
  return input;
}

/** A value within what the schema allows; open ends are kept clear of. */
function within({ least, most, isOpen = [false, false], whole }, value) {
  const gap = whole ? 1 : 1e-3;
  return clamp(value, least === undefined ? -Infinity : least + (isOpen[0] ? gap : 0), most === undefined ? Infinity : most - (isOpen[1] ? gap : 0));
}

const FIELDS = {
  number(key, label, change) {
    const field = numberInput(label, key);
    const range = slider(label, key, (value, drag) => { field.put(value); change(value, drag); });
    const auto = key.isAuto || key.choices.length > 0 ? make("button", { type: "button", className: "small", textContent: key.isAuto ? "auto" : key.choices[0], "aria-pressed": "false", title: "Let it be chosen" }) : null;
    let last = null;
    field.addEventListener("change", () => {
      const value = field.read();
      if (value === null || value === last) return;
      last = value; // a field that is left says it once more
      change(value, false);
    });
    auto?.addEventListener("click", () => change(auto.getAttribute("aria-pressed") === "true" ? (typeof key.initial === "number" ? key.initial : key.least > 0 ? key.least : 1) : auto.textContent, false));
    const element = make("span", { className: "line" }, range, field, ...(auto ? [auto] : []));
    return {
      element,
      set(value) {
        last = value;
        field.put(value);
        range.put(typeof value === "number" ? value : typeof key.initial === "number" ? key.initial : 1);
        range.classList.toggle("unset", typeof value !== "number");
        auto?.setAttribute("aria-pressed", String(value === auto.textContent));
      },
    };
  },

  numbers(key, label, change) {
    const names = key.count === 2 ? ["width", "height"] : key.count === 4 ? ["x0", "y0", "x1", "y1"] : ["x", "y", "z"];
    let value = null;
    const fields = names.map((name, index) => {
      const field = numberInput(`${label} ${name}`, { ...key, digits: key.whole ? 9 : 4 });
      field.title = name;
      field.dataset.axis = name;
      field.addEventListener("change", () => {
        const typed = field.read();
        if (typed === null || typed === value?.[index]) return;
        const next = Array.isArray(value) ? [...value] : fields.map((other) => other.read() ?? (key.key === "scale" ? 1 : 0));
        next[index] = typed;
        value = next;
        change(next, false);
      });
      return field;
    });
    return {
      element: make("span", { className: "line axes" }, ...fields),
      set(given) {
        value = typeof given === "number" ? Array(key.count).fill(given) : given;
        fields.forEach((field, index) => {
          field.put(Array.isArray(value) ? value[index] : index === 0 ? value : null);
        });
      },
    };
  },

  colour(key, label, change) {
    const swatch = make("input", { type: "color", "aria-label": `${label}: colour` });
    const isFraction = key.most === 1;
    const strength = slider(`${label}: strength`, { key: "density", least: 0, most: isFraction ? 1 : undefined, initial: 1 }, (size, drag) => change(scaled(size), drag));
    if (isFraction) strength.hidden = true;
    let value = [0, 0, 0];
    const peak = () => Math.max(...value);
    const scaled = (size) => (peak() > 0 ? rounded(times(value, size / peak())) : Array(3).fill(size));
    const fields = ["red", "green", "blue"].map((name, index) => {
      const field = numberInput(`${label} ${name}`, { digits: 4 });
      field.dataset.axis = name[0];
      field.addEventListener("change", () => {
        const typed = field.read();
        if (typed === null || typed === value[index]) return;
        value = value.map((old, at) => (at === index ? clamp(typed, 0, key.most ?? Infinity) : old));
        change(value, false);
      });
      return field;
    });
    let isOpen = false;
    const pick = (drag) => {
      isOpen = drag;
      const size = isFraction ? 1 : peak() || 1;
      const linear = [1, 3, 5].map((at) => toLinear(parseInt(swatch.value.slice(at, at + 2), 16) / 255));
      // What is darker in the swatch keeps its strength, which the slider says.
      const top = isFraction ? 1 : Math.max(...linear) || 1;
      change(rounded(linear.map((part) => (part * size) / top)), drag);
    };
    swatch.addEventListener("input", () => pick(true));
    swatch.addEventListener("change", () => pick(false));
    swatch.addEventListener("blur", () => { if (isOpen) pick(false); });
    return {
      element: make("span", { className: "line colour" }, swatch, ...fields, strength),
      set(given) {
        const isNumber = typeof given === "number";
        value = isNumber ? Array(3).fill(given) : Array.isArray(given) ? given : [0, 0, 0];
        const isUnset = !isNumber && !Array.isArray(given);
        fields.forEach((field, index) => {
          field.put(!isUnset ? value[index] : index === 0 ? given : null);
        });
        const size = isFraction ? 1 : peak() || 1;
        swatch.value = `#${value.map((part) => Math.round(255 * toDisplay(clamp(part / size, 0, 1))).toString(16).padStart(2, "0")).join("")}`;
        strength.put(peak());
      },
    };
  },

  choice(key, label, change) {
    const select = make("select", { "aria-label": label });
    select.addEventListener("change", () => change(select.value, false));
    return {
      element: make("span", { className: "line" }, select),
      set(value) {
        const options = key.choices.map((name) => ({ value: name, text: name === "" ? "none" : name }));
        const isUnset = value === null || value === undefined;
        const none = isUnset && !key.choices.includes("") ? [{ value: "", text: "–" }] : [];
        setOptions(select, [...none, ...options], isUnset ? "" : value);
      },
    };
  },

  boolean(key, label, change) {
    const box = make("input", { type: "checkbox", "aria-label": label });
    box.addEventListener("change", () => change(box.checked, false));
    return { element: make("span", { className: "line" }, box), set(value) { box.checked = value === true; } };
  },

  several(key, label, change) {
    const boxes = key.choices.map((name) => {
      const box = make("input", { type: "checkbox", value: name });
      box.addEventListener("change", () => change(boxes.filter((one) => one.checked).map((one) => one.value), false));
      return box;
    });
    const element = make("span", { className: "several", role: "group", "aria-label": label }, ...boxes.map((box) => make("label", {}, box, box.value)));
    return { element, set(value) { for (const box of boxes) box.checked = (value ?? []).includes(box.value); } };
  },

  text(key, label, change) {
    const field = textInput(label);
    let last = null;
    field.addEventListener("change", () => { if (field.value !== (last ?? "")) change(field.value, false); });
    return {
      element: make("span", { className: "line" }, field),
      set(value) {
        last = value;
        if (document.activeElement !== field) field.value = typeof value === "string" ? value : value === null || value === undefined ? "" : JSON.stringify(value);
        field.title = field.value;
      },
    };
  },

  /** The path of a table of a phase function. */
  table(key, label, change, app) {
    const folder = () => app.model.welcome?.folder ?? "";
    const choose = (path) => change(path && wholePath(folder(), path), false);
    const text = FIELDS.text(key, label, choose);
    const pick = iconButton("folder", `${label}: choose a file`, "", () => app.tables.ask(choose));
    pick.classList.add("tiny");
    text.element.append(pick);
    return { element: text.element, set(value) { text.set(pathWithin(folder(), value ?? "")); } };
  },

  matrix(key, label, change) {
    const field = textInput(`${label}: 16 numbers`, { title: "16 numbers, row by row" });
    let last = [];
    field.addEventListener("change", () => {
      // What is as it is shown keeps all of its digits.
      const numbers = (field.value.match(/[-+.\deE]+/g) ?? []).map((text, index) => (index < last.length && text === number(last[index]) ? last[index] : Number(text)));
      const isMatrix = numbers.length === 16 && numbers.every(Number.isFinite);
      field.setAttribute("aria-invalid", String(!isMatrix));
      if (isMatrix) change(numbers, false);
    });
    return {
      element: make("span", { className: "line" }, field),
      set(value) {
        last = value?.flat() ?? [];
        if (document.activeElement !== field) field.value = last.map((one) => number(one)).join(" ");
      },
    };
  },

  /** Any number of numbers. */
  list(key, label, change) {
    const field = textInput(label, { title: "Numbers, with spaces or commas between them" });
    field.addEventListener("change", () => {
      const numbers = (field.value.match(/[^\s,;]+/g) ?? []).map(Number);
      field.setAttribute("aria-invalid", String(!numbers.every(Number.isFinite)));
      if (numbers.every(Number.isFinite)) change(numbers, false);
    });
    return {
      element: make("span", { className: "line" }, field),
      set(value) { if (document.activeElement !== field) field.value = (value ?? []).join(" "); },
    };
  },

  /** A kind, and what is to be said of that kind. */
  phase(key, label, change, app) {
    const kinds = app.schema.named("phase").filter(({ name }) => !key.isPart || name !== "mix");
    const select = make("select", { "aria-label": label });
    const inner = make("div", { className: "inner" });
    let value = { type: "isotropic" };
    let built = "";
    let fields = [];
    const shown = ({ key: name, kind }) => (value.type === "table" ? (value.file ? ["file"] : ["file", "values", "cosines"]).includes(name) : kind === "number");
    // A table has a file, or numbers.
    const changed = (name, next) => (name !== "file" ? { ...value, [name]: next } : { type: value.type, ...(next ? { file: next } : BEGINS.table()) });
    const build = () => {
      const { one } = kinds.find(({ name }) => name === value.type) ?? { one: { properties: {} } };
      fields = Object.entries(one.properties).map(([name, said]) => app.schema.key(name, said)).filter(shown).map((part) => {
        const field = FIELDS[part.key === "file" ? "table" : part.kind](part, `${label} ${part.key}`, (next, drag) => change(changed(part.key, next), drag), app);
        return { element: named(part.key, part.description, field), set: () => field.set(value[part.key] ?? part.initial) };
      });
      if (value.type === "mix") fields.push(mixture(label, (next, drag) => change({ ...value, ...next }, drag), app));
      inner.replaceChildren(...fields.map(({ element }) => element));
    };
    select.addEventListener("change", () => {
      const { one } = kinds.find(({ name }) => name === select.value);
      const initial = Object.entries(one.properties).filter(([name, said]) => name !== "type" && said.default !== undefined).map(([name, said]) => [name, said.default]);
      change({ type: select.value, ...(BEGINS[select.value]?.(value) ?? Object.fromEntries(initial)) }, false);
    });
    return {
      element: make("div", { className: "phase" }, make("span", { className: "line" }, select), inner),
      set(given) {
        value = typeof given === "string" ? { type: given.split(":")[0] } : given ?? { type: "isotropic" };
        const options = kinds.map(({ name }) => ({ value: name, text: name }));
        if (!kinds.some(({ name }) => name === value.type)) options.push({ value: value.type, text: value.type });
        setOptions(select, options, value.type);
        const kind = `${value.type} ${Boolean(value.file)}`;
        if (built !== kind) build();
        built = kind;
        for (const field of fields) field.set(value);
      },
    };
  },
};

/** What phase functions begin with that have no defaults. */
const BEGINS = {
  table: () => ({ values: [1, 1] }),
  mix: (before) => ({ phases: [before, { type: "rayleigh" }], weights: [1, 1] }),
};
const MOST_PARTS = 8;
/** Named apart from a key `weight` that the part itself may have. */
const WEIGHT = { key: "mix_weight", description: "the part of what is scattered that it scatters, over the sum of all", kind: "number", least: 0, initial: 1, choices: [] };

/** A control in a row with its name. */
const named = (name, title, field) => make("div", { className: "row" }, make("span", { className: "name", textContent: spaced(name), title }), field.element);

/** The parts of a mixture of phase functions, each with its weight. */
function mixture(label, change, app) {
  const add = make("button", { type: "button", className: "small", textContent: "Add a part" });
  const element = make("div", { className: "parts" }, add);
  const parts = [];
  let value = { phases: [], weights: [] };
  const without = (list, index) => list.filter((_, at) => at !== index);
  add.addEventListener("click", () => change({ phases: [...value.phases, { type: "isotropic" }], weights: [...value.weights, 1] }, false));
  const append = () => {
    const index = parts.length;
    const name = `${label}, part ${index + 1}`;
    const phase = FIELDS.phase({ isPart: true }, name, (next, drag) => change({ phases: value.phases.with(index, next) }, drag), app);
    const weight = FIELDS.number(WEIGHT, `${name}: mix weight`, (next, drag) => change({ weights: value.weights.with(index, next) }, drag));
    const remove = iconButton("remove", `Remove ${name}`, "", () => change({ phases: without(value.phases, index), weights: without(value.weights, index) }, false));
    remove.classList.add("tiny");
    phase.element.firstChild.append(remove);
    phase.element.append(named(WEIGHT.key, WEIGHT.description, weight));
    add.before(phase.element);
    parts.push({ phase, weight, remove });
  };
  return {
    element,
    set(given) {
      value = given;
      const count = value.phases.length;
      while (parts.length < count) append();
      while (parts.length > count) parts.pop().phase.element.remove();
      parts.forEach(({ phase, weight, remove }, index) => {
        phase.set(value.phases[index]);
        weight.set(value.weights[index]);
        remove.disabled = count === 1;
      });
      add.disabled = count >= MOST_PARTS;
    },
  };
}

const toLinear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
const toDisplay = (v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
