// What is chosen, and what is drawn again when it changes.

function chooseGroup(group) {
  state.group = group;
  state.curves = bestCurves(group);
  const middle = data.budgets[Math.floor(data.budgets.length / 2)];
  const within = group.rows.filter((row) => row.budgets.includes(middle));
  const best = (rows) => [...rows].sort(compareBy(state.metric))[0];
  state.row = best(within.length > 0 ? within : group.rows);
  byId("settings").textContent = `${group.settings}; ${group.device}; tfm_cl ${group.version}`;
  byId("table-about").textContent =
    `${group.rows.length} maps of ${group.title}. ★ marks the best map of its basis within a budget of bytes per texel. ` +
    "Lit: pixels where the reference's alpha exceeds 0.001. RMSE is of linear values, relative to the reference's mean; times are the device's, compilation excluded. Bars: longer is worse.";
  drawChoices();
  drawLegend();
  drawAll();
}

function drawAll() {
  const metric = state.metric;
  byId("direction").textContent = `${metric.better === "lower" ? "↓ lower" : "↑ higher"} is better`;
  byId("where").textContent = `; ${metric.where}`;
  drawBudgets();
  drawBytes();
  drawSeconds();
  drawSheet();
  drawCurves();
  drawTable();
  drawSelection();
}

/** Show a row everywhere. */
function select(row) {
  state.row = row;
  drawBytes();
  drawSeconds();
  drawSelection();
}

function drawSelection() {
  byId("row").value = String(state.group.rows.indexOf(state.row));
  for (const button of document.querySelectorAll("#sheet button, #budgets button")) {
    button.setAttribute("aria-pressed", String(button.dataset.key === state.row.key));
  }
  for (const line of document.querySelectorAll("#table tbody tr")) line.classList.toggle("selected", line.dataset.key === state.row.key);
  drawNumbers();
  drawViewer();
}

function choices(id, list, name, choose) {
  byId(id).replaceChildren(...list.map((item, index) => make("option", { value: index, textContent: name(item) })));
  byId(id).addEventListener("change", (event) => choose(list[event.target.value]));
}

followTheme(document.body, byId("theme"), () => {
  drawLegend();
  drawAll();
});
byId("about").textContent = data.about;
byId("footer").textContent = data.footer;
choices("volume", data.groups, (group) => group.title, chooseGroup);
choices("metric", METRICS, (metric) => metric.name, (metric) => {
  state.metric = metric;
  drawAll();
});
byId("every").addEventListener("change", drawTable);
for (const [id, chosen] of Object.entries({
  "curves-best": () => bestCurves(state.group),
  "curves-all": () => new Set(Object.keys(state.group.curves.values)),
  "curves-none": () => new Set(),
})) {
  byId(id).addEventListener("click", () => {
    state.curves = chosen();
    drawCurves();
  });
}
listenToViewer();
chooseGroup(data.groups[0]);
