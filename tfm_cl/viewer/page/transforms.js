// Where things are placed: matrices, rows first, and the steps that say the same.

const IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
const STEPS = ["translate", "rotate", "scale"];
const SHEAR = 2e-4; // cosine between axes: files often write matrices with four digits

const fromColumns = (columns, place) => [...[0, 1, 2].map((row) => [...columns.map((column) => column[row]), place[row]]), [0, 0, 0, 1]];
const applied = (matrix, point) => matrix.slice(0, 3).map((row) => dot(row, point) + row[3]);
const wrapped = (angle) => angle - 360 * Math.round(angle / 360);

/** Whether a table says by a matrix where something is. */
const isOfMatrix = (table) => Boolean(table?.transform) && !same(rowsOf(table.transform), IDENTITY);

/** The world-from-object matrix that `transform`, or else translate, rotate and scale, say. */
function matrixOf(table) {
  if (isOfMatrix(table)) return rowsOf(table.transform);
  const scale = typeof table.scale === "number" ? Array(3).fill(table.scale) : table.scale ?? [1, 1, 1];
  let columns = AXES.map((axis, index) => times(axis, scale[index]));
  (table.rotate ?? [0, 0, 0]).forEach((angle, index) => { columns = columns.map((column) => turned(column, AXES[index], radians(angle))); });
  return fromColumns(columns, table.translate ?? [0, 0, 0]);
}

/** The point of the object that is at a point of the world. */
function unapplied(matrix, point) {
  const columns = [0, 1, 2].map((index) => columnOf(matrix, index));
  const away = minus(point, columnOf(matrix, 3));
  const volume = dot(columns[0], cross(columns[1], columns[2]));
  return [0, 1, 2].map((index) => dot(away, cross(columns[(index + 1) % 3], columns[(index + 2) % 3])) / volume);
}

/** The steps that say what a matrix says; null where it shears, which none do. */
function stepsOf(matrix) {
  const columns = [0, 1, 2].map((index) => columnOf(matrix, index));
  const scale = columns.map(norm);
  if (dot(columns[0], cross(columns[1], columns[2])) < 0) scale[0] *= -1; // mirrored
  const [x, y, z] = columns.map((column, index) => times(column, 1 / scale[index]));
  if (Math.max(...[dot(x, y), dot(y, z), dot(z, x)].map(Math.abs)) > SHEAR) return null;
  // Rz Ry Rx
  const level = Math.hypot(x[0], x[1]);
  const rotate = level > 1e-6 ? [Math.atan2(y[2], z[2]), Math.atan2(-x[2], level), Math.atan2(x[1], x[0])] : [Math.atan2(-z[1], y[1]), Math.atan2(-x[2], level), 0];
  return {
    translate: rounded(columnOf(matrix, 3)),
    rotate: rotate.map((angle) => Number(degrees(angle).toFixed(4)) + 0),
    // One size stays one, whatever digits the matrix has: shapes of points and curves take no other.
    scale: rounded(scale.map((size) => (same(Math.abs(size), Math.abs(scale[2])) ? Math.sign(size) * scale[2] : size))),
  };
}

/** Whether a table's matrix is more than steps can say. */
const isSheared = (table) => isOfMatrix(table) && stepsOf(rowsOf(table.transform)) === null;

/** Changes that place an item in those steps; in all of them, as they take the place of a matrix, unless it shears. */
function placing(path, table, matrix, ...steps) {
  const says = stepsOf(matrix);
  if (isOfMatrix(table) && says === null) return { [`${path}.transform`]: rounded(matrix.flat()) };
  return saidAt(path, says, isOfMatrix(table) ? STEPS : steps);
}

const saidAt = (path, says, keys) => Object.fromEntries(keys.map((key) => [`${path}.${key}`, says[key]]));

/** Dotted keys that say in another way what a key says of where something is. */
function rivalsOf(key) {
  const [, path, last] = /^(.*)\.(\w+)$/.exec(key) ?? [];
  const others = key === "camera.from" ? ["matrix"] : STEPS.includes(last) ? ["transform"] : last === "transform" ? STEPS : [];
  return others.map((other) => `${path}.${other}`);
}

/** Turn a vector by the smallest rotation that takes +y to `up`. */
function fromYUp(up, vector) {
  const axis = cross([0, 1, 0], up);
  const size = norm(axis);
  if (size < 1e-9) return up[1] > 0 ? vector : [-vector[0], -vector[1], vector[2]];
  return turned(vector, times(axis, 1 / size), Math.atan2(size, up[1]));
}
