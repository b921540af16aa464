// All figures of a volume, to be sorted by any of them.

const order = { id: null, up: true };
const SHOWN = ["t_error", "converged_lit_rmse", "lit_rmse", "lit_psnr", "lit_ssim", "flip"];

/** A column: its heading, the value it is sorted by, and its text. */
function columns() {
  const every = byId("every").checked;
  const setting = (id, name) => ({ id, name, value: (row) => row[id] ?? null, text: (row) => String(row[id] ?? "–"), words: typeof state.group.rows[0][id] === "string" });
  const varying = state.group.varying.map((id) => setting(id, { density_weighting: "α", map_res: "map\ntexels" }[id] ?? id.replaceAll("_", " ")));
  const measured = METRICS.filter((metric) => every || SHOWN.includes(metric.id)).map((metric) => ({
    id: metric.id, measure: metric, value: (row) => figure(row, metric.id), text: (row) => metricText(metric, row).replace(/ (%|dB)$/, ""),
    name: `${heading(metric)}${metric.id.endsWith("psnr") ? "\n/ dB" : metric.id.endsWith("rmse") || metric.id === "t_error" ? "\n/ %" : ""}`,
  }));
  const time = (id, name) => ({ id, name: `${name}\n/ ms`, value: (row) => row[id], text: (row) => number(1e3 * row[id]) });
  return [
    { id: "basis", name: "map", value: (row) => row.basis, words: true },
    { id: "coeffs", name: "n", value: (row) => row.coeffs, text: (row) => String(row.coeffs) },
    ...varying,
    { id: "bytes_per_texel", name: "bytes\na texel", value: (row) => row.bytes_per_texel, text: (row) => number(row.bytes_per_texel) },
    { id: "budgets", name: "best of\nits basis", value: (row) => row.budgets.length, words: true, text: (row) => (row.budgets.length ? `★ ${row.budgets.join(", ")} B` : ""), className: "star" },
    ...measured,
    time("seconds_light_pass", "light"),
    time("seconds_view_pass", "view"),
    { id: "speed", name: "against\ndual", value: (row) => (seconds(row) > 0 ? row.seconds_reference / seconds(row) : null), text: (row) => (seconds(row) > 0 ? `${(row.seconds_reference / seconds(row)).toFixed(1)}×` : "–") },
    { id: "map_bytes", name: "maps\n/ MiB", value: (row) => row.map_bytes, text: (row) => number(row.map_bytes / 2 ** 20) },
  ];
}

function heading(metric) {
  const [kind, ...rest] = metric.short.split(" ");
  return [metric.id === "t_error" ? "error of T" : metric.id.includes("lit_") ? `${kind} lit` : kind, ...(metric.id === "t_error" ? [] : rest)].join(" ").replace(" conv.", "\nconverged");
}

function drawTable() {
  const all = columns();
  const rows = [...state.group.rows];
  const by = all.find((column) => column.id === order.id);
  if (by !== undefined) rows.sort(comparison(by));
  const head = make("tr", {}, ...all.map((column) => headingCell(column)));
  const bodies = rows.map((row) => {
    const line = make("tr", { className: row === state.row ? "selected" : "" }, ...all.map((column) => cell(column, row)));
    line.dataset.key = row.key;
    return line;
  });
  byId("table").replaceChildren(make("thead", {}, head), make("tbody", {}, ...bodies));
}

/** Missing values come last either way. */
function comparison(column) {
  return (a, b) => {
    const [x, y] = [column.value(a), column.value(b)];
    if (x === null || y === null) return (x === null) - (y === null);
    const sign = order.up ? 1 : -1;
    if (typeof x === typeof y) return sign * (x < y ? -1 : x > y ? 1 : 0);
    return sign * (typeof x === "number" ? -1 : 1);
  };
}

function headingCell(column) {
  const sorted = column.id === order.id ? (order.up ? "ascending" : "descending") : "none";
  const button = make("button", { type: "button", textContent: column.name });
  button.addEventListener("click", () => {
    order.up = column.id === order.id ? !order.up : true;
    order.id = column.id;
    drawTable();
    byId("table").querySelector(`[data-column="${CSS.escape(column.id)}"] button`).focus();
  });
  const found = make("th", { scope: "col", "aria-sort": sorted, className: column.words ? "text" : "", title: column.measure?.where ?? "" }, button);
  found.dataset.column = column.id;
  return found;
}

function cell(column, row) {
  if (column.id === "basis") {
    const button = make("button", { type: "button", title: "show in the viewer" }, dot(row.basis), make("span", { textContent: row.basis }));
    button.addEventListener("click", () => {
      select(row);
      byId("viewer").scrollIntoView({ block: "start" });
    });
    return make("td", {}, button);
  }
  const found = make("td", { textContent: column.text(row), className: [column.words ? "text" : "", column.className ?? ""].join(" ") });
  if (column.measure) {
    found.classList.add("measure");
    found.style.setProperty("--share", `${share(column.measure, row)}%`);
  }
  return found;
}

/** Where a figure lies between the volume's best (little) and worst (all), as drawn. */
function share(metric, row) {
  const scale = (value) => (metric.log ? Math.log(value) : value);
  const values = state.group.rows.map((other) => drawn(metric, other)).filter((value) => value !== null).map(scale);
  const own = drawn(metric, row);
  if (own === null || values.length < 2) return 0;
  const [low, high] = [Math.min(...values), Math.max(...values)];
  if (high <= low) return 0;
  const part = (scale(own) - low) / (high - low);
  return Math.round(3 + 97 * (metric.better === "lower" ? part : 1 - part));
}
