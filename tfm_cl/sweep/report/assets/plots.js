// The plots, by plotly.js, and the legends that switch their lines; those are buttons, for keyboards.

/** Text as plotly.js shall draw it: it reads some markup. */
const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

const CONFIG = {
  displaylogo: false,
  responsive: true,
  showSendToCloud: false,
  // A finger needs the room, and has no pointer that could bring the buttons forth.
  displayModeBar: matchMedia("(pointer: coarse)").matches ? false : "hover",
  modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
};

function layout(extra) {
  const axis = () => ({
    gridcolor: css("--line"), zerolinecolor: css("--line"), linecolor: css("--line"), automargin: true,
    tickfont: { size: 11.5 }, title: { font: { size: 12.5 }, standoff: 8 },
  });
  const base = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "closest",
    font: { family: "system-ui, sans-serif", size: 12.5, color: css("--ink") },
    margin: { l: 56, r: 14, t: 22, b: 46 },
    // A finger that scrolls the page must not zoom.
    dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom",
    hoverlabel: { bgcolor: css("--card"), bordercolor: css("--line"), font: { color: css("--ink"), size: 12.5 }, align: "left" },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: css("--faint"), activecolor: css("--accent") },
  };
  for (const [name, value] of Object.entries(extra)) {
    base[name] = /^[xy]axis/.test(name) ? merge(axis(), value) : value;
  }
  return base;
}

function merge(base, extra) {
  for (const [name, value] of Object.entries(extra)) {
    base[name] = name === "title" ? { ...base.title, text: value } : value;
  }
  return base;
}

/** A logarithmic axis from the values it must hold, with ticks of 1, 2, 5, or of powers of two. */
function logAxis(values, { binary = false, pad = 0.12, text = number } = {}) {
  const finite = values.filter((v) => v !== null && v > 0);
  if (finite.length === 0) return { type: "log" };
  let low = Math.log10(Math.min(...finite));
  let high = Math.log10(Math.max(...finite));
  const margin = Math.max(pad * (high - low), 0.06);
  low -= margin;
  high += margin;
  const candidates = [];
  if (binary) for (let i = -4; i < 40; i++) candidates.push(2 ** i);
  else {
    const factors = high - low < 0.8 ? [1, 1.5, 2, 3, 4, 5, 6, 8] : high - low < 2.2 ? [1, 2, 5] : [1];
    for (let e = Math.floor(low); e <= Math.ceil(high); e++) for (const f of factors) candidates.push(f * 10 ** e);
  }
  const ticks = candidates.filter((v) => Math.log10(v) >= low && Math.log10(v) <= high);
  return { type: "log", range: [low, high], tickvals: ticks, ticktext: ticks.map(text) };
}

function qualityAxis(metric, values) {
  const title = `${metric.name}${metric.id === "t_error" ? " (transmittance)" : ""}`;
  if (!metric.log) return { title: `${title} / dB` };
  const text = metric.tick.endsWith("%") ? (v) => `${number(100 * v)} %` : number;
  return { title, ...logAxis(values, { text }) };
}

function hover(row) {
  const lines = [
    `<b>${plain(rowName(row))}</b>`,
    `${plain(state.metric.name)}: ${plain(drawnText(row))}`,
    `${number(row.bytes_per_texel)} bytes per texel`,
    `light ${ms(row.seconds_light_pass)} + view ${ms(row.seconds_view_pass)}`,
  ];
  return lines.join("<br>");
}

const ms = (value) => `${number(1e3 * value)} ms`;
function drawnText(row) {
  const value = drawn(state.metric, row);
  if (value === null) return metricText(state.metric, row);
  return state.metric.id.endsWith("ssim") ? number(value) : metricText(state.metric, row);
}

/** A line for each series that is shown. */
function lines(x, opacity) {
  return seriesOfGroup(state.group)
    .filter((series) => !state.hidden.has(series.id))
    .map((series) => {
      const rows = series.rows.filter((row) => drawn(state.metric, row) !== null && x(row) > 0);
      rows.sort((a, b) => a.bytes_per_texel - b.bytes_per_texel);
      return {
        type: "scatter", mode: "lines+markers", name: plain(`${series.basis} ${series.variant}`),
        x: rows.map(x), y: rows.map((row) => drawn(state.metric, row)), customdata: rows.map((row) => row.key),
        text: rows.map(hover), hovertemplate: "%{text}<extra></extra>",
        line: { color: faded(colourOf(series.basis), opacity), width: 2, dash: DASHES[series.nth % DASHES.length] },
        marker: {
          color: series.nth % 2 ? css("--card") : colourOf(series.basis), symbol: symbolOf(series.basis), size: 8.5,
          line: { color: colourOf(series.basis), width: 1.6 },
        },
      };
    });
}

const faded = (colour, opacity) => colour + Math.round(255 * opacity).toString(16).padStart(2, "0");

/** A ring around the map that is shown in the viewer. */
function ring(x) {
  const row = state.row;
  const shown = row !== null && !state.hidden.has(seriesOf(row)) && drawn(state.metric, row) !== null && x(row) > 0;
  return {
    type: "scatter", mode: "markers", hoverinfo: "skip", name: "selected", x: shown ? [x(row)] : [], y: shown ? [drawn(state.metric, row)] : [],
    marker: { symbol: "circle-open", size: 19, color: css("--ink"), line: { width: 2 } },
  };
}

function notDrawn(traces) {
  const shown = state.group.rows.filter((row) => !state.hidden.has(seriesOf(row)));
  const count = shown.length - traces.reduce((sum, trace) => sum + trace.x.length, 0);
  if (count === 0) return "";
  return `${count} of ${shown.length} maps are not drawn: without this figure, or exact.`;
}

function drawBytes() {
  const traces = lines((row) => row.bytes_per_texel, 1);
  const all = state.group.rows;
  const shapes = data.budgets.map((budget) => ({
    type: "line", x0: budget, x1: budget, y0: 0, y1: 1, yref: "paper", line: { color: css("--line"), width: 1.5, dash: "dot" }, layer: "below",
  }));
  const annotations = data.budgets.map((budget) => ({
    x: Math.log10(budget), y: 1, yref: "paper", yanchor: "bottom", text: `${budget} B`, showarrow: false, font: { size: 11, color: css("--faint") },
  }));
  const x = logAxis([...all.map((row) => row.bytes_per_texel), ...data.budgets], { binary: true, pad: 0.04 });
  const y = qualityAxis(state.metric, all.map((row) => drawn(state.metric, row)));
  draw("plot-bytes", [...traces, ring((row) => row.bytes_per_texel)], layout({
    xaxis: { title: "bytes per texel", ...x }, yaxis: y, shapes, annotations,
  }));
  byId("note-bytes").textContent = notDrawn(traces);
  describe("plot-bytes", "bytes per texel", traces);
}

function drawSeconds() {
  // Times are no function of the settings: points, and faint lines for what belongs together.
  const traces = lines(seconds, 0.25);
  const all = state.group.rows;
  const dual = state.group.seconds_reference;
  const y = drawn(state.metric, state.group.dual);
  const shapes = [];
  const annotations = [];
  if (dual > 0) {
    shapes.push({ type: "line", x0: dual, x1: dual, y0: 0, y1: 1, yref: "paper", line: { color: css("--faint"), width: 1.5, dash: "dash" } });
    annotations.push({ x: Math.log10(dual), y: 1, yref: "paper", yanchor: "bottom", xanchor: "right", text: "dual march", showarrow: false, font: { size: 11, color: css("--faint") } });
    if (y !== null) {
      traces.push({
        type: "scatter", mode: "markers", name: "dual march", x: [dual], y: [y], text: [`<b>dual march</b><br>${plain(state.metric.name)}: ${plain(metricText(state.metric, state.group.dual))}<br>${ms(dual)}`],
        hovertemplate: "%{text}<extra></extra>", marker: { symbol: "star-diamond", size: 15, color: css("--ink") },
      });
    } else {
      // Its error against itself is 0, which a logarithmic axis has no place for.
      annotations.push({ x: Math.log10(dual), y: 0, yref: "paper", yanchor: "bottom", text: "◆", showarrow: false, font: { size: 18, color: css("--ink") } });
    }
  }
  const x = logAxis([...all.map(seconds), dual], { text: ms, pad: 0.06 });
  draw("plot-seconds", [...traces, ring(seconds)], layout({
    xaxis: { title: "light and view pass on the device", ...x }, shapes, annotations,
    yaxis: qualityAxis(state.metric, [...all.map((row) => drawn(state.metric, row)), y]),
  }));
  const own = dual > 0 ? (y === null ? "◆ the dual march, the reference of this figure. " : "◆ the dual march. ") : "";
  byId("note-seconds").textContent = own + notDrawn(traces.filter((trace) => trace.customdata));
  describe("plot-seconds", "seconds of light and view pass", traces);
}

function describe(id, against, traces) {
  const text = `${state.metric.name} against ${against}: ${traces.length} lines for ${state.group.title}. The table at the end has the same figures.`;
  byId(id).setAttribute("aria-label", text);
}

function draw(id, traces, plan) {
  const place = byId(id);
  Plotly.react(place, traces, plan, CONFIG);
  if (!place.dataset.listens) {
    place.dataset.listens = "yes";
    place.on("plotly_click", (event) => {
      const key = event.points[0].customdata;
      if (key) select(state.group.rows.find((row) => row.key === key));
    });
  }
}

// ------------------------------------------------------------------------------------------- legends

function toggleButton(text, pressed, mark, onToggle) {
  const button = make("button", { type: "button", "aria-pressed": String(pressed) }, mark, make("span", { textContent: text, title: text }));
  button.addEventListener("click", onToggle);
  return button;
}

function drawLegend() {
  const list = seriesOfGroup(state.group);
  const groups = [...new Set(list.map((series) => series.basis))].map((basis) => {
    const members = list.filter((series) => series.basis === basis);
    const anyShown = members.some((series) => !state.hidden.has(series.id));
    const group = make("span", { className: "group" });
    const all = toggleButton(basis, anyShown, swatch(basis, members.length === 1 ? members[0].nth : 0), () => {
      for (const series of members) anyShown ? state.hidden.add(series.id) : state.hidden.delete(series.id);
      redraw(basis);
    });
    group.append(all);
    all.dataset.focus = basis;
    if (members.length > 1) {
      for (const series of members) {
        const button = toggleButton(series.variant, !state.hidden.has(series.id), swatch(basis, series.nth), () => {
          state.hidden.has(series.id) ? state.hidden.delete(series.id) : state.hidden.add(series.id);
          redraw(series.id);
        });
        button.dataset.focus = series.id;
        group.append(button);
      }
    }
    return group;
  });
  byId("series").replaceChildren(...groups);
}

function redraw(focus) {
  drawLegend();
  drawBytes();
  drawSeconds();
  focusAgain("series", focus);
}

/** Buttons are made anew; the one that was pressed keeps the focus. */
function focusAgain(id, focus) {
  for (const button of byId(id).querySelectorAll("button")) if (button.dataset.focus === focus) button.focus();
}

// ------------------------------------------------------------------------------------ equal bytes

function drawBudgets() {
  const metric = state.metric;
  const cards = data.budgets.map((budget) => {
    const rows = state.group.rows.filter((row) => row.budgets.includes(budget)).sort(compareBy(metric));
    const card = make("div", { className: "budget" }, make("h3", { textContent: `within ${budget} bytes per texel` }));
    if (rows.length === 0) {
      card.append(make("p", { className: "note", textContent: "No map of this sweep is this small." }));
      return card;
    }
    const headline = make("strong", { textContent: rows[0].basis, title: rowName(rows[0]) });
    headline.style.color = colourOf(rows[0].basis);
    card.append(make("div", { className: "headline" }, headline, make("span", { textContent: `${metricText(metric, rows[0])} ${metric.short}` })));
    const values = rows.map((row) => drawn(metric, row));
    const most = Math.max(...values.filter((value) => value !== null), 0);
    rows.forEach((row, index) => {
      const bar = make("i");
      const endless = figure(row, metric.id) === Infinity;
      bar.style.width = `${endless ? 100 : values[index] === null || most <= 0 ? 0 : Math.max(0, (100 * values[index]) / most)}%`;
      bar.style.background = colourOf(row.basis);
      const button = make(
        "button",
        { type: "button", title: rowName(row), className: index === 0 ? "first" : "", "aria-pressed": String(row === state.row) },
        make("span", { className: "name", textContent: row.basis }),
        make("span", { className: "track", "aria-hidden": "true" }, bar),
        make("span", { className: "value", textContent: metricText(metric, row) }),
      );
      button.addEventListener("click", () => select(row));
      button.dataset.key = row.key;
      card.append(button);
    });
    return card;
  });
  byId("budgets").replaceChildren(...cards);
}

// ----------------------------------------------------------------------------------------- curves

/** Rows that have a curve. Of each basis, the first that is shown is a solid line, the next dashed. */
function curveRows() {
  const shown = new Map();
  return state.group.rows
    .filter((row) => Object.hasOwn(state.group.curves.values, row.key))
    .map((row) => {
      const nth = shown.get(row.basis) ?? 0;
      if (state.curves.has(row.key)) shown.set(row.basis, nth + 1);
      return { row, nth };
    });
}

function drawCurves() {
  const curves = state.group.curves;
  byId("curves-body").hidden = curves === null;
  if (curves === null) {
    byId("curves-about").textContent = "This sweep's folder has no readable curves of this volume.";
    return;
  }
  byId("curves-about").textContent =
    `What each map gives for the light ray through (${number(curves.u)}, ${number(curves.v)}) of the first light's map, ` +
    "and below by how much that is wrong: figure 8 of the paper on transmittance function maps, for every basis.";
  const exact = {
    type: "scatter", mode: "lines", name: "exact", x: curves.distance, y: curves.exact, line: { color: css("--ink"), width: 3.5 }, opacity: 0.85,
    hovertemplate: "exact: %{y:.4f}<extra></extra>",
  };
  const traces = [exact];
  const all = curveRows();
  for (const { row, nth } of all) {
    if (!state.curves.has(row.key)) continue;
    const values = curves.values[row.key];
    const label = rowName(row);
    const style = { color: colourOf(row.basis), width: 1.8, dash: DASHES[nth % DASHES.length] };
    const common = {
      type: "scatter", mode: "lines", name: plain(label), x: curves.distance, line: style, hovertemplate: `${plain(label)}: %{y:.4f}<extra></extra>`,
    };
    traces.push({ ...common, y: values });
    traces.push({ ...common, y: values.map((v, i) => v - curves.exact[i]), yaxis: "y2" });
  }
  draw("plot-curves", traces, layout({
    xaxis: { title: "distance from the light / world units", anchor: "y2" },
    yaxis: { title: "transmittance T", domain: [0.4, 1] },
    yaxis2: { title: "error of T", domain: [0, 0.33], zeroline: true, zerolinecolor: css("--faint") },
  }));
  byId("plot-curves").setAttribute("aria-label", `Transmittance along a light ray of ${state.group.title}: exact, and from ${state.curves.size} maps.`);
  drawCurveKeys(all);
}

/** A line for each series: a switch for each of its sizes. */
function drawCurveKeys(all) {
  const lines = seriesOfGroup(state.group).map((series) => {
    const buttons = all.filter(({ row }) => seriesOf(row) === series.id).map(({ row, nth }) => {
      const pressed = state.curves.has(row.key);
      const button = toggleButton(`n = ${row.coeffs}`, pressed, swatch(row.basis, pressed ? nth : 0), () => {
        pressed ? state.curves.delete(row.key) : state.curves.add(row.key);
        drawCurves();
        focusAgain("curves-keys", row.key);
      });
      button.setAttribute("aria-label", rowName(row));
      button.dataset.focus = row.key;
      return button;
    });
    const name = seriesName(series);
    return buttons.length === 0 ? "" : make("div", { className: "curve-line" }, make("span", { textContent: name, title: name }), ...buttons);
  });
  byId("curves-keys").replaceChildren(...lines.filter(Boolean));
}

/** Keys of the maps that are best of their basis at the middle budget, or else of the first few. */
function bestCurves(group) {
  if (group.curves === null) return new Set();
  const middle = data.budgets[Math.floor(data.budgets.length / 2)];
  const kept = group.rows.filter((row) => Object.hasOwn(group.curves.values, row.key));
  const best = kept.filter((row) => row.budgets.includes(middle));
  return new Set((best.length > 0 ? best : kept.slice(0, 6)).map((row) => row.key));
}
