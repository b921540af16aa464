// What every part uses: the data, the metrics, numbers as text, colours.
const data = JSON.parse(document.getElementById("data").textContent);
const pictures = JSON.parse(document.getElementById("pictures").textContent);
const byId = (id) => document.getElementById(id);

// The value drawn is `of(figure)`; a structural similarity is near 1, so what it lacks of 1 is drawn.
const percent = { log: true, better: "lower", of: (v) => v, text: (v) => `${digits(100 * v)} %`, tick: ".3~%" };
const decibel = { log: false, better: "higher", of: (v) => v, text: (v) => `${v.toFixed(1)} dB`, tick: "" };
const similarity = { log: true, better: "lower", of: (v) => 1 - v, text: (v) => v.toFixed(4), tick: "~g" };
const same = "against the dual march of the same steps";
const METRICS = [
  { id: "t_error", name: "error of T", short: "error of T", where: "density-weighted, relative, over the map's own light rays", ...percent },
  { id: "converged_lit_rmse", name: "RMSE, lit pixels, against converged", short: "RMSE conv.", where: "against the converged dual march, lit pixels", ...percent },
  { id: "lit_rmse", name: "RMSE, lit pixels", short: "RMSE", where: `${same}, lit pixels`, ...percent },
  { id: "converged_lit_psnr", name: "PSNR, lit pixels, against converged", short: "PSNR conv.", where: "against the converged dual march, lit pixels", ...decibel },
  { id: "lit_psnr", name: "PSNR, lit pixels", short: "PSNR", where: `${same}, lit pixels`, ...decibel },
  { id: "converged_lit_ssim", name: "1 − SSIM, lit pixels, against converged", short: "SSIM conv.", where: "against the converged dual march, lit pixels", ...similarity },
  { id: "lit_ssim", name: "1 − SSIM, lit pixels", short: "SSIM", where: `${same}, lit pixels`, ...similarity },
  { id: "rmse", name: "RMSE, whole frame", short: "RMSE frame", where: `${same}, whole frame`, ...percent },
  { id: "psnr", name: "PSNR, whole frame", short: "PSNR frame", where: `${same}, whole frame`, ...decibel },
  { id: "ssim", name: "1 − SSIM, whole frame", short: "SSIM frame", where: `${same}, whole frame`, ...similarity },
  { id: "converged_rmse", name: "RMSE, whole frame, against converged", short: "RMSE frame conv.", where: "against the converged dual march, whole frame", ...percent },
  { id: "converged_psnr", name: "PSNR, whole frame, against converged", short: "PSNR frame conv.", where: "against the converged dual march, whole frame", ...decibel },
  { id: "converged_ssim", name: "1 − SSIM, whole frame, against converged", short: "SSIM frame conv.", where: "against the converged dual march, whole frame", ...similarity },
  { id: "flip", name: "FLIP", short: "FLIP", where: `HDR-FLIP ${same}`, ...percent, text: (v) => v.toPrecision(3), tick: "~g" },
].filter((metric) => data.groups.some((group) => group.rows.some((row) => row[metric.id] !== null)));

const state = { group: data.groups[0], metric: METRICS[0], row: null, hidden: new Set(), curves: new Set() };

/** A figure of a row: a number, Infinity, or null where there is none. */
function figure(row, id) {
  const value = row === null ? null : row[id];
  return value === "inf" ? Infinity : value === "-inf" ? -Infinity : (value ?? null);
}

/** Three significant digits, without an exponent where that can be read. */
function number(value) {
  if (value === null) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e-4 || size >= 1e7) return value.toExponential(1);
  return size >= 1000 ? Math.round(value).toString() : String(Number(value.toPrecision(3)));
}

/** As `number`, with three digits even where the last are zeros: columns line up. */
const digits = (value) => (value !== 0 && Math.abs(value) >= 0.01 && Math.abs(value) < 1000 ? value.toPrecision(3) : number(value));

function metricText(metric, row) {
  const value = figure(row, metric.id);
  return value === null ? "–" : Number.isFinite(value) ? metric.text(value) : number(value);
}

/** What is drawn: null where there is no figure or the axis has no place for it. */
function drawn(metric, row) {
  const value = figure(row, metric.id);
  if (value === null || !Number.isFinite(value)) return null;
  const shown = metric.of(value);
  return metric.log && shown <= 0 ? null : shown;
}

/** Order by what is better; rows without the figure come last. */
function compareBy(metric) {
  const rank = (row) => {
    const value = figure(row, metric.id);
    if (value === null) return Infinity;
    return metric.better === "lower" ? metric.of(value) : -metric.of(value);
  };
  return (a, b) => (rank(a) === rank(b) ? 0 : rank(a) - rank(b));
}

const seconds = (row) => row.seconds_light_pass + row.seconds_view_pass;
const rowName = (row) => `${row.basis} · n = ${row.coeffs}${row.variant ? ` · ${row.variant}` : ""}`;
const seriesOf = (row) => JSON.stringify([row.basis, row.variant]);

const seriesName = (series) => (series.variant ? `${series.basis} · ${series.variant}` : series.basis);

/** The maps that differ in size only, in the order of the rows. */
function seriesOfGroup(group) {
  const found = new Map();
  for (const row of group.rows) {
    const id = seriesOf(row);
    if (!found.has(id)) found.set(id, { id, basis: row.basis, variant: row.variant, rows: [] });
    found.get(id).rows.push(row);
  }
  const list = [...found.values()];
  for (const series of list) series.nth = list.filter((other) => other.basis === series.basis).indexOf(series);
  return list;
}

// Colours that differ in lightness and hue, each with a symbol of its own; a basis keeps its own from report
// to report.
const BASES = ["klt", "dct", "hcos", "fourier", "legendre", "slices", "piecewise", "nodes", "moments"];
const COLOURS = {
  light: ["#d9480f", "#2f5fc4", "#0b8a83", "#a66a00", "#2b8a3e", "#7f6152", "#c2378f", "#7048c8", "#546e7a"],
  dark: ["#ff8f5e", "#86a8ff", "#4fd1c5", "#f2b84b", "#74d680", "#cbab9b", "#f285c8", "#b79bff", "#a9bcc6"],
};
const SYMBOLS = ["circle", "square", "diamond", "triangle-up", "triangle-down", "pentagon", "hexagon", "star", "cross"];
const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"];
const SVG_DASHES = ["", "5 3", "1.5 2.5", "6 2 1.5 2", "8 3", "8 3 2 3"];

const others = [...new Set(data.groups.flatMap((g) => g.rows.map((r) => r.basis)))].filter((b) => !BASES.includes(b));
const basisIndex = (basis) => (BASES.includes(basis) ? BASES.indexOf(basis) : BASES.length + others.indexOf(basis));
const theme = () => document.body.dataset.theme;
const colourOf = (basis) => COLOURS[theme()][basisIndex(basis) % BASES.length];
const symbolOf = (basis) => SYMBOLS[(basisIndex(basis) + Math.floor(basisIndex(basis) / BASES.length)) % SYMBOLS.length];
const css = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();

function swatch(basis, nth = 0) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("width", "22");
  svg.setAttribute("height", "8");
  svg.setAttribute("aria-hidden", "true");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  for (const [name, value] of Object.entries({ x1: 0, y1: 4, x2: 22, y2: 4, stroke: colourOf(basis), "stroke-width": 3 })) {
    line.setAttribute(name, value);
  }
  line.setAttribute("stroke-dasharray", SVG_DASHES[nth % SVG_DASHES.length]);
  svg.append(line);
  return svg;
}

const dot = (basis) => {
  const mark = make("span", { "aria-hidden": "true" });
  Object.assign(mark.style, { background: colourOf(basis), width: "10px", height: "10px", borderRadius: "50%", flex: "none", display: "inline-block" });
  return mark;
};
