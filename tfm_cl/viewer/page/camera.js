// The camera: where a point of the world is in the picture, and how the camera moves, as in other 3D programs.

const NEAREST_POLE = radians(1.5); // between the view and `up`: beyond, the picture would turn over

/** Where the camera stands, however the scene says it. `far`: how far away what it looks at is, where only a matrix is given. */
function placed(camera, far = 1) {
  const rows = rowsOf(camera.matrix);
  if (rows) {
    const from = columnOf(rows, 3);
    return { from, to: plus(from, columnOf(rows, 2), -far), up: columnOf(rows, 1) };
  }
  return { from: camera.from, to: camera.to, up: camera.up ?? [0, 1, 0] };
}

/** The vertical field of view, radians. */
function fieldOfView(camera) {
  if (Number.isFinite(camera.fov)) return radians(camera.fov);
  const [width, height] = camera.res;
  return 2 * Math.atan2(((camera.sensor_width ?? 36) / 2) * (height / width), camera.focal_length ?? 50);
}

/** How a camera sees: points of the picture are x, y from 0 to 1, from its upper left corner. */
class View {
  constructor(camera, far) {
    Object.assign(this, placed(camera, far));
    this.aspect = camera.res[0] / camera.res[1];
    this.tangent = Math.tan(fieldOfView(camera) / 2);
    this.forward = unit(minus(this.to, this.from));
    [this.right, this.above] = across(this.forward, this.up);
    this.distance = norm(minus(this.to, this.from));
  }

  /** Where a point is in the picture; null behind the camera. */
  project(point) {
    const from = minus(point, this.from);
    const depth = dot(from, this.forward);
    if (depth < 1e-6 * this.distance) return null;
    const reach = depth * this.tangent;
    return [0.5 + dot(from, this.right) / (2 * reach * this.aspect), 0.5 - dot(from, this.above) / (2 * reach)];
  }

  /** Unit direction through a place of the picture. */
  ray(x, y) {
    const aside = plus(this.forward, this.right, (2 * x - 1) * this.tangent * this.aspect);
    return unit(plus(aside, this.above, (1 - 2 * y) * this.tangent));
  }

  /** From the target to what is at its distance under a place of the picture. */
  aside(x, y) {
    const reach = this.tangent * this.distance;
    return plus(times(this.right, (2 * x - 1) * reach * this.aspect), this.above, (1 - 2 * y) * reach);
  }

  /** World units that the picture's height shows at a point. */
  heightAt(point) {
    return 2 * this.tangent * Math.max(dot(minus(point, this.from), this.forward), 1e-6 * this.distance);
  }
}

/** Turn about the target; x and y are of the picture's height, a full height half a turn. */
function orbited({ from, to, up }, x, y) {
  const axis = unit(up);
  let arm = turned(minus(from, to), axis, -Math.PI * x);
  const polar = Math.acos(clamp(dot(unit(arm), axis), -1, 1));
  const wanted = clamp(polar - Math.PI * y, NEAREST_POLE, Math.PI - NEAREST_POLE);
  const [side] = across(unit(arm), axis);
  arm = turned(arm, side, polar - wanted);
  return { from: plus(to, arm), to };
}

/** Shift so that what is at the target's distance stays under the cursor. */
function panned(view, x, y) {
  const height = view.heightAt(view.to);
  const by = plus(times(view.right, -x * height), view.above, y * height);
  return { from: plus(view.from, by), to: plus(view.to, by) };
}

/** Go nearer or away from what is `aside` of the target, which stays where it is in the picture; closer than `least` the target goes ahead. */
function dollied({ from, to }, factor, least, aside = [0, 0, 0]) {
  const point = plus(to, aside);
  const next = plus(point, minus(from, point), factor);
  const goesAhead = factor < 1 && factor * norm(minus(from, to)) < least;
  return { from: next, to: goesAhead ? plus(to, minus(next, from)) : plus(point, aside, -factor) };
}

/** Look the same way at all that lies in a ball. */
function framed(view, { centre, radius }) {
  const half = Math.atan(view.tangent * Math.min(1, view.aspect));
  return { from: plus(centre, view.forward, (-1.02 * radius) / Math.sin(half)), to: centre };
}
