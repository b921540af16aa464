// The flip viewer: a map's picture, its reference and the error lie on each other, and one or two of them show.

const viewer = { against: 0, sheet: "error", gain: 10, signed: true, errors: null, turn: 0 };
const flip = new Flip(byId("flip"), { pair: ["image", "reference"], clicks: true, onChange: () => drawViewer() });
const layers = {
  image: flip.add("image", make("img", { id: "layer-image", alt: "" })),
  reference: flip.add("reference", make("img", { id: "layer-reference", alt: "" })),
  error: flip.add("error", make("canvas", { id: "layer-error", role: "img" })),
};
const AGAINST = ["dual march, same steps", "dual march, converged"];
const AGAINST_SHORT = ["dual, same steps", "dual, converged"];
const uri = (name) => `data:image/png;base64,${pictures[name]}`;

/** Keys of the references of the group whose pictures are here, with the index of their name. */
function references(group) {
  return [group.reference, group.converged].map((key, index) => ({ key, index })).filter(({ key }) => key !== null && key in pictures);
}

/** Names of the pictures whose differences add up to a map's error against the chosen reference. */
function errorNames(row) {
  const { reference, converged } = state.group;
  const toDual = `${row.key}-${reference}`;
  const ways = viewer.against === 0 ? [[toDual]] : [[toDual, `${reference}-${converged}`], [`${row.key}-${converged}`]];
  return ways.find((names) => names.every((name) => name in pictures)) ?? null;
}

// Black where there is no error.
const SIGNED = data.signed_colours.map((colour, index, all) => [(2 * index) / (all.length - 1) - 1, colour]);
const MAGNITUDE = [[0, [0, 0, 0]], [0.25, [75, 20, 105]], [0.5, [185, 50, 85]], [0.75, [245, 130, 30]], [1, [252, 250, 180]]];

function mix(stops, t) {
  for (let i = 1; i < stops.length; i++) {
    if (t <= stops[i][0] || i === stops.length - 1) {
      const [[from, a], [to, b]] = [stops[i - 1], stops[i]];
      const part = clamp((t - from) / (to - from), 0, 1);
      return a.map((v, c) => Math.round(v + part * (b[c] - v)));
    }
  }
  return stops[0][1];
}

// An error d of display luma is kept as the grey value 128 + 127 sign(d) √|d|.
const expand = (grey) => {
  const v = (grey - 128) / 127;
  return Math.sign(v) * v * v;
};
const EXPANDED = Float32Array.from({ length: 256 }, (_, grey) => expand(grey));
const compand = (d) => 128 + 127 * Math.sign(d) * Math.sqrt(Math.min(1, Math.abs(d)));

function errorColours() {
  const table = new Uint32Array(256);
  for (let grey = 0; grey < 256; grey++) {
    const d = EXPANDED[grey] * viewer.gain;
    const [r, g, b] = viewer.signed ? mix(SIGNED, d) : mix(MAGNITUDE, Math.abs(d));
    table[grey] = (255 << 24) | (b << 16) | (g << 8) | r;
  }
  return table;
}

async function decoded(name) {
  const image = new Image();
  image.src = uri(name);
  await image.decode();
  return image;
}

/** The error d of each pixel, from the pictures whose differences add up to it. */
async function readErrors(names) {
  let sum = null;
  for (const image of await Promise.all(names.map(decoded))) {
    const { naturalWidth: width, naturalHeight: height } = image;
    const context = make("canvas", { width, height }).getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    const pixels = context.getImageData(0, 0, width, height).data;
    sum ??= { width, height, values: new Float32Array(width * height) };
    for (let i = 0; i < sum.values.length; i++) sum.values[i] += EXPANDED[pixels[4 * i]];
  }
  return sum;
}

function colourErrors(canvas, errors) {
  canvas.width = errors.width;
  canvas.height = errors.height;
  const context = canvas.getContext("2d");
  const pixels = context.createImageData(errors.width, errors.height);
  const words = new Uint32Array(pixels.data.buffer);
  const table = errorColours();
  for (let i = 0; i < words.length; i++) words[i] = table[Math.round(compand(errors.values[i]))];
  context.putImageData(pixels, 0, 0);
}

async function drawViewer() {
  const row = state.row;
  const turn = ++viewer.turn;
  const chosen = references(state.group).find(({ index }) => index === viewer.against);
  const has = { image: row.key in pictures, reference: chosen !== undefined, error: errorNames(row) !== null };
  for (const button of document.querySelectorAll("[data-side]")) {
    button.setAttribute("aria-pressed", String(button.dataset.side === flip.shown));
  }
  byId("wipe").setAttribute("aria-pressed", String(flip.wiping));
  byId("zoom").value = flip.zoom;
  show(layers.image, has.image ? uri(row.key) : "", `${state.group.title}, rendered with ${rowName(row)}`);
  show(layers.reference, has.reference ? uri(chosen.key) : "", `${state.group.title}, ${AGAINST[viewer.against]}`);
  const sign = viewer.signed ? "blue is too dark, orange too bright" : "bright is wrong";
  layers.error.setAttribute("aria-label", `Error of ${rowName(row)}, amplified ${viewer.gain} times; ${sign}`);
  viewer.errors = null;
  if (has.error) {
    const errors = await readErrors(errorNames(row));
    if (turn !== viewer.turn) return;
    viewer.errors = errors;
    colourErrors(layers.error, errors);
  }
  for (const side of Object.keys(layers)) flip.has(side, has[side]);
  flip.draw();
  flip.notice.hidden = has[flip.shown];
  flip.notice.textContent = { missing: "The image is not in the sweep's folder.", "left out": "Left out: the report would be too large." }[row.picture] ?? "The reference's image is not in the sweep's folder.";
  flip.label(sideName(flip.shown), flip.over === null ? "" : sideName(flip.over));
  byId("scale").hidden = flip.shown !== "error";
  drawScale();
}

function sideName(side) {
  const name = rowName(state.row);
  return { image: name, reference: AGAINST[viewer.against], error: `error of ${name}, ×${viewer.gain}` }[side];
}

function show(layer, source, alt) {
  if (layer.getAttribute("src") !== source) source ? layer.setAttribute("src", source) : layer.removeAttribute("src");
  layer.alt = alt;
}

function drawScale() {
  const end = number(1 / viewer.gain);
  byId("scale-low").textContent = viewer.signed ? `too dark −${end}` : "0";
  byId("scale-high").textContent = viewer.signed ? `+${end} too bright` : `${end} wrong`;
  const context = byId("scale-colours").getContext("2d");
  for (let i = 0; i < 256; i++) {
    context.fillStyle = `rgb(${(viewer.signed ? mix(SIGNED, (i - 127.5) / 127.5) : mix(MAGNITUDE, i / 255)).join(",")})`;
    context.fillRect(i, 0, 1, 1);
  }
}

function step(by) {
  const rows = state.group.rows;
  select(rows[(rows.indexOf(state.row) + by + rows.length) % rows.length]);
}

function listenToViewer() {
  for (const button of document.querySelectorAll("[data-side]")) {
    button.addEventListener("click", () => {
      flip.show(button.dataset.side);
      drawViewer();
    });
  }
  byId("wipe").addEventListener("click", () => flip.wipe());
  byId("previous").addEventListener("click", () => step(-1));
  byId("next").addEventListener("click", () => step(1));
  byId("row").addEventListener("change", (event) => select(state.group.rows[event.target.value]));
  const settings = {
    against: (value) => (viewer.against = Number(value)), gain: (value) => (viewer.gain = Number(value)),
    sign: (value) => (viewer.signed = value === "signed"), "sheet-side": (value) => (viewer.sheet = value), zoom: (value) => flip.setZoom(value),
  };
  for (const [id, set] of Object.entries(settings)) {
    byId(id).addEventListener("change", (event) => {
      set(event.target.value);
      drawViewer();
      drawNumbers();
      if (id !== "zoom") drawSheet();
    });
  }
  flip.stage.id = "stage";
  flip.stage.setAttribute("aria-describedby", "keys");
  // Only while the focus is in the viewer: elsewhere keys are the browser's.
  byId("viewer").addEventListener("keydown", (event) => {
    if (flip.key(event) || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const by = { n: 1, p: -1 }[event.key];
    if (by === undefined) return;
    event.preventDefault();
    step(by);
  });
  flip.stage.addEventListener("pointermove", (event) => {
    if (flip.shown !== "error" || viewer.errors === null) return;
    const pixel = flip.pixel(event);
    if (pixel === null) return;
    const d = viewer.errors.values[pixel[1] * viewer.errors.width + pixel[0]];
    flip.label(`error of luma ${d < 0 ? "−" : "+"}${number(Math.abs(d))}`, flip.over === null ? "" : sideName(flip.over));
  });
}

function drawNumbers() {
  const row = state.row;
  const faster = row.seconds_reference / seconds(row);
  const figures = [
    ["bytes per texel", number(row.bytes_per_texel)],
    ...METRICS.filter((m) => ["t_error", "converged_lit_rmse", "lit_rmse", "lit_psnr", "lit_ssim", "flip"].includes(m.id)).map((m) => [
      m.id.endsWith("ssim") ? "SSIM, lit pixels" : m.name, metricText(m, row),
    ]),
    ["light pass", ms(row.seconds_light_pass)],
    ["view pass", ms(row.seconds_view_pass)],
    ["dual march", `${ms(row.seconds_reference)}${Number.isFinite(faster) ? ` (${faster.toFixed(1)}×)` : ""}`],
  ];
  byId("numbers").replaceChildren(...figures.map(([name, text]) => make("div", {}, make("dt", { textContent: name }), make("dd", { textContent: text }))));
}

/** Choices of the viewer that depend on the volume. */
function drawChoices() {
  const rows = state.group.rows;
  byId("row").replaceChildren(
    ...seriesOfGroup(state.group).map((series) =>
      make("optgroup", { label: seriesName(series) },
        ...series.rows.map((row) => make("option", {
          value: rows.indexOf(row), textContent: `${rowName(row)} · ${number(row.bytes_per_texel)} B`,
        })),
      ),
    ),
  );
  const found = references(state.group);
  if (!found.some(({ index }) => index === viewer.against)) viewer.against = found[0]?.index ?? 0;
  byId("against").replaceChildren(...found.map(({ index }) => make("option", { value: index, textContent: AGAINST_SHORT[index], selected: index === viewer.against })));
  byId("against").disabled = found.length < 2;
  const without = (why) => rows.filter((row) => row.picture === why).map(rowName);
  const notes = [["missing", "Not in the sweep's folder"], ["left out", `Left out to keep this file below ${data.limit_megabytes} MB`]]
    .map(([why, text]) => [text, without(why)])
    .filter(([, names]) => names.length > 0)
    .map(([text, names]) => `${text}: ${names.join("; ")}.`);
  byId("note-pictures").textContent = ["Pictures are the part of the frame where the reference is lit; large ones are made smaller.", ...notes].join(" ");
}

// ---------------------------------------------------------------------------------------- contact sheet

let watcher = null;

function drawSheet() {
  watcher?.disconnect();
  watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      watcher.unobserve(entry.target);
      entry.target.fill();
    }
  }, { rootMargin: "200px" });
  const parts = seriesOfGroup(state.group).map((series) => {
    const title = make("h4", {}, dot(series.basis), make("span", { textContent: seriesName(series) }));
    return make("div", { className: "block" }, title, make("div", { className: "line" }, ...series.rows.map(tile)));
  });
  byId("sheet").replaceChildren(...parts);
}

function tile(row) {
  const names = viewer.sheet === "error" ? errorNames(row) : row.key in pictures ? [row.key] : null;
  const about = make("span", { className: "about" }, `n = ${row.coeffs} · ${number(row.bytes_per_texel)} B`, make("br"), `${metricText(state.metric, row)} ${state.metric.short}`);
  const button = make("button", { type: "button", title: rowName(row), "aria-pressed": String(row === state.row) });
  button.dataset.key = row.key;
  if (names === null) button.append(make("span", { className: "blank", textContent: "no picture" }), about);
  else {
    const picture = viewer.sheet === "error" ? make("canvas", { role: "img", width: 1, height: 1, "aria-label": `error of ${rowName(row)}` }) : make("img", { alt: rowName(row) });
    picture.fill = async () => {
      if (picture.tagName === "CANVAS") colourErrors(picture, await readErrors(names));
      else picture.src = uri(names[0]);
    };
    watcher.observe(picture);
    button.append(picture, about);
  }
  button.addEventListener("click", () => select(row));
  return button;
}
