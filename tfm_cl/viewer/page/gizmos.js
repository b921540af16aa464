// Handles of lights, solids and volumes, drawn over the stage.

const ARM = 74; // pixels of an axis
const REACHED = 24; // pixels within which a handle is taken
const CROWD = 24; // things whose handles are large
const RING = 64; // points of a circle

/** Elements of the drawing that stay while what they stand for does: focus and pointer are not lost. */
class Drawing {
  constructor(root) {
    this.root = root;
    this.kept = new Map();
  }

  begin() {
    this.used = new Set();
  }

  /** A shape by its name; made when it is new. */
  shape(id, tag, attributes, make = null) {
    let element = this.kept.get(id);
    if (!element) {
      element = drawn(tag);
      if (make) make(element);
      this.kept.set(id, element);
      this.root.append(element);
    }
    setAttributes(element, attributes);
    this.used.add(id);
    return element;
  }

  end() {
    for (const [id, element] of this.kept) {
      if (this.used.has(id)) continue;
      element.remove();
      this.kept.delete(id);
    }
  }
}

class Gizmos {
  constructor(app, svg) {
    Object.assign(this, { app, svg, hidden: false, tool: "move", selected: null, part: "from", grip: null });
    this.drawing = new Drawing(svg);
  }

  // ------------------------------------------------------------------------------------------- what there is

  items() {
    const { options } = this.app.model;
    return ["light", "solid", "volume"].flatMap((section) => items(options, section)).map((item) => ({ ...item, parts: this.#parts(item) }));
  }

  /** Where an item can be taken: { from: point, to: point, … }. */
  #parts({ section, table }) {
    if (section === "light") {
      const parts = {};
      if (isPoint(table.from)) parts.from = table.type === "sun" && isPoint(table.to) ? this.#sunAt(table) : table.from;
      if (isPoint(table.to)) parts.to = table.to;
      if (table.type === "sky" && table.sun !== false) parts.from = this.#skySunAt(table);
      return parts;
    }
    const centre = this.#centre(section, table);
    return centre === null ? {} : { from: centre };
  }

  /** A sun is as far away as its handle can be taken. */
  #sunAt({ from, to }) {
    const arm = minus(from, to);
    return plus(to, unit(arm), Math.min(norm(arm), 1.6 * this.app.model.extent.radius));
  }

  #skySunAt({ elevation, azimuth, up }) {
    const { centre, radius } = this.app.model.extent;
    const [e, a] = [radians(elevation), radians(azimuth)];
    const direction = [Math.cos(e) * Math.sin(a), Math.sin(e), Math.cos(e) * Math.cos(a)];
    return plus(centre, fromYUp(this.#zenith(up), direction), 1.4 * radius);
  }

  #zenith(up) {
    if (isPoint(up)) return unit(up);
    const named = /^(-?)([xyz])$/.exec(up ?? "");
    if (named) return times(AXES["xyz".indexOf(named[2])], named[1] ? -1 : 1);
    const camera = this.app.model.options.camera;
    const seen = camera.matrix ? [0, 1, 0] : camera.up ?? [0, 1, 0];
    const largest = seen.reduce((best, value, index) => (Math.abs(value) > Math.abs(seen[best]) ? index : best), 1);
    return times(AXES[largest], Math.sign(seen[largest]) || 1);
  }

  #centre(section, table) {
    const { centre } = this.app.model.extent;
    const isAlone = items(this.app.model.options, "volume").length === 1;
    if (table.shape === "everywhere" || table.shape === "ground") return null;
    const local = table.centre ?? (isPoint(table.from) && isPoint(table.to) ? times(plus(table.from, table.to), 0.5) : table.point ?? [0, 0, 0]);
    if (section === "volume" && table.shape) return local;
    if (section === "volume" && isAlone && this.grip?.path !== "volume") return centre;
    if (section === "volume" && isAlone) return this.grip.pivot;
    return applied(matrixOf(table), local);
  }

  // ------------------------------------------------------------------------------------------- choosing

  select(path, part = "from") {
    const item = path === null ? null : this.items().find((one) => one.path === path);
    this.selected = item ? path : null;
    this.part = item && part in item.parts ? part : "from";
    this.draw();
    this.app.panel.mark(this.selected);
  }

  toggle(hidden = !this.hidden) {
    this.hidden = hidden;
    this.draw();
    this.app.drawTools();
  }

  setTool(tool) {
    this.tool = tool;
    if (this.hidden) this.hidden = false;
    this.draw();
    this.app.drawTools();
  }

  /** The light that L turns: the chosen one, or the first that has a direction. */
  turnable() {
    const lights = this.items().filter(({ section, table }) => section === "light" && (isPoint(table.from) || table.type === "sky"));
    return lights.find(({ path }) => path === this.selected) ?? lights[0] ?? null;
  }

  /** Turn a light about what it shines at, as the camera turns. */
  turnLight(x, y) {
    const { path, table } = this.turnable();
    if (table.type === "sky") {
      this.app.model.edit(this.#skyTurned({ path, table }, 180 * x, -90 * y), true);
      return;
    }
    const to = table.to ?? this.app.model.extent.centre;
    const { from } = orbited({ from: table.from, to, up: this.#zenith() }, -x, -y);
    this.app.model.edit({ [`${path}.from`]: rounded(from) }, true);
  }

  /** Changes that turn a sky's sun, degrees. */
  #skyTurned({ path, table: { azimuth, elevation } }, around, up) {
    return { [`${path}.elevation`]: rounded(clamp(elevation + up, 0, 90)), [`${path}.azimuth`]: rounded(wrapped(azimuth + around)) };
  }

  // ------------------------------------------------------------------------------------------- drawing

  draw() {
    const { model, stage } = this.app;
    const [width, height] = stage.size;
    this.drawing.begin();
    setAttributes(this.svg, { viewBox: `0 0 ${Math.max(width, 1)} ${Math.max(height, 1)}` });
    const isVisible = !this.hidden && model.options !== null && width > 0 && stage.flip.shown !== "map";
    if (isVisible) {
      this.view = stage.view();
      this.scale = parseFloat(getComputedStyle(this.app.element).fontSize) / 14;
      const all = this.items();
      this.isCrowded = all.length > CROWD;
      this.svg.classList.toggle("crowded", this.isCrowded);
      for (const item of all) this.#drawItem(item);
      // Handles of what is chosen lie above the others, and the tabulator finds them last.
      const chosen = all.find(({ path }) => path === this.selected);
      if (chosen && this.part in chosen.parts) this.#drawTool(chosen, chosen.parts[this.part]);
    }
    this.drawing.end();
  }

  #at(point) {
    const [width, height] = this.app.stage.size;
    const seen = this.view.project(point);
    return seen === null || Math.abs(seen[0]) > 20 || Math.abs(seen[1]) > 20 ? null : [seen[0] * width, seen[1] * height];
  }

  #isOutside(at) {
    const [width, height] = this.app.stage.size;
    return at === null || at[0] < 0 || at[1] < 0 || at[0] > width || at[1] > height;
  }

  /** Where a light that is not in the picture can be taken: at the edge that it is behind. */
  #atEdge(point) {
    const [width, height] = this.app.stage.size;
    const from = minus(point, this.view.from);
    const [x, y] = [dot(from, this.view.right), -dot(from, this.view.above)];
    const margin = 1.1 * REACHED * this.scale;
    const reach = Math.min((width / 2 - margin) / Math.abs(x || 1e-9), (height / 2 - margin) / Math.abs(y || 1e-9));
    return [width / 2 + reach * x, height / 2 + reach * y];
  }

  /** World units of so many pixels at a point. */
  #units(pixels, point) {
    return (pixels * this.view.heightAt(point)) / this.app.stage.size[1];
  }

  #line(id, className, points, isClosed = false) {
    const parts = [];
    let isOn = false;
    for (const point of isClosed ? [...points, points[0]] : points) {
      const at = this.#at(point);
      if (at !== null) parts.push(`${isOn ? "L" : "M"}${point2(at)}`);
      isOn = at !== null;
    }
    return this.drawing.shape(id, "path", { class: className, d: parts.join("") || "M0 0" });
  }

  #circle(centre, axis, radius) {
    const [one, other] = across(axis);
    return Array.from({ length: RING }, (_, index) => {
      const angle = (2 * Math.PI * index) / RING;
      return plus(plus(centre, one, radius * Math.cos(angle)), other, radius * Math.sin(angle));
    });
  }

  /** A handle: something that is seen, and more around it that is taken. */
  #handle(id, { label, className, at, shape, hit = null, key, drag, press = null, value = null }) {
    if (at === null) return;
    const element = this.drawing.shape(id, "g", { class: `handle ${className}`, tabindex: 0, "aria-label": label }, (group) => {
      group.append(drawn("path", { class: "hit" }), drawn("path", { class: "seen" }), drawn("title"));
      this.#listen(group, id);
    });
    setAttributes(element, { role: value === null ? "button" : "slider", "aria-valuenow": value?.now ?? null, "aria-valuetext": value?.text ?? null });
    const [under, seen, title] = element.children;
    const isLine = hit !== null && !hit.endsWith("Z");
    setAttributes(under, { d: hit ?? disc(at, (REACHED * this.scale) / 2), "stroke-width": REACHED * this.scale, class: isLine ? "hit line" : "hit" });
    setAttributes(seen, { d: shape });
    if (title.textContent !== label) title.textContent = label;
    element.does = { key, drag, press };
  }

  #listen(group, id) {
    let grip = null;
    group.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || event.altKey || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      event.stopPropagation();
      group.focus({ preventScroll: true });
      group.setPointerCapture(event.pointerId);
      const { drag, press } = group.does;
      if (press) press();
      grip = { move: drag(this.app.stage.place(event)), moved: false, x: event.clientX, y: event.clientY };
    });
    group.addEventListener("pointermove", (event) => {
      if (grip === null) return;
      event.stopPropagation();
      if (!grip.moved && Math.hypot(event.clientX - grip.x, event.clientY - grip.y) < 3) return;
      grip.moved = true;
      this.app.model.edit(grip.move(this.app.stage.place(event)), true);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      group.addEventListener(end, (event) => {
        if (grip === null) return;
        event.stopPropagation();
        if (grip.moved) this.app.model.drop();
        grip = null;
        this.grip = null;
        this.draw();
      });
    }
    group.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key === "Enter" && group.does.press) group.does.press();
      else if (event.key.startsWith("Arrow") && group.does.key) {
        const by = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
        const changes = group.does.key(by, event.shiftKey ? 10 : 1);
        this.grip = null;
        if (changes) this.app.model.edit(changes, false);
      } else return;
      event.preventDefault();
      event.stopPropagation();
    });
    group.dataset.handle = id;
  }

  /** Marks of an item; all of them where it is chosen. */
  #drawItem(item) {
    const { section, table, path, parts } = item;
    const isChosen = path === this.selected;
    const name = itemName(section, table, item.index, item.count);
    const className = `${section}${isChosen ? " chosen" : ""}`;
    if (isChosen && section === "light") this.#drawLight(item);
    if (isChosen && section !== "light") this.#drawBody(item);
    for (const [part, point] of Object.entries(parts)) {
      // Of many lights, aims are only in the way.
      if (part === "to" && !isChosen) continue;
      let at = this.#at(point);
      const isAway = section === "light" && part === "from" && this.#isOutside(at);
      if (isAway) at = this.isCrowded && !isChosen ? null : this.#atEdge(point);
      if (at === null) continue;
      const size = (isChosen || !this.isCrowded ? 6.5 : 3) * this.scale;
      const shape = part === "to" ? cross2(at, size) : section === "light" ? star(at, size) : section === "volume" ? square(at, size) : diamond(at, size);
      this.#handle(`${path}:${part}`, {
        at, shape, hit: isChosen || !this.isCrowded ? null : disc(at, 2 * size), className: `mark ${className}${isChosen && part === this.part ? " part" : ""}${isAway ? " away" : ""}`,
        label: `${name}: ${part === "to" ? "aim" : section === "light" && table.type === "sky" ? "sun" : "position"}${isAway ? ", outside the picture" : ""}`,
        press: () => this.select(path, part),
        drag: (place) => this.#free(item, part, place),
        key: (by, steps) => this.#nudge(item, part, by, steps),
      });
    }
  }

  #drawLight({ path, table, parts }) {
    const { from, to } = parts;
    if (!from) return;
    const target = to ?? this.app.model.extent.centre;
    if (to || table.type === "sky") this.#line(`${path}/axis`, "guide light", [from, target]);
    if (table.type === "spot" && to) this.#drawCone(path, table);
    if (table.type === "sun" && to) {
      const radius = this.#units(16 * this.scale, from);
      const axis = unit(minus(to, from));
      this.#line(`${path}/disc`, "guide light", this.#circle(from, axis, radius), true);
    }
    if (!["spot", "point"].includes(table.type)) return;
    for (const [key, label] of [["reach", "range"], ["radius", "size of the light"]]) {
      if (table[key] > 0) this.#drawRadius(`${path}.${key}`, from, table[key], label, "light");
    }
  }

  #drawCone(path, table) {
    const { from, to, cone, blend } = table;
    const axis = unit(minus(to, from));
    const distance = norm(minus(to, from));
    const radius = distance * Math.tan(radians(cone));
    const ring = this.#circle(to, axis, radius);
    this.#line(`${path}/cone`, "guide light", ring, true);
    if (blend > 0) this.#line(`${path}/blend`, "guide light dashed", this.#circle(to, axis, distance * Math.tan(radians(cone * (1 - blend)))), true);
    for (let side = 0; side < 4; side++) this.#line(`${path}/edge${side}`, "guide light thin", [from, ring[(side * RING) / 4]]);
    const [one] = across(axis, this.view.forward);
    const at = this.#at(plus(to, one, radius));
    const edit = (angle) => ({ [`${path}.cone`]: rounded(clamp(angle, 0.5, 89)) });
    this.#handle(`${path}/cone-handle`, {
      at, shape: at && disc(at, 5 * this.scale), className: "light round", label: `Cone: ${number(cone, 3)}°`,
      value: { now: number(cone, 3), text: `${number(cone, 3)} degrees` },
      drag: () => (place) => edit(degrees(Math.atan(Math.abs(this.#along(to, one, place)) / distance))),
      key: ([x, y], steps) => edit(cone + (x + y) * steps),
    });
  }

  #drawRadius(key, centre, radius, label, className) {
    this.#line(`${key}/ring`, `guide ${className} thin`, this.#circle(centre, this.view.forward, radius), true);
    const at = this.#at(plus(centre, this.view.right, radius));
    const edit = (value) => ({ [key]: rounded(Math.max(value, 1e-4 * this.app.model.extent.radius)) });
    this.#handle(`${key}/handle`, {
      at, shape: at && disc(at, 5 * this.scale), className: `${className} round`, label: `${label}: ${number(radius, 3)}`,
      value: { now: number(radius, 3), text: number(radius, 3) },
      drag: () => {
        const { right } = this.view;
        return (place) => edit(Math.abs(this.#along(centre, right, place)));
      },
      key: ([x, y], steps) => edit(radius * 1.02 ** ((x + y) * steps)),
    });
  }

  #drawBody({ section, path, table }) {
    const matrix = section === "volume" && table.shape ? IDENTITY : matrixOf(table);
    if (isPoint(table.centre) && table.radius > 0) {
      const own = norm(columnOf(matrix, 0));
      const centre = applied(matrix, table.centre);
      this.#line(`${path}/outline`, `guide ${section} thin`, this.#circle(centre, this.view.forward, own * table.radius), true);
      if (own === 1) this.#drawRadius(`${path}.radius`, centre, table.radius, "radius", section);
      return;
    }
    const { extent } = this.app.model;
    const isBox = isPoint(table.from) && isPoint(table.to);
    const bounds = isBox ? [table.from, table.to] : section === "volume" && items(this.app.model.options, "volume").length === 1 ? [extent.low, extent.high] : null;
    if (bounds === null) return;
    const corner = (bits) => applied(isBox ? matrix : IDENTITY, [0, 1, 2].map((axis) => bounds[(bits >> axis) & 1][axis]));
    for (let bits = 0; bits < 8; bits++) {
      for (let axis = 0; axis < 3; axis++) {
        if (!(bits & (1 << axis))) this.#line(`${path}/edge${bits}-${axis}`, `guide ${section} thin`, [corner(bits), corner(bits | (1 << axis))]);
      }
    }
  }

  // ------------------------------------------------------------------------------------------- tools

  /** Which of the tools an item has. */
  tools({ section, table }) {
    if (section === "light") return table.type === "sky" ? [] : ["move"];
    if (section === "volume" && table.shape) return ["move", "scale"];
    return ["move", "rotate", "scale"];
  }

  #drawTool(item, pivot) {
    const has = this.tools(item);
    const tool = has.includes(this.tool) ? this.tool : has[0];
    if (!tool || this.#at(pivot) === null) return;
    if (tool === "move") this.#drawMove(item, pivot);
    if (tool === "rotate") this.#drawRotate(item, pivot);
    if (tool === "scale") this.#drawScale(item, pivot);
  }

  #drawMove(item, pivot) {
    const arm = this.#units(ARM * this.scale, pivot);
    const part = this.part;
    AXES.forEach((axis, index) => {
      const [one, other] = [AXES[(index + 1) % 3], AXES[(index + 2) % 3]];
      if (Math.abs(dot(axis, unit(minus(pivot, this.view.from)))) < 0.15) return;
      const corners = [[0.38, 0.38], [0.62, 0.38], [0.62, 0.62], [0.38, 0.62]].map(([a, b]) => this.#at(plus(plus(pivot, one, a * arm), other, b * arm)));
      if (corners.includes(null)) return;
      const shape = `M${corners.map(point2).join("L")}Z`;
      const at = times(corners.reduce((sum, corner) => [sum[0] + corner[0], sum[1] + corner[1]], [0, 0]), 1 / 4);
      const step = this.app.model.extent.radius / 50;
      this.#handle(`${item.path}/plane-${"xyz"[index]}`, {
        at, shape, className: `axis plane ${"xyz"[index]}`, label: `Move in the ${["yz", "xz", "xy"][index]} plane`,
        drag: (place) => {
          const start = this.#onPlane(pivot, axis, place);
          const move = this.#moved(item, part);
          return (now) => move(minus(this.#onPlane(pivot, axis, now) ?? start, start));
        },
        key: ([x, y], steps) => this.#moved(item, part)(plus(times(one, x * steps * step), other, y * steps * step)),
      });
    });
    // Above the planes, which are easier to hit.
    AXES.forEach((axis, index) => {
      this.#arrow(item, pivot, axis, arm, `move-${"xyz"[index]}`, `Move along ${"xyz"[index]}`, () => this.#moved(item, part), arrowHead);
    });
  }

  /** A handle along an axis; `change` maps how far it was dragged, in world units, to changes. */
  #arrow(item, pivot, axis, arm, id, label, change, head) {
    if (Math.abs(dot(axis, unit(minus(pivot, this.view.from)))) > 0.985) return;
    const [start, end] = [this.#at(plus(pivot, axis, 0.16 * arm)), this.#at(plus(pivot, axis, arm))];
    if (start === null || end === null) return;
    const line = `M${point2(start)}L${point2(end)}`;
    const step = this.app.model.extent.radius / 50;
    this.#handle(`${item.path}/${id}`, {
      at: end, shape: line + head(start, end, this.scale), hit: line, className: `axis ${id.at(-1)}`, label,
      drag: (place) => {
        const from = this.#along(pivot, axis, place);
        const does = change();
        return (now) => does(times(axis, this.#along(pivot, axis, now) - from));
      },
      key: ([x, y], steps) => change()(times(axis, (x + y) * steps * step)),
    });
  }

  #drawRotate(item, pivot) {
    const radius = this.#units(ARM * this.scale, pivot);
    AXES.forEach((axis, index) => {
      const ring = this.#circle(pivot, axis, radius);
      const toEye = unit(minus(this.view.from, pivot));
      // The half that faces the camera; all of a ring that is seen from above.
      const isWhole = Math.abs(dot(axis, toEye)) > 0.92;
      const front = ring.map((point) => isWhole || dot(minus(point, pivot), toEye) >= -1e-6 * radius);
      const start = front.findIndex((is, at) => is && !front[(at + RING - 1) % RING]);
      const ordered = Array.from({ length: RING + 1 }, (_, at) => (Math.max(start, 0) + at) % RING);
      const visible = isWhole ? ordered : ordered.slice(0, RING).filter((at) => front[at]);
      const points = visible.map((at) => this.#at(ring[at]));
      if (points.length < 2 || points.includes(null)) return;
      const shape = `M${points.map(point2).join("L")}`;
      const edit = this.#turned(item, pivot);
      this.#handle(`${item.path}/rotate-${"xyz"[index]}`, {
        at: points[points.length >> 1], shape, hit: shape, className: `axis ring ${"xyz"[index]}`, label: `Turn about ${"xyz"[index]}`,
        drag: (place) => {
          const [width, height] = this.app.stage.size;
          const at = [place[0] * width, place[1] * height];
          const nearest = ring.map((point) => this.#at(point)).reduce((best, point, where, all) => (distance2(point, at) < distance2(all[best], at) ? where : best), 0);
          const [one, other] = [this.#at(ring[(nearest + RING - 1) % RING]), this.#at(ring[(nearest + 1) % RING])];
          const along = [other[0] - one[0], other[1] - one[1]];
          const perRadian = Math.hypot(...along) / ((4 * Math.PI) / RING);
          const way = Math.sign(dot(cross(minus(ring[0], pivot), minus(ring[1], pivot)), axis));
          const does = this.#turned(item, pivot);
          return ([x, y]) => {
            const moved = ((x * width - at[0]) * along[0] + (y * height - at[1]) * along[1]) / Math.hypot(...along);
            return does(axis, (way * moved) / Math.max(perRadian, 0.3 * ARM * this.scale));
          };
        },
        key: ([x, y], steps) => edit(axis, radians((x + y) * (steps > 1 ? 15 : 1))),
      });
    });
  }

  #drawScale(item, pivot) {
    const arm = this.#units(ARM * this.scale, pivot);
    const matrix = item.table.shape && item.section === "volume" ? IDENTITY : matrixOf(item.table);
    const edit = this.#scaled(item, pivot);
    const factor = (by) => Math.max(1 + by / arm, 0.02);
    const isUniform = isPoint(item.table.centre) || item.table.points !== undefined || item.table.curves !== undefined;
    if (!isUniform) {
      [0, 1, 2].forEach((index) => {
        const axis = unit(columnOf(matrix, index));
        this.#arrow(item, pivot, axis, arm, `scale-${"xyz"[index]}`, `Scale along its ${"xyz"[index]}`, () => {
          const does = this.#scaled(item, pivot);
          return (by) => does([0, 1, 2].map((own) => (own === index ? factor(dot(by, axis)) : 1)));
        }, squareHead);
      });
    }
    // Beside the axes, which mostly go up and to the right.
    const at = this.#at(pivot);
    const aside = [at[0] - 0.5 * ARM * this.scale, at[1] + 0.5 * ARM * this.scale];
    this.#handle(`${item.path}/scale-all`, {
      at: aside, shape: squareHead(at, aside, 1.4 * this.scale), className: "axis all", label: "Scale",
      drag: (place) => {
        const does = this.#scaled(item, pivot);
        return (now) => does(Array(3).fill(Math.exp(3 * (now[0] - place[0] + place[1] - now[1]))));
      },
      key: ([x, y], steps) => edit(Array(3).fill(1.02 ** ((x + y) * steps))),
    });
  }

  // ------------------------------------------------------------------------------------------- dragging

  /** How far along a line from a point the pointer is. */
  #along(point, axis, [x, y]) {
    const ray = this.view.ray(x, y);
    const from = minus(point, this.view.from);
    const b = dot(axis, ray);
    return (b * dot(ray, from) - dot(axis, from)) / Math.max(1 - b * b, 1e-4);
  }

  #onPlane(point, normal, [x, y]) {
    const ray = this.view.ray(x, y);
    const steep = dot(ray, normal);
    const far = dot(minus(point, this.view.from), normal) / steep;
    return Math.abs(steep) < 1e-3 || far < 0 ? null : plus(this.view.from, ray, far);
  }

  /** In the plane of the picture. */
  #free(item, part, place) {
    const point = item.parts[part];
    const { forward } = this.view;
    if (item.table.type === "sky") return (now) => this.#skyTurned(item, 180 * (now[0] - place[0]), 90 * (place[1] - now[1]));
    const start = this.#onPlane(point, forward, place);
    const move = this.#moved(item, part);
    return (now) => move(minus(this.#onPlane(point, forward, now) ?? start, start));
  }

  #nudge(item, part, [x, y], steps) {
    if (item.table.type === "sky") return this.#skyTurned(item, x * steps, y * steps);
    const step = (steps * this.app.model.extent.radius) / 50;
    return this.#moved(item, part)(plus(times(this.view.right, x * step), this.view.above, y * step));
  }

  /** Returns a function from a shift to the changes of an item that is shifted from where it is now. */
  #moved({ section, path, table }, part) {
    if (section === "light") {
      if (part === "to") return (by) => ({ [`${path}.to`]: rounded(plus(table.to, by)) });
      if (table.type === "sun" && isPoint(table.to)) {
        const at = this.#sunAt(table);
        const far = norm(minus(table.from, table.to));
        return (by) => ({ [`${path}.from`]: rounded(plus(table.to, unit(minus(plus(at, by), table.to)), far)) });
      }
      return (by) => ({ [`${path}.from`]: rounded(plus(table.from, by)) });
    }
    if (section === "volume" && table.shape) {
      const keys = ["centre", "from", "to"].filter((key) => isPoint(table[key]));
      return (by) => Object.fromEntries(keys.map((key) => [`${path}.${key}`, rounded(plus(table[key], by))]));
    }
    const pivot = this.#centre(section, table);
    const matrix = matrixOf(table);
    return (by) => {
      this.grip = { path, pivot: plus(pivot, by) };
      return placing(path, table, matrix.map((row, axis) => (axis < 3 ? [...row.slice(0, 3), row[3] + by[axis]] : row)), "translate");
    };
  }

  #turned({ path, table }, pivot) {
    const matrix = matrixOf(table);
    return (axis, angle) => {
      this.grip = { path, pivot };
      const columns = [0, 1, 2].map((index) => turned(columnOf(matrix, index), axis, angle));
      const place = plus(pivot, turned(minus(columnOf(matrix, 3), pivot), axis, angle));
      return placing(path, table, fromColumns(columns, place), "translate", "rotate");
    };
  }

  #scaled({ section, path, table }, pivot) {
    if (section === "volume" && table.shape) {
      if (isPoint(table.centre)) return ([x]) => ({ [`${path}.radius`]: rounded(table.radius * x) });
      return (factors) => Object.fromEntries(["from", "to"].map((key) => [`${path}.${key}`, rounded(table[key].map((v, axis) => pivot[axis] + factors[axis] * (v - pivot[axis])))]));
    }
    const matrix = matrixOf(table);
    const local = unapplied(matrix, pivot);
    return (factors) => {
      this.grip = { path, pivot };
      const columns = [0, 1, 2].map((index) => times(columnOf(matrix, index), factors[index]));
      const linear = local.reduce((sum, value, column) => plus(sum, columns[column], value), [0, 0, 0]);
      return placing(path, table, fromColumns(columns, minus(pivot, linear)), "translate", "scale");
    };
  }
}
