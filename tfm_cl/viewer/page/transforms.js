// Where things are placed: matrices, rows first, and the steps that say the same.

const IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];

const fromColumns = (columns, place) => [...[0, 1, 2].map((row) => [...columns.map((column) => column[row]), place[row]]), [0, 0, 0, 1]];
const applied = (matrix, point) => matrix.slice(0, 3).map((row) => dot(row, point) + row[3]);
const wrapped = (angle) => angle - 360 * Math.round(angle / 360);

/** The world-from-object matrix that `transform`, or else translate, rotate and scale, say. */
function matrixOf(table) {
  if (table.transform && !same(table.transform, IDENTITY)) return rowsOf(table.transform);
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

/** Changes that place an item: in those steps, unless a matrix says where it is, which may be more than steps can say. */
function placing(path, table, matrix, ...steps) {
  if (table.transform && !same(table.transform, IDENTITY)) return { [`${path}.transform`]: rounded(matrix.flat()) };
  const columns = [0, 1, 2].map((index) => columnOf(matrix, index));
  const scale = columns.map(norm);
  if (dot(columns[0], cross(columns[1], columns[2])) < 0) scale[0] *= -1; // mirrored
  const [x, y, z] = columns.map((column, index) => times(column, 1 / scale[index]));
  // Rz Ry Rx
  const level = Math.hypot(x[0], x[1]);
  const rotate = level > 1e-9 ? [Math.atan2(y[2], z[2]), Math.atan2(-x[2], level), Math.atan2(x[1], x[0])] : [Math.atan2(-z[1], y[1]), Math.atan2(-x[2], level), 0];
  const says = {
    translate: rounded(columnOf(matrix, 3)),
    rotate: rotate.map((angle) => Number(degrees(angle).toFixed(4)) + 0),
    scale: rounded(scale),
  };
  return Object.fromEntries(steps.map((step) => [`${path}.${step}`, says[step]]));
}

/** Turn a vector by the smallest rotation that takes +y to `up`. */
function fromYUp(up, vector) {
  const axis = cross([0, 1, 0], up);
  const size = norm(axis);
  if (size < 1e-9) return up[1] > 0 ? vector : [-vector[0], -vector[1], vector[2]];
  return turned(vector, times(axis, 1 / size), Math.atan2(size, up[1]));
}
