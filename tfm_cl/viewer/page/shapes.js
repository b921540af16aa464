// Outlines of handles, in pixels of the stage.

const point2 = ([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`;
const distance2 = (a, b) => (a === null ? Infinity : Math.hypot(a[0] - b[0], a[1] - b[1]));
const disc = ([x, y], r) => `M${point2([x - r, y])}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;
const diamond = ([x, y], r) => `M${point2([x, y - r])}L${point2([x + r, y])}L${point2([x, y + r])}L${point2([x - r, y])}Z`;
const square = ([x, y], r) => `M${point2([x - r, y - r])}h${2 * r}v${2 * r}h${-2 * r}Z`;
const cross2 = (at, r) => `${disc(at, 0.8 * r)}M${point2([at[0] - 1.5 * r, at[1]])}h${3 * r}M${point2([at[0], at[1] - 1.5 * r])}v${3 * r}`;

/** A light: a disc with rays. */
function star(at, r) {
  const rays = Array.from({ length: 8 }, (_, index) => {
    const [x, y] = [Math.cos((Math.PI * index) / 4), Math.sin((Math.PI * index) / 4)];
    return `M${point2([at[0] + 1.35 * r * x, at[1] + 1.35 * r * y])}L${point2([at[0] + 1.9 * r * x, at[1] + 1.9 * r * y])}`;
  });
  return disc(at, 0.85 * r) + rays.join("");
}

function arrowHead(start, end, scale) {
  const size = 9 * scale;
  const far = distance2(start, end) || 1;
  const [x, y] = [(end[0] - start[0]) / far, (end[1] - start[1]) / far];
  const tip = [end[0] + size * x, end[1] + size * y];
  return `M${point2(tip)}L${point2([end[0] - 0.5 * size * y, end[1] + 0.5 * size * x])}L${point2([end[0] + 0.5 * size * y, end[1] - 0.5 * size * x])}Z`;
}

const squareHead = (start, end, scale) => square(end, 4.5 * scale);
