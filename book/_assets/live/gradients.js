// How the mapped landmarks move with the field nu: by adjoint solves, all landmarks at once.
//
// With w_m = M(f(p_m)), the gradients of Re w_m and Im w_m with respect to nu at every vertex are the columns of J. One
// landmark's adjoint has two parts: g, a Green's function of A(mu) at p_m, says how w_m moves with K(mu) f; l says
// how it moves with K(mu) U through the angles of the circle. A face's share of J is then linear in g and l.
import { activation, zeros } from "./complex.js";
import { TAU } from "./mesh.js";
import { compose, mobius, mobiusSlope } from "./mobius.js";

export const MOST_LANDMARKS = 128; // the arrays are made once for so many

// Arrays for `count` landmarks and the origin, M in all, M even (WebAssembly works on two at a time: a last one may be
// empty). Rows of g, l and J are in the order of elimination; each has the M real parts first, then the M imaginary ones;
// a row of J has two such halves, for Re nu and Im nu.
export function rooms(mesh, count) {
  const { numbers } = mesh.kernels,
    { V, free, spokes } = mesh,
    most = MOST_LANDMARKS + 2,
    M = count + 2 - (count & 1);
  mesh.room ??= {
    g: numbers(free * 2 * most),
    l: numbers(free * 2 * most),
    onRim: numbers(spokes * 2 * most),
    J: numbers(V * 4 * most),
    gram: numbers(4 * most * most + 4),
    shares: numbers(18),
    none: numbers(2 * most),
    pair: numbers(2 * V),
  };
  const { room } = mesh,
    R = 2 * M;
  const [g, l] = [room.g, room.l].map((array) => array.subarray(0, free * R)),
    onRim = room.onRim.subarray(0, spokes * R),
    J = room.J.subarray(0, V * 2 * R),
    gram = room.gram.subarray(0, R * R);
  return { ...room, M, g, l, onRim, J, gram };
}

// J at the last map of `solution`; places of the landmarks, the Möbius map after the normalised f, nu on the faces.
export function gradients(solution, room, places, map, nuFaces, order) {
  const rimShare = greens(solution, room, places, map);
  rimAdjoint(solution, room, rimShare);
  measures(solution, room);
  addFaces(solution, room, nuFaces, order);
  normalisation(solution, room, places, map);
}

// g: the Green's functions at the landmarks times the slope of all that follows f, and that of the origin, the last;
// returns what is left of each on the circle (spokes, 2M)
function greens(solution, { M, g }, places, map) {
  const { mesh, f, off } = solution,
    { free, spokes, rim, interior } = mesh,
    R = 2 * M;
  const [ax, ay, theta] = compose(solution.normaliser(), map),
    c = Math.cos(theta),
    s = Math.sin(theta);
  const onRim = new Float64Array(spokes * R);
  g.fill(0);
  places.forEach(({ corners, weights }, m) =>
    corners.forEach((v, k) => {
      const [x, y] = mobiusSlope(f.x[v], f.y[v], ax, ay, c, s);
      const [to, row] = v < free ? [g, interior.place[v]] : [onRim, v - free];
      to[row * R + m] += weights[k] * x;
      to[row * R + M + m] += weights[k] * y;
    }),
  );
  g[interior.place[0] * R + places.length] = 1;
  interior.solve(g, R);
  for (let i = 0; i < rim.length; i += 3) {
    const from = interior.place[rim[i + 1]] * R,
      to = rim[i + 2] * R,
      weight = off[rim[i]];
    for (let c = 0; c < R; c++) onRim[to + c] -= weight * g[from + c];
  }
  return onRim;
}

// onRim: how each landmark moves with the flux through each vertex of the circle. A boundary value moves with its angle
// by i f; a step moves every later angle; the steps are scaled to a full turn; a flux enters two steps.
function rimAdjoint({ mesh, f, steps, raised, scale }, { M, onRim }, share) {
  const { free, spokes } = mesh,
    R = 2 * M,
    later = new Float64Array(R),
    total = new Float64Array(R);
  for (let b = spokes - 1; b >= 0; b--) {
    const x = f.x[free + b],
      y = f.y[free + b],
      part = steps[b] / TAU;
    for (let c = 0; c < R; c++) {
      onRim[b * R + c] = later[c];
      total[c] += part * later[c];
    }
    for (let m = 0; m < M; m++) {
      const u = share[b * R + m],
        v = share[b * R + M + m];
      later[m] -= y * u + x * v;
      later[M + m] += x * u - y * v;
    }
  }
  for (let b = 0; b < spokes; b++) {
    for (let c = 0; c < R; c++) onRim[b * R + c] = raised[b] ? 0 : scale * (onRim[b * R + c] - total[c]);
  }
  const last = onRim.slice((spokes - 1) * R);
  for (let b = spokes - 1; b >= 0; b--) {
    const before = b ? onRim.subarray((b - 1) * R, b * R) : last;
    for (let c = 0; c < R; c++) onRim[b * R + c] = (onRim[b * R + c] + before[c]) / 2;
  }
}

// l inside: the adjoint of U, harmonic with the values onRim on the circle
function measures({ mesh, off }, { M, l, onRim }) {
  const { rim, interior } = mesh,
    R = 2 * M;
  l.fill(0);
  for (let i = 0; i < rim.length; i += 3) {
    const to = interior.place[rim[i + 1]] * R,
      from = rim[i + 2] * R,
      weight = off[rim[i]];
    for (let c = 0; c < R; c++) l[to + c] -= weight * onRim[from + c];
  }
  interior.solve(l, R);
}

// J: on each face the derivative of |T| grad g . A(mu) grad x by mu, x = Re f, Im f and U, through mu = T(nu), a third
// of it for each corner.
function addFaces(solution, room, nu, order) {
  const { mesh } = solution,
    { F, faces, free, interior } = mesh,
    { g, l, onRim, none, J, M, shares } = room;
  const rows = new Array(9),
    place = new Int32Array(9),
    R = 2 * M;
  J.fill(0);
  for (let t = 0; t < F; t++) {
    faceShares(solution, nu, t, shares);
    for (let k = 0; k < 3; k++) {
      const v = faces[3 * t + k],
        inner = v < free,
        row = inner ? interior.place[v] * R : 0;
      rows[k] = inner ? g : none;
      place[k] = row;
      rows[3 + k] = inner ? l : onRim;
      place[3 + k] = inner ? row : (v - free) * R;
      rows[6 + k] = J;
      place[6 + k] = order[v] * 2 * R;
    }
    mesh.kernels.face(M, shares, rows, place);
  }
}

// f is normalised to f(0) = 0 and f(1) = 1: where the solution moves the origin by da, a Möbius map brings it back, and
// w moves by M'(w) ((w - 1) k da + (w^2 - w) conj(k da)), k = e^{i theta} / (1 - |a|^2). The origin's own columns end at 0.
function normalisation(solution, { M, J }, places, [bx, by, turn]) {
  const { mesh, f } = solution,
    [ax, ay, theta] = solution.normaliser(),
    size = 1 / (1 - ax * ax - ay * ay);
  const kx = size * Math.cos(theta),
    ky = size * Math.sin(theta),
    c = Math.cos(turn),
    s = Math.sin(turn);
  // Re a in Re w, Im a in Re w, Re a in Im w, Im a in Im w, for each landmark
  const shares = [0, 1, 2, 3].map(() => new Float64Array(places.length));
  places.forEach(({ corners, weights }, m) =>
    corners.forEach((v, i) => {
      const [x, y] = mobius(f.x[v], f.y[v], ax, ay, Math.cos(theta), Math.sin(theta));
      const [p, q] = mobiusSlope(x, y, bx, by, c, s),
        ex = weights[i] * (p * kx - q * ky),
        ey = weights[i] * (p * ky + q * kx);
      const gx = weights[i] * (p * kx + q * ky),
        gy = weights[i] * (q * kx - p * ky); // slope times k, and times conj(k)
      const dx = ex * (x - 1) - ey * y,
        dy = ex * y + ey * (x - 1),
        ux = x * x - y * y - x,
        uy = 2 * x * y - y;
      const hx = gx * ux - gy * uy,
        hy = gx * uy + gy * ux;
      [dx + hx, hy - dy, dy + hy, dx - hx].forEach((part, n) => {
        shares[n][m] += part;
      });
    }),
  );
  const [a, b, d, e] = shares;
  for (let row = 0; row < 2 * mesh.V; row++) {
    const at = 2 * row * M,
      o = at + places.length,
      re = J[o],
      im = J[o + M];
    for (let m = 0; m < a.length; m++) {
      J[at + m] += a[m] * re + b[m] * im;
      J[at + M + m] += d[m] * re + e[m] * im;
    }
    J[o] = J[o + M] = 0;
  }
}

// shares[6 x + 2 k + part]: what the adjoint of potential x at corner k gives to the real or imaginary part of J
function faceShares({ mesh, mu, f, U }, nu, t, shares) {
  const { faces, area, gradient } = mesh,
    { x: gx, y: gy } = gradient,
    a = mu.x[t],
    b = mu.y[t],
    scale = 1 / (1 - a * a - b * b);
  const [along, ex, ey] = activation(nu.x[t], nu.y[t]);
  for (let x = 0; x < 3; x++) {
    const potential = x === 0 ? f.x : x === 1 ? f.y : U;
    let qx = 0,
      qy = 0;
    for (let i = 3 * t; i < 3 * t + 3; i++) {
      qx += gx[i] * potential[faces[i]];
      qy += gy[i] * potential[faces[i]];
    }
    const rx = 2 * scale * (qx - a * qx - b * qy),
      ry = 2 * scale * (qy - b * qx + a * qy); // q + A(mu) q
    const lx = (a * rx + b * ry) / 2 - qx,
      ly = (b * rx - a * ry) / 2 - qy; // mu conj(r) / 2 - q
    const cx = (a * rx - b * ry) / 2,
      cy = (a * ry + b * rx) / 2; // mu r / 2
    const weight = ((x === 2 ? 2 : -2) * area[t] * scale) / 3;
    for (let k = 0; k < 3; k++) {
      const g = gx[3 * t + k],
        e = gy[3 * t + k];
      const u = weight * (lx * g - ly * e + cx * g + cy * e),
        v = weight * (lx * e + ly * g + cy * g - cx * e);
      shares[6 * x + 2 * k] = along * u + ex * u + ey * v;
      shares[6 * x + 2 * k + 1] = along * v + ey * u - ex * v;
    }
  }
}

// For the J that has been lifted (L_W^-1 J): y -> the step sum_r J_r y_r through L_W^-T, a complex nodal field.
export function combine(mesh, prior, { J, M, pair }, y) {
  const R = 2 * M,
    out = zeros(mesh.V);
  for (let j = 0; j < mesh.V; j++) {
    let u = 0,
      v = 0;
    for (let r = 0; r < R; r++) {
      u += J[2 * j * R + r] * y[r];
      v += J[(2 * j + 1) * R + r] * y[r];
    }
    pair[2 * j] = u;
    pair[2 * j + 1] = v;
  }
  prior.backward(pair, 2);
  for (let v = 0; v < mesh.V; v++) {
    out.x[v] = pair[2 * prior.place[v]];
    out.y[v] = pair[2 * prior.place[v] + 1];
  }
  return out;
}
