// What the schema of scene files says of a key: which alternative a table is, and which values it takes.

class Schema {
  constructor(schema) {
    this.definitions = schema.$defs;
    this.sections = schema.properties;
  }

  /** The alternative that a table is: told by its `type` or `shape`, or by the key of its file. */
  of(section, table) {
    const definition = this.definitions[section];
    if (!definition?.oneOf) return definition ?? { properties: {} };
    const told = (one) => ["type", "shape"].some((key) => one.properties?.[key]?.const !== undefined && table[key] === one.properties[key].const);
    const has = (one) => (one.required ?? []).some((key) => one.properties[key]?.const === undefined && table[key] !== null && table[key] !== undefined);
    return definition.oneOf.find(told) ?? definition.oneOf.find(has) ?? { properties: {} };
  }

  /** The alternatives of a section that are told by a name. */
  named(section) {
    return (this.definitions[section]?.oneOf ?? [])
      .map((one) => ({ key: ["type", "shape"].find((key) => one.properties?.[key]?.const !== undefined), one }))
      .filter(({ key }) => key !== undefined)
      .map(({ key, one }) => ({ key, name: one.properties[key].const, one }));
  }

  /** Keys of a table, each with what a control has to know of it. */
  keys(section, table) {
    return Object.entries(this.of(section, table).properties)
      .filter(([, said]) => !/^as [a-z_]+$/.test(said.description ?? ""))
      .map(([key, said]) => this.key(key, said));
  }

  key(key, said) {
    const told = { key, description: said.description ?? "", initial: said.default };
    const ways = this.#ways(said);
    const numbers = ways.find((way) => way.type === "number" || way.type === "integer");
    const list = ways.find((way) => way.type === "array");
    const isAuto = ways.some((way) => way.const === "auto");
    const choices = ways.flatMap((way) => way.enum ?? (typeof way.const === "string" ? [way.const] : []));
    const of = list?.items ?? {};
    if (said.const !== undefined || ways.length === 0) return { ...told, kind: "fixed" };
    if (ways.some((way) => way.$ref?.endsWith("/phase"))) return { ...told, kind: "phase" };
    if (ways.some((way) => way.$ref?.endsWith("/medium"))) return { ...told, kind: "medium" };
    if (list?.minItems === 16 || of.minItems === 4) return { ...told, kind: "matrix" };
    if (list && list.maxItems === 3 && COLOURS.has(key)) return { ...told, kind: "colour", least: of.minimum, most: of.maximum, choices };
    if (list && list.maxItems <= 4) return { ...told, kind: "numbers", count: list.maxItems, whole: of.type === "integer", least: of.minimum, most: of.maximum, choices };
    if (list && of.type === "number") return { ...told, kind: "list" };
    if (list && of.enum) return { ...told, kind: "several", choices: of.enum };
    if (numbers) return { ...told, kind: "number", whole: numbers.type === "integer", ...limits(numbers), isAuto, choices: choices.filter((name) => name !== "auto") };
    if (ways.some((way) => way.type === "boolean")) return { ...told, kind: "boolean" };
    if (choices.length > 1) return { ...told, kind: "choice", choices };
    if (ways.some((way) => way.type === "string")) return { ...told, kind: "text" };
    return { ...told, kind: "fixed" };
  }

  /** The ways in which a value can be written, without keyframes. */
  #ways(said) {
    const more = [...(said.anyOf ?? []), ...(said.oneOf ?? [])];
    if (more.length > 0) return more.flatMap((way) => this.#ways(way));
    if (said.$ref?.endsWith("/keyframes")) return [];
    return Object.keys(said).some((name) => ["type", "enum", "const", "$ref"].includes(name)) ? [said] : [];
  }
}

/** Keys of three numbers that are a colour or a coefficient for each of red, green and blue. */
const COLOURS = new Set(["intensity", "sigma_s", "sigma_a", "emission", "albedo", "radiance", "background", "ground_albedo", "colour"]);
/** Keys that are worth a slider of powers: what doubles matters, not what is added. */
const LOGARITHMIC = new Set(["density", "density_scale", "opacity", "Le_scale", "temperature_scale", "radius", "reach", "bytes", "max_error", "cutoff", "res", "map_res", "points_apart", "steps", "emission_lights", "velocity_scale", "diameter", "exponent", "alpha"]);

function limits({ minimum, exclusiveMinimum, maximum, exclusiveMaximum }) {
  return { least: minimum ?? exclusiveMinimum, most: maximum ?? exclusiveMaximum, isOpen: [minimum === undefined, maximum === undefined] };
}

/** Ends of a slider: those of the schema where they are near, else around the value. */
function sliderRange({ key, whole, least, most, initial }, value) {
  const size = Math.max(Math.abs(value) || 0, typeof initial === "number" ? Math.abs(initial) : 0) || 1;
  if (LOGARITHMIC.has(key)) {
    let low = Math.max(least > 0 ? least : 0, (value > 0 ? value : size) / 50);
    let high = Math.min(most ?? Infinity, (value > 0 ? value : size) * 50);
    if (whole) [low, high] = [Math.max(1, Math.floor(low)), Math.ceil(high)];
    return { low, high, isLog: true };
  }
  const isNear = Number.isFinite(least) && Number.isFinite(most) && most - least <= 1000;
  if (isNear) return { low: least, high: most, isLog: false };
  const low = Number.isFinite(least) ? least : value < 0 || !whole ? -2 * size : 0;
  return { low, high: Math.min(most ?? Infinity, low + (low < 0 ? 4 : 2) * size + (whole ? 8 : 0)), isLog: false };
}

/** What an item of a list is, in a word or two. */
function itemName(section, table, index, count) {
  const what = { light: "Light", solid: "Solid", volume: "Volume" }[section];
  const kind = table.name || table.type || table.shape || fileOf(table);
  return `${what}${count > 1 ? ` ${index + 1}` : ""}${kind ? ` · ${kind}` : ""}`;
}

const fileOf = (table) => fileName(["file", "mesh", "points", "curves"].map((key) => table[key]).find((path) => typeof path === "string") ?? "");

/** Paths of the keys of what there may be several of: [{ path: "light.0", table, index }]; of one volume "volume". */
function items(options, section) {
  const found = options[section];
  if (Array.isArray(found)) return found.map((table, index) => ({ section, path: `${section}.${index}`, table, index, count: found.length }));
  return found ? [{ section, path: section, table: found, index: 0, count: 1 }] : [];
}
