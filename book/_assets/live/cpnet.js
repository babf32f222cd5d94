// CP-Net, preset `best` (nets/cpnet.py): the linearised fit, corrected by a U-Net, and corrected again by another after
// each look at the exact map.
import { Born } from "./born.js";
import { boundedFactor, squares, zeros } from "./complex.js";
import { DiskMap } from "./map.js";
import { sample } from "./mesh.js";
import { fitMobius, moved } from "./mobius.js";
import { partOf, UNet } from "./unet.js";

const FIELD = 0.03; // of the U-Nets' outputs that bend the field itself

const minus = (a, b) => ({ x: a.x.map((x, i) => x - b.x[i]), y: a.y.map((y, i) => y - b.y[i]) });
const times = (a, b) => ({
  x: a.x.map((x, i) => x * b.x[i] - a.y[i] * b.y[i]),
  y: a.y.map((y, i) => y * b.x[i] + a.x[i] * b.y[i]),
});
const over = (a, b) => {
  // a / b
  const size = b.x.map((x, i) => x * x + b.y[i] * b.y[i]);
  return {
    x: a.x.map((x, i) => (x * b.x[i] + a.y[i] * b.y[i]) / size[i]),
    y: a.y.map((y, i) => (y * b.x[i] - a.x[i] * b.y[i]) / size[i]),
  };
};
const negative = (a) => ({ x: a.x.map((x) => -x), y: a.y.map((y) => -y) });

export class CPNet {
  // network: {config, tensors} of the file; mesh: the polar mesh of its config
  constructor(mesh, layers, { config, tensors }) {
    Object.assign(this, { mesh, config, born: new Born(mesh, tensors), map: new DiskMap(mesh) });
    [this.one, this.two] = ["one", "two"].map(
      (part) => new UNet(layers, partOf(tensors, part), mesh.rings, mesh.spokes),
    );
    [this.spokesTable, this.arcsTable] = ["spokes", "arcs"].map((name) => tensors[name].data);
  }

  // the gamma that is answered for: the given one, or a smaller one beyond config.stiffest
  gammaUsed({ alpha, beta, gamma }) {
    const { stiffest, smooth } = this.config;
    return Math.min(gamma, alpha * 10 ** stiffest * Math.max(beta / alpha, 10 ** smooth[0]));
  }

  // nu at the vertices of the mesh, for landmarks p, q {x, y}
  run(p, q, weights, looks = this.config.looks) {
    const { alpha, beta } = weights,
      problem = this.born.linearised(p, q, beta / alpha, this.gammaUsed(weights) / alpha);
    const nu = this.born.field(problem.c),
      wanted = over(negative(problem.residual), problem.slope);
    const left = minus(wanted, this.born.linear(problem, problem.c)),
      conditions = this.conditions(problem);
    const fields = [
      [nu, 2, 1],
      [this.born.moved(problem.c), 1, 5],
    ];
    this.show(
      this.one,
      fields,
      problem,
      [
        [wanted, 10],
        [left, 10],
      ],
      true,
    );
    let found = this.correct(this.one, conditions, problem, problem.residual, null);
    for (let k = 0; k < looks; k++) found = this.look(problem, found, conditions);
    return this.withCentre(found);
  }

  conditions({ b, g, count }) {
    const log = (x, [low, high]) => Math.min(Math.max(Math.log10(Math.max(x, 1e-12)), low), high);
    return [log(b, this.config.smooth), log(g, this.config.match) - 4, Math.log10(count) - 2];
  }

  // The U-Net's input: complex fields [values, how often their frame turns with the spoke, scale], then complex values at
  // the landmarks as fields, the number of landmarks at each node (after the first of these, or last), and the radius.
  show(net, fields, problem, marks, countFirst) {
    const {
        mesh: { rings, spokes, radius },
        born: { cos, sin },
      } = this,
      N = rings * spokes,
      channels = net.stem.inputs,
      x = net.input;
    let channel = 0;
    x.fill(0);
    const turning = (values, turns, scale) => {
      for (let i = 0; i < N; i++) {
        const a = (turns * (i % spokes)) % spokes,
          u = scale * values.x[i],
          v = scale * values.y[i];
        x[i * channels + channel] = u * cos[a] + v * sin[a];
        x[i * channels + channel + 1] = v * cos[a] - u * sin[a];
      }
      channel += 2;
    };
    const plain = (value) => {
      for (let i = 0; i < N; i++) x[i * channels + channel] = value(i);
      channel++;
    };
    fields.forEach((field) => turning(...field));
    marks.forEach(([values, scale], k) => {
      const { spread, count } = this.splat(problem.places, values);
      turning(spread, 1, scale);
      if (countFirst ? k === 0 : k === marks.length - 1) plain((i) => count[i]);
    });
    plain((i) => radius[1 + Math.floor(i / spokes)]);
  }

  // landmarks' values shared out to the nodes around them, and how many share a node
  splat(places, values) {
    const N = this.mesh.rings * this.mesh.spokes,
      spread = zeros(N),
      count = new Float64Array(N);
    places.forEach(({ corners, weights }, m) =>
      corners.forEach((v, k) => {
        if (v === 0) return;
        spread.x[v - 1] += weights[k] * values.x[m];
        spread.y[v - 1] += weights[k] * values.y[m];
        count[v - 1] += weights[k];
      }),
    );
    return { spread, count };
  }

  // The dual step for a corrected residual, and a correction of the field itself, from the U-Net's output: at the landmarks
  // a factor and a vector (in units of the residual's size, frame of the spoke), on the grid a factor and an addition.
  correct(net, conditions, problem, residual, linear) {
    const {
        mesh: { spokes },
        born,
      } = this,
      { cos, sin } = born,
      y = net.run(conditions),
      channels = net.head.outputs;
    const N = y.length / channels,
      output = (c) => ({
        x: new Float64Array(N).map((_, i) => y[i * channels + c]),
        y: new Float64Array(N).map((_, i) => y[i * channels + c + 1]),
      });
    const spoke = (turns) => ({
      x: new Float64Array(N).map((_, i) => cos[(turns * (i % spokes)) % spokes]),
      y: new Float64Array(N).map((_, i) => sin[(turns * (i % spokes)) % spokes]),
    });
    const at = (field) => sample(this.withCentre(field), problem.places);
    const gain = at(output(0)),
      vector = at(times(output(2), spoke(1)));
    const size = Math.sqrt(squares(residual, zeros(problem.count)) / problem.count);
    const pulled = times(residual, gain),
      pushed = times(problem.slope, vector),
      wanted = zeros(problem.count);
    for (const part of ["x", "y"]) {
      for (let m = 0; m < problem.count; m++) {
        wanted[part][m] = residual[part][m] + pulled[part][m] + size * pushed[part][m] - (linear ? linear[part][m] : 0);
      }
    }
    const nu = born.field(problem.step(wanted).c),
      factor = times(nu, output(4)),
      addition = times(output(6), spoke(2));
    for (const part of ["x", "y"])
      for (let i = 0; i < N; i++) nu[part][i] += FIELD * (factor[part][i] + addition[part][i]);
    return nu;
  }

  // the exact map of nu on the network's mesh, the chord step from there, and the next correction
  look(problem, nu, conditions) {
    const { mesh, born } = this,
      faces = mesh.onFaces(this.withCentre(nu)),
      mu = zeros(mesh.F);
    for (let t = 0; t < mesh.F; t++) {
      const factor = boundedFactor(faces.x[t], faces.y[t]);
      mu.x[t] = factor * faces.x[t];
      mu.y[t] = factor * faces.y[t];
    }
    if (!this.map.solve(mu)) throw new Error("CP-Net's coefficient has no map");
    const f = this.map.normalised(),
      best = fitMobius(sample(f, problem.places), problem.q),
      w = moved(f, best);
    const residual = minus(sample(w, problem.places), problem.q),
      start = moved(mesh.z, problem.parameters);
    const shift = minus(w, start),
      shifted = { x: shift.x.subarray(1), y: shift.y.subarray(1) };
    const linear = times(problem.slope, born.linear(problem, born.coefficients(nu)));
    const chord = born.field(problem.step(minus(residual, linear)).c);
    const fields = [
      [nu, 2, 1],
      [minus(chord, nu), 2, 1],
      [shifted, 1, 5],
    ];
    this.show(this.two, fields, problem, [[negative(residual), 50]], false);
    const [size, slope] = this.terms(nu),
      miss = squares(residual, zeros(problem.count)) / problem.count;
    const extra = [size + problem.b * slope, problem.g * miss, problem.promised].map((x) =>
      Math.log10(Math.max(x, 1e-12)),
    );
    return this.correct(this.two, [...conditions, ...extra], problem, residual, linear);
  }

  // mean |mu|^2 and mean |grad mu|^2 of mu = T(nu), by the lumped mass and the edges of the grid
  terms(nu) {
    const {
        mesh: { rings, spokes },
        born: {
          tables: { area },
        },
      } = this,
      N = rings * spokes,
      mu = zeros(N);
    for (let i = 0; i < N; i++) {
      const factor = boundedFactor(nu.x[i], nu.y[i]);
      mu.x[i] = factor * nu.x[i];
      mu.y[i] = factor * nu.y[i];
    }
    const gap = (i, j) => (mu.x[i] - mu.x[j]) ** 2 + (mu.y[i] - mu.y[j]) ** 2;
    let size = 0,
      slope = 0;
    for (let i = 0; i < N; i++) {
      const ring = Math.floor(i / spokes),
        following = ring * spokes + ((i + 1) % spokes);
      size += area[ring] * (mu.x[i] ** 2 + mu.y[i] ** 2);
      slope += this.arcsTable[ring] * gap(i, following);
      if (ring < rings - 1) slope += this.spokesTable[ring] * gap(i, i + spokes);
    }
    return [size / Math.PI, slope / Math.PI];
  }

  // values at the nodes of the rings as values at the mesh's vertices: the centre has the first ring's mean
  withCentre({ x, y }) {
    const { spokes, V } = this.mesh,
      out = zeros(V);
    out.x.set(x, 1);
    out.y.set(y, 1);
    out.x[0] = x.subarray(0, spokes).reduce((a, b) => a + b, 0) / spokes;
    out.y[0] = y.subarray(0, spokes).reduce((a, b) => a + b, 0) / spokes;
    return out;
  }
}
