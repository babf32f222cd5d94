// DBS-Net, preset `best` (nets/dbsnet.py): what two preconditioned steps know about the map of mu, corrected by a U-Net
// in logarithmic coordinates, f = z exp(u + iv). The preconditioner is the matrix of mu = 0, factored.
import { dot, zeros } from "./complex.js";
import { DiskMap, normaliserOf } from "./map.js";
import { TAU } from "./mesh.js";
import { moved } from "./mobius.js";
import { partOf, UNet } from "./unet.js";

// what brings each input to the size of 1: FEATURES of nets/dbsnet.py
const SCALES = [1, 1, 1, 1, 3, 3, 10, 10, 20, 20, 10, 10, 5, 20];

const combined = (a, b, factor) => a.map((value, i) => value + factor * b[i]);

export class DBSNet {
  // network: {config, tensors} of the file; mesh: the polar mesh of its config
  constructor(mesh, layers, { config, tensors }) {
    Object.assign(this, { mesh, config, unet: new UNet(layers, partOf(tensors, "unet"), mesh.rings, mesh.spokes) });
    this.solution = new DiskMap(mesh); // lends its boundary
    [this.plain, this.off] = [0, 1].map(() => new Float64Array(mesh.E));
    [this.plainDiagonal, this.diagonal] = [0, 1].map(() => new Float64Array(mesh.V));
    mesh.stiffness(zeros(mesh.F), this.plain, this.plainDiagonal);
  }

  // The map of mu on the faces, at the vertices: f(0) = 0 and f(1) = 1.
  run(mu) {
    const { mesh } = this;
    mesh.stiffness(mu, this.off, this.diagonal);
    mesh.interior.factor(this.plain, this.plainDiagonal);
    const known = this.twoSteps(),
      [u, v] = this.features(mu, known),
      y = this.unet.run(),
      channels = this.unet.head.outputs;
    const N = mesh.rings * mesh.spokes,
      f = zeros(mesh.V),
      fixed = 0.1 * y[(N - mesh.spokes) * channels + 1]; // the turn at 1
    for (let i = 0; i < N; i++) {
      const r = mesh.radius[1 + Math.floor(i / mesh.spokes)],
        x = mesh.z.x[i + 1],
        z = mesh.z.y[i + 1];
      const size = Math.exp(u[i] + 0.1 * y[i * channels] * (1 - r * r)),
        turn = v[i] + 0.1 * y[i * channels + 1] - fixed;
      f.x[i + 1] = size * (x * Math.cos(turn) - z * Math.sin(turn));
      f.y[i + 1] = size * (x * Math.sin(turn) + z * Math.cos(turn));
    }
    return f;
  }

  // K x inside, x = 0 on the circle
  apply(x) {
    const { tail, head, free, E } = this.mesh,
      y = x.map((value, i) => this.diagonal[i] * value);
    for (let e = 0; e < E; e++) {
      const a = tail[e],
        b = head[e];
      if (b >= free || a >= free) continue;
      y[a] += this.off[e] * x[b];
      y[b] += this.off[e] * x[a];
    }
    return y;
  }

  // K(0)^-1 of one or two loads
  precondition(loads) {
    return this.mesh.interior.solved(loads);
  }

  residual(load, x) {
    return combined(load, this.apply(x), -1);
  }

  // so many steps of conjugate gradients for each load, from where they start
  gradients(loads, starts, steps) {
    const x = starts.map((start) => start.slice());
    let rest = loads.map((load, c) => this.residual(load, x[c])),
      p = this.precondition(rest);
    let energy = p.map((z, c) => dot(z, rest[c]));
    for (let step = 1; step <= steps; step++) {
      p.forEach((direction, c) => {
        const q = this.apply(direction),
          length = energy[c] / dot(direction, q);
        x[c] = combined(x[c], direction, length);
        rest[c] = combined(rest[c], q, -length);
      });
      if (step === steps) break;
      const z = this.precondition(rest),
        now = z.map((value, c) => dot(value, rest[c]));
      p = z.map((value, c) => combined(value, p[c], now[c] / energy[c]));
      energy = now;
    }
    return x;
  }

  // angles (spokes) of the circle from U inside
  angles(U) {
    const { solution, mesh } = this,
      { steps } = solution;
    solution.off.set(this.off);
    solution.U.fill(0);
    solution.U.set(U);
    solution.boundary();
    let sum = 0;
    return Float64Array.from({ length: mesh.spokes }, (_, k) => (sum += k ? steps[k - 1] : 0));
  }

  // potentials U of orders 1 and 2, changes of the angles from each to the next, maps of orders 1, 2 and beyond
  twoSteps() {
    const none = new Float64Array(this.mesh.free),
      pole = none.slice();
    pole[0] = -TAU;
    const [U1] = this.gradients([pole], [none], 2),
      [U2] = this.gradients([pole], [U1], 1);
    const [more] = this.precondition([this.residual(pole, U2)]),
      [t1, t2, t3] = [U1, U2, combined(U2, more, 1)].map((U) => this.angles(U));
    const gap = (a, b) => a.map((angle, k) => Math.atan2(Math.sin(b[k] - angle), Math.cos(b[k] - angle)));
    const circle = [t2.map(Math.cos), t2.map(Math.sin)],
      pull = circle.map((values) => this.mesh.rimLoad(this.off, values));
    const maps = [];
    let f = this.precondition(circle.map((values) => this.mesh.rimLoad(this.plain, values)));
    for (let step = 0; step < 2; step++) maps.push(this.normalised((f = this.gradients(pull, f, 1)), circle));
    const rest = this.precondition(pull.map((load, c) => this.residual(load, f[c])));
    maps.push(
      this.normalised(
        f.map((part, c) => combined(part, rest[c], 1)),
        circle,
      ),
    );
    const angles = [gap(t1, t2), gap(t2, t3)];
    const inside = this.precondition(angles.map((values) => this.mesh.rimLoad(this.plain, values)));
    return { U: [U1, U2], maps, angles, inside };
  }

  // [x, y] inside and on the circle as a map of all vertices with f(0) = 0 and f(1) = 1
  normalised(inside, circle) {
    const [x, y] = inside.map((part, k) => Float64Array.from([...part, ...circle[k]]));
    return moved({ x, y }, normaliserOf(this.mesh, { x, y }));
  }

  // the U-Net's input; returns u and v of the map of order 2
  features(mu, { U, maps: [first, second, beyond], angles, inside }) {
    const { mesh, unet } = this,
      { rings, spokes, z, radius } = mesh,
      N = rings * spokes,
      channels = unet.stem.inputs;
    const u = new Float64Array(N),
      v = new Float64Array(N);
    unet.input.fill(0);
    for (let i = 0; i < N; i++) {
      const ring = Math.floor(i / spokes),
        spoke = i % spokes,
        at = i + 1,
        inner = ring < rings - 1;
      const [c, s] = [Math.cos((2 * TAU * spoke) / spokes), -Math.sin((2 * TAU * spoke) / spokes)];
      const faces = [Math.max(2 * ring - 1, 0), 2 * ring].map((row) => row * spokes + spoke); // of the cell inside the node
      const turned = faces.flatMap((t) => [mu.x[t] * c - mu.y[t] * s, mu.x[t] * s + mu.y[t] * c]);
      const start = logRatio(second, z, at),
        low = Math.log(radius[ring + 1]);
      [u[i], v[i]] = [inner ? start[0] : 0, start[1]];
      const [one, two] = U.map((potential) => (inner ? potential[at] - low : 0));
      const rim = angles.map((values, k) => (inner ? inside[k][at] : values[spoke]));
      const seen = [
        ...turned,
        u[i],
        v[i],
        ...logRatio(second, first, at),
        ...logRatio(beyond, second, at),
        two - one,
        two - u[i],
        ...rim,
      ];
      seen.forEach((value, k) => {
        unet.input[i * channels + k] = SCALES[k] * value;
      });
    }
    return [u, v];
  }
}

// [log |a / b|, arg (a / b)] at a vertex
function logRatio(a, b, at) {
  const size = b.x[at] ** 2 + b.y[at] ** 2,
    x = (a.x[at] * b.x[at] + a.y[at] * b.y[at]) / size;
  const y = (a.y[at] * b.x[at] - a.x[at] * b.y[at]) / size;
  return [0.5 * Math.log(x * x + y * y), Math.atan2(y, x)];
}
