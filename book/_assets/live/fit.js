// The landmark fit: Gauss-Newton steps for a field nu on a polar mesh and a Möbius map M after the map f of mu = T(nu).
//   minimise  nu^* W nu + gamma mean |M(f(p)) - q|^2,   W = (alpha mass + beta Laplace) / pi.
// Unknowns are few in the dual: one system of the landmarks' size a step (registration/gauss_newton.py does the same).
import { bothSides, bounded, dot, dualSolve, largest, meanDistance, sizes, squares, zeros } from "./complex.js";
import { Cholesky } from "./cholesky.js";
import { combine, gradients, rooms } from "./gradients.js";
import { checkWeights, Problem } from "./landmarks.js";
import { DiskMap, onCircle } from "./map.js";
import { sample } from "./mesh.js";
import { bestMobius, columns, compose, moved } from "./mobius.js";
import { unfold } from "./repair.js";

const SHARES = [1, 0.5, 0.25, 0.125]; // of a step, tried in turn
const SUFFICIENT = 0.3; // share of what the model promises that a step has to gain
const MOBIUS_PRIOR = 1e-6; // weak, keeps the three Möbius parameters' step bounded
const FIRST_GAMMA = 1e2; // continuation on the coarse mesh: a step at each power of ten from here
const PROMISE = 1e-3; // the share of the objective that a step has to promise to be taken
const DAMPINGS = Array.from({ length: 11 }, (_, k) => 10 ** (k - 1)); // of further steps, in parts of W
const TRUST = 0.3; // the largest change of nu in a damped step
const TRIES = 4; // damped steps, at most
const STUCK = 0.5; // share of the objective that the next step promises: of fits that got stuck 0.92 to 1, of others up to 0.33
export const ROUNDING = 1e-9;

export class Fit {
  // mends: whether folds are mended by row switching, as on the mesh that is shown
  constructor(mesh, problem, mends = false) {
    Object.assign(this, { mesh, problem, mends });
    this.solution = mesh.map ??= new DiskMap(mesh);
    this.prior = mesh.prior ??= new Cholesky(mesh.V, mesh.tail, mesh.head, mesh.kernels);
    this.room = rooms(mesh, problem.count);
    this.places = Array.from(problem.p.x, (x, m) => mesh.locate(x, problem.p.y[m]));
    this.nu = zeros(mesh.V);
    this.mobius = bestMobius(problem.p, problem.q);
    this.steps = 0;
  }

  weigh({ alpha, beta }) {
    const { mass, laplace } = this.mesh.integrals;
    const sum = (a, b) => a.map((x, i) => alpha * x + beta * b[i]);
    this.W = { off: sum(mass.off, laplace.off), diagonal: sum(mass.diagonal, laplace.diagonal) };
    this.prior.factor(this.W.off, this.W.diagonal);
  }

  // Go to nu and a Möbius map: one solve. False where there is no map.
  to(nu, map) {
    const { mesh } = this,
      nuFaces = mesh.onFaces(nu);
    if (!this.solution.solve(bounded(nuFaces))) return false;
    Object.assign(this, { nu, nuFaces, mobius: map });
    this.follow(onCircle(mesh, moved(this.solution.f, compose(this.solution.normaliser(), map))));
    return true;
  }

  follow(w) {
    this.switched = 0;
    if (this.mends) ({ w, switched: this.switched } = unfold(this.solution, w));
    this.folded = this.switched > 0 && this.mesh.flipped(w).length > 0;
    this.w = w;
    this.points = sample(w, this.places);
  }

  prior2(nu = this.nu) {
    return this.mesh.quadratic(this.W, nu);
  }
  objective(gamma) {
    return this.prior2() + this.problem.mismatch(this.points, gamma);
  }
  get landmarkError() {
    return meanDistance(this.points, this.problem.q);
  }

  // J, lifted by the prior, and its Gram matrix
  linearise() {
    const { mesh, room, prior, nu } = this,
      { J } = room,
      R = 2 * room.M,
      Jnu = new Float64Array(R);
    gradients(this.solution, room, this.places, this.mobius, this.nuFaces, prior.place);
    for (let v = 0; v < mesh.V; v++) {
      const j = prior.place[v] * 2 * R,
        x = nu.x[v],
        y = nu.y[v];
      for (let r = 0; r < R; r++) Jnu[r] += J[j + r] * x + J[j + R + r] * y;
    }
    this.Jnu = Jnu;
    prior.forward(J, 2 * R);
    mesh.kernels.gram(2 * mesh.V, J, R, room.gram);
    for (let c = 0; c < R; c++) for (let d = 0; d < c; d++) room.gram[d * R + c] = room.gram[c * R + d];
  }

  // The step from the last linearisation: {change of nu, Möbius increment, least objective of the model}. damping adds
  // `damping change^* W change`, and its like for M: shorter, towards the steepest descent.
  propose(gamma, damping = 0) {
    const { M } = this.room,
      R = 2 * M,
      share = 1 / (1 + damping),
      weight = MOBIUS_PRIOR + damping;
    const { problem, points, Jnu } = this,
      halves = (x) => [x.subarray(0, M), x.subarray(M)];
    const scaled = (x) => {
      problem.components(...halves(x), gamma);
      return x;
    };
    const three = this.mobiusColumns(M).map(scaled),
      r = scaled(
        new Float64Array(R).map((_, i) => {
          const m = i % M,
            at = i < M ? "x" : "y";
          return m < problem.count ? points[at][m] - problem.q[at][m] - share * Jnu[i] : 0;
        }),
      );
    const S = bothSides(Float64Array.from(this.room.gram), R, scaled), // the Gram matrix of the components
      [a, b, c] = three;
    for (let i = 0; i < R; i++) {
      for (let j = 0; j < R; j++) S[i * R + j] += (a[i] * a[j] + b[i] * b[j] + c[i] * c[j]) / (share * weight);
    }
    const y = dualSolve(S, share, r),
      promised = dot(y, r);
    const [turn, dx, dy] = three.map((c) => -dot(c, y) / weight);
    problem.changes(...halves(y), gamma);
    const step = combine(this.mesh, this.prior, this.room, y),
      change = zeros(this.mesh.V);
    for (let v = 0; v < this.mesh.V; v++) {
      change.x[v] = -share * (step.x[v] + this.nu.x[v]);
      change.y[v] = -share * (step.y[v] + this.nu.y[v]);
    }
    return { change, increment: [dx, dy, turn], promised };
  }

  // changes of the landmarks with a Möbius increment (theta, Re a, Im a) after the map, three arrays (2M)
  mobiusColumns(M) {
    const found = [0, 1, 2].map(() => new Float64Array(2 * M));
    this.places.forEach(({ corners, weights }, m) =>
      corners.forEach((v, k) => {
        const [re, im] = columns(this.w.x[v], this.w.y[v]);
        found.forEach((column, i) => {
          column[m] += weights[k] * re[i];
          column[M + m] += weights[k] * im[i];
        });
      }),
    );
    return found;
  }

  // to a share of a step from `begin`: whether that is a map
  advance({ nu, mobius }, { change, increment: [dx, dy, turn] }, share = 1) {
    const next = { x: nu.x.map((x, v) => x + share * change.x[v]), y: nu.y.map((y, v) => y + share * change.y[v]) };
    return this.to(next, compose(mobius, [share * dx, share * dy, share * turn]));
  }

  // One step: the first share that gains enough, else the best of these and of damped steps; none that leads from a map
  // that does not fold to one that does. False, and nothing has changed, where none lowers the objective.
  descend(gamma, whole) {
    const before = this.objective(gamma),
      begin = { nu: this.nu, mobius: this.mobius, folded: this.folded };
    let best = { gain: 0, nu: begin.nu, mobius: begin.mobius };
    const gains = (step, share) => {
      const sound = this.advance(begin, step, share) && (begin.folded || !this.folded);
      const gain = sound ? before - this.objective(gamma) : -1;
      if (gain > best.gain) best = { gain, nu: this.nu, mobius: this.mobius };
      return gain;
    };
    for (const share of SHARES)
      if (gains(whole, share) > SUFFICIENT * (2 * share - share ** 2) * (before - whole.promised)) return true;
    this.to(begin.nu, begin.mobius);
    for (const step of this.damped(gamma)) gains(step);
    this.to(best.nu, best.mobius);
    return best.gain > 0;
  }

  // steps of the least damping that keeps them small
  damped(gamma) {
    const steps = [];
    for (let k = 0; k < DAMPINGS.length && steps.length < TRIES; k++) {
      const step = this.propose(gamma, DAMPINGS[k]);
      if (largest(sizes(step.change)) <= TRUST) steps.push(step);
    }
    return steps;
  }

  // Steps at each gamma of a list, at the last one until a step promises less than the share `tolerance` of the objective.
  run(gammas, most, tolerance = PROMISE) {
    for (let k = 0; k < most + gammas.length - 1; k++) {
      const last = k >= gammas.length - 1,
        gamma = gammas[Math.min(k, gammas.length - 1)];
      this.linearise();
      const step = this.propose(gamma);
      this.left = 1 - step.promised / this.objective(gamma);
      if (last && this.left < tolerance) break;
      const found = this.descend(gamma, step);
      this.steps += found ? 1 : 0;
      if (last && !found) break;
    }
  }

  // begin with another mesh's field and Möbius map
  take(other) {
    const places = Array.from(this.mesh.z.x, (x, v) => other.mesh.locate(x, this.mesh.z.y[v]));
    return this.to(sample(other.nu, places), other.mobius);
  }
}

// continuation: the powers of ten from FIRST_GAMMA up to gamma
function rising(gamma) {
  const levels = [];
  for (let g = FIRST_GAMMA; g < gamma * (1 - 1e-9); g *= 10) levels.push(g);
  return [...levels, gamma];
}

// The fit on a coarse mesh by continuation in gamma, at a tenth of it: the coarse mesh's own error would bend nu at the full
// weight. Folds are not mended.
export function fitCoarse(coarse, request, tolerance = PROMISE, problem = new Problem(request)) {
  checkWeights(request);
  const first = new Fit(coarse, problem);
  first.weigh(request);
  first.to(first.nu, first.mobius);
  first.run(rising(request.gamma / 10), 5, tolerance);
  return first;
}

// The fit on a coarse mesh, then on the fine one; where that gets stuck, the better of it and one by continuation on the fine
// mesh. It depends on the request alone: it starts from mu = 0 each time. Ends nowhere above the best Möbius map.
export function fitLandmarks({ coarse, fine }, request, { tolerance = PROMISE, most = 20, stuck = STUCK } = {}) {
  const problem = new Problem(request),
    first = fitCoarse(coarse, request, tolerance, problem),
    fit = new Fit(fine, problem, true);
  fit.weigh(request);
  const best = moved(fit.problem.p, fit.mobius),
    mobius = fit.mobius;
  fit.take(first);
  fit.run([request.gamma], most, tolerance);
  if (fit.left > stuck || exceeds(fit, request.gamma, best)) {
    const { nu, mobius: last, left } = fit,
      loss = exceeds(fit, request.gamma, best) ? Infinity : fit.objective(request.gamma);
    fit.to(zeros(fine.V), mobius);
    fit.run(rising(request.gamma), most, tolerance);
    if (loss < fit.objective(request.gamma)) {
      fit.to(nu, last);
      fit.left = left;
    }
    if (exceeds(fit, request.gamma, best)) fit.to(zeros(fine.V), mobius);
  }
  fit.coarseSteps = first.steps;
  return fit;
}

// whether a fit ends above the best Möbius map, which takes the landmarks to `best`
function exceeds(fit, gamma, best) {
  const { problem, points } = fit,
    most = 1 + ROUNDING;
  const lower = fit.objective(gamma) <= most * problem.mismatch(best, gamma);
  return !(lower && squares(points, problem.q) <= most * squares(best, problem.q));
}
