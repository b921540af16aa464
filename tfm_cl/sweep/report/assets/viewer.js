// The flip viewer: a map's picture, its reference and the error lie on each other, and one of them shows.

const viewer = { side: "image", against: 0, sheet: "error", gain: 10, signed: true, zoom: "fit", errors: null, turn: 0 };
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
const SIGNED = [[-1, [150, 215, 255]], [-0.5, [40, 120, 220]], [0, [0, 0, 0]], [0.5, [215, 95, 20]], [1, [255, 225, 150]]];
const MAGNITUDE = [[0, [0, 0, 0]], [0.25, [75, 20, 105]], [0.5, [185, 50, 85]], [0.75, [245, 130, 30]], [1, [252, 250, 180]]];

function mix(stops, t) {
  for (let i = 1; i < stops.length; i++) {
    if (t <= stops[i][0] || i === stops.length - 1) {
      const [[from, a], [to, b]] = [stops[i - 1], stops[i]];
      const part = Math.min(1, Math.max(0, (t - from) / (to - from)));
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
    button.setAttribute("aria-pressed", String(button.dataset.side === viewer.side));
  }
  const image = byId("layer-image");
  const reference = byId("layer-reference");
  const canvas = byId("layer-error");
  show(image, has.image ? uri(row.key) : "", `${state.group.title}, rendered with ${rowName(row)}`);
  show(reference, has.reference ? uri(chosen.key) : "", `${state.group.title}, ${AGAINST[viewer.against]}`);
  const sign = viewer.signed ? "blue is too dark, orange too bright" : "bright is wrong";
  canvas.setAttribute("aria-label", `Error of ${rowName(row)}, amplified ${viewer.gain} times; ${sign}`);
  viewer.errors = null;
  if (has.error) {
    const errors = await readErrors(errorNames(row));
    if (turn !== viewer.turn) return;
    viewer.errors = errors;
    colourErrors(canvas, errors);
  }
  for (const [side, layer] of Object.entries({ image, reference, error: canvas })) {
    layer.classList.toggle("shown", side === viewer.side && has[side]);
    layer.setAttribute("aria-hidden", String(side !== viewer.side));
  }
  const notice = byId("stage-notice");
  notice.hidden = has[viewer.side];
  notice.textContent = { missing: "The image is not in the sweep's folder.", "left out": "Left out: the report would be too large." }[row.picture] ?? "The reference's image is not in the sweep's folder.";
  byId("layers").hidden = !has[viewer.side];
  const kind = { image: rowName(row), reference: AGAINST[viewer.against], error: `error of ${rowName(row)}, ×${viewer.gain}` };
  byId("badge").textContent = kind[viewer.side];
  byId("stage").dataset.side = viewer.side;
  byId("scale").hidden = viewer.side !== "error";
  drawScale();
  await (has[viewer.side] && viewer.side !== "error" ? (viewer.side === "image" ? image : reference).decode().catch(() => {}) : null);
  if (turn === viewer.turn) size();
}

function show(layer, source, alt) {
  if (layer.getAttribute("src") !== source) source ? layer.setAttribute("src", source) : layer.removeAttribute("src");
  layer.alt = alt;
}

function naturalSize() {
  const canvas = byId("layer-error");
  if (viewer.side === "error") return [canvas.width, canvas.height];
  const layer = byId(`layer-${viewer.side}`);
  return [layer.naturalWidth, layer.naturalHeight];
}

/** Show at a whole number of screen pixels for each of the picture's, or smaller where there is no room. */
function size() {
  const [width, height] = naturalSize();
  if (!width || !height) return;
  const stage = byId("stage");
  let zoom = Number(viewer.zoom);
  if (viewer.zoom === "fit") {
    zoom = Math.min(stage.clientWidth / width, (0.8 * window.innerHeight) / height);
    zoom = zoom >= 1 ? Math.floor(zoom) : zoom;
  }
  const layers = byId("layers");
  layers.style.width = `${width * zoom}px`;
  layers.style.height = `${height * zoom}px`;
  layers.classList.toggle("nearest", zoom >= 1);
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

function setSide(side) {
  viewer.side = side;
  drawViewer();
}

const flip = () => setSide(viewer.side === "reference" ? "image" : "reference");

function step(by) {
  const rows = state.group.rows;
  select(rows[(rows.indexOf(state.row) + by + rows.length) % rows.length]);
}

function stepZoom(by) {
  const options = [...byId("zoom").options].map((option) => option.value);
  viewer.zoom = options[Math.min(options.length - 1, Math.max(0, options.indexOf(viewer.zoom) + by))];
  byId("zoom").value = viewer.zoom;
  size();
}

const KEYS = {
  1: () => setSide("image"), 2: () => setSide("reference"), 3: () => setSide("error"), " ": flip,
  n: () => step(1), p: () => step(-1), "+": () => stepZoom(1), "=": () => stepZoom(1), "-": () => stepZoom(-1),
};

function listenToViewer() {
  for (const button of document.querySelectorAll("[data-side]")) {
    button.addEventListener("click", () => setSide(button.dataset.side));
  }
  byId("previous").addEventListener("click", () => step(-1));
  byId("next").addEventListener("click", () => step(1));
  byId("row").addEventListener("change", (event) => select(state.group.rows[event.target.value]));
  const settings = {
    against: (value) => (viewer.against = Number(value)), gain: (value) => (viewer.gain = Number(value)),
    sign: (value) => (viewer.signed = value === "signed"), "sheet-side": (value) => (viewer.sheet = value), zoom: (value) => (viewer.zoom = value),
  };
  for (const [id, set] of Object.entries(settings)) {
    byId(id).addEventListener("change", (event) => {
      set(event.target.value);
      drawViewer();
      drawNumbers();
      if (id !== "zoom") drawSheet();
    });
  }
  byId("stage").addEventListener("click", flip);
  // Only while the focus is in the viewer; select boxes search by letters, buttons take the space bar.
  byId("viewer").addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (event.key === " " && event.target.tagName === "BUTTON") return;
    if (!Object.hasOwn(KEYS, event.key)) return;
    event.preventDefault();
    KEYS[event.key]();
  });
  byId("stage").addEventListener("pointermove", (event) => {
    if (viewer.side !== "error" || viewer.errors === null) return;
    const box = byId("layers").getBoundingClientRect();
    const [width, height] = naturalSize();
    const x = Math.floor(((event.clientX - box.left) / box.width) * width);
    const y = Math.floor(((event.clientY - box.top) / box.height) * height);
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    const d = viewer.errors.values[y * width + x];
    byId("badge").textContent = `error of luma ${d < 0 ? "−" : "+"}${number(Math.abs(d))}`;
  });
  new ResizeObserver(size).observe(byId("stage"));
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
