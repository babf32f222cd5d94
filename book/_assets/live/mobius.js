// Möbius maps of the unit disk, e^{i theta} (w - a) / (1 - conj(a) w), as [Re a, Im a, theta].
import { choleskyDense, solveDense, zeros } from "./complex.js";

// The map at one point; c + i s = e^{i theta}.
export function mobius(x, y, ax, ay, c = 1, s = 0) {
  const nx = x - ax,
    ny = y - ay;
  const dx = 1 - (ax * x + ay * y),
    dy = ay * x - ax * y;
  const q = 1 / (dx * dx + dy * dy);
  const u = (nx * dx + ny * dy) * q,
    v = (ny * dx - nx * dy) * q;
  return [u * c - v * s, u * s + v * c];
}

// Its derivative, e^{i theta} (1 - |a|^2) / (1 - conj(a) w)^2.
export function mobiusSlope(x, y, ax, ay, c = 1, s = 0) {
  const dx = 1 - (ax * x + ay * y),
    dy = ay * x - ax * y;
  const q = (1 - ax * ax - ay * ay) / (dx * dx + dy * dy) ** 2;
  const u = q * (dx * dx - dy * dy),
    v = -2 * q * dx * dy;
  return [u * c - v * s, u * s + v * c];
}

// The map of an array of points, as a new one.
export function moved(z, [ax, ay, theta]) {
  const w = zeros(z.x.length),
    c = Math.cos(theta),
    s = Math.sin(theta);
  for (let i = 0; i < w.x.length; i++) [w.x[i], w.y[i]] = mobius(z.x[i], z.y[i], ax, ay, c, s);
  return w;
}

// The map `second` after `first`.
export function compose([ax, ay, theta], [bx, by, turn]) {
  const c = Math.cos(theta),
    s = Math.sin(theta);
  const [px, py] = mobius(bx * c + by * s, by * c - bx * s, -ax, -ay); // what the composition sends to 0
  let [x, y] = mobius(1, 0, ax, ay, c, s);
  [x, y] = mobius(x, y, bx, by, Math.cos(turn), Math.sin(turn)); // and where it sends 1
  const nx = 1 - px,
    q = 1 / (nx * nx + py * py); // (1 - conj p) / (1 - p) turns what p alone does to 1
  const ex = (nx * nx - py * py) * q,
    ey = 2 * nx * py * q;
  return [px, py, Math.atan2(x * ey + y * ex, x * ex - y * ey)];
}

// Changes of a point w with an increment (theta, Re a, Im a) after the map: dw = i w dtheta - da + conj(da) w^2.
export function columns(x, y) {
  const sx = x * x - y * y,
    sy = 2 * x * y;
  return [
    [-y, sx - 1, sy],
    [x, sy, -(1 + sx)],
  ];
}

const RIDGE = 1e-9; // relative, of the three columns: fewer than two points leave some of them free

// One Gauss-Newton step from a map towards the best one of p to q: the increment, and the cost before.
function increment(p, q, [ax, ay, theta]) {
  const H = new Float64Array(9),
    g = new Float64Array(3),
    c = Math.cos(theta),
    s = Math.sin(theta);
  let cost = 0;
  for (let m = 0; m < p.x.length; m++) {
    const [x, y] = mobius(p.x[m], p.y[m], ax, ay, c, s),
      rest = [q.x[m] - x, q.y[m] - y];
    columns(x, y).forEach((row, part) => {
      cost += rest[part] ** 2;
      for (let i = 0; i < 3; i++) {
        g[i] += row[i] * rest[part];
        for (let j = 0; j < 3; j++) H[3 * i + j] += row[i] * row[j];
      }
    });
  }
  const ridge = RIDGE * (H[0] + H[4] + H[8] + 1e-12);
  for (let i = 0; i < 3; i++) H[4 * i] += ridge;
  const [turn, dx, dy] = solveDense(choleskyDense(H, 3), 3, g);
  const shrink = 1 / Math.max(1, 2 * Math.hypot(dx, dy)); // no further than 1/2 at once
  return { cost, step: [dx * shrink, dy * shrink, turn] };
}

// Gauss-Newton steps from `start`, or else from the best turn: what CP-Net does.
export function fitMobius(p, q, steps, start) {
  let x = 0,
    y = 0;
  for (let m = 0; m < p.x.length; m++) {
    x += q.x[m] * p.x[m] + q.y[m] * p.y[m];
    y += q.y[m] * p.x[m] - q.x[m] * p.y[m];
  }
  let map = start ?? [0, 0, Math.atan2(y, x)];
  for (let k = 0; k < steps; k++) map = compose(map, increment(p, q, map).step);
  return map;
}

// The map with the least mean |M(p) - q|^2, from eight turns, since a large one could end in a local minimum.
export function bestMobius(p, q) {
  let best = { cost: Infinity };
  for (let turn = 0; turn < 8; turn++) {
    let map = [0, 0, (turn * Math.PI) / 4],
      before = Infinity;
    for (let k = 0; k < 60; k++) {
      const { cost, step } = increment(p, q, map);
      if (cost < best.cost) best = { cost, map };
      if (!(cost < before * (1 - 1e-13))) break;
      before = cost;
      map = compose(map, step);
    }
  }
  return best.map;
}
