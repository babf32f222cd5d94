// Where a map takes the curves of a landmark problem, and how far they are off: through space on the control's surface, in mm,
// or in hundredths of the disk's radius where a problem has no surface.
import { fromPairs } from "./complex.js";
import { meshOf, sample } from "./mesh.js";
import { bestMobius, moved } from "./mobius.js";
import { apart } from "./paths.js";
import { labelsOf, nameOf, problemOf, surfaceOf } from "./problems.js";
import { distance } from "./triangles.js";

const FILLED = 4; // pieces of a step of a drawn line where its distance to another one is measured

export const mean = (list) => list.reduce((a, b) => a + b, 0) / list.length;
const filled = (line) =>
  line.flatMap(([x, y], k) => {
    if (k + 1 === line.length) return [[x, y]];
    const [u, v] = line[k + 1];
    return Array.from({ length: FILLED }, (_, i) => [x + (i / FILLED) * (u - x), y + (i / FILLED) * (v - y)]);
  });

// places on the control of points {x, y} of its disk
export const placesOf = (surface, { x, y }) => Array.from(x, (u, k) => surface.locate(u, y[k]));
const inSpace = (surface, points) =>
  surface
    ? placesOf(surface, points).map((place) => surface.at(place))
    : Array.from(points.x, (u, k) => [100 * u, 100 * points.y[k], 0]);

// the course of a curve on one side: through its landmarks where it has no other, or one of them was moved
function courseOf(problem, side, moves, label) {
  const own = problem.curve.flatMap((one, m) => (one === label ? [m] : []));
  const given = problem.lines && !own.some((m) => m in moves);
  return given ? problem.lines[side][label] : own.map((m) => problem[side][m]);
}

// curves: [{label, name, held, before, registered, target: {x, y}, off: after the map, was: after the best Möbius map}], and
// the means over landmarks of those fitted, over curves of those held out: {fitted, held, fittedWas, heldWas}
export function carried(state, mesh, w) {
  const problem = problemOf(state),
    surface = surfaceOf(state),
    fine = meshOf(...mesh),
    after = (points) =>
      sample(
        w,
        points.map(([x, y]) => fine.locate(x, y)),
      ),
    fitted = problem.curve.map((label) => !state.held.includes(label)),
    some = (points) => fromPairs(points.filter((_, m) => fitted[m])),
    best = bestMobius(some(problem.moving), some(problem.target)),
    before = (points) => moved(fromPairs(points), best);
  const ends = inSpace(surface, fromPairs(problem.target)),
    off = (points) => inSpace(surface, points).map((point, m) => distance(point, ends[m])),
    [offs, were] = [after, before].map((go) => off(go(problem.moving)));
  const curves = labelsOf(problem).map((label) => {
    const held = state.held.includes(label),
      start = courseOf(problem, "moving", state.starts, label),
      target = courseOf(problem, "target", state.targets, label),
      there = inSpace(surface, fromPairs(filled(target))),
      // points to their targets, as landmarks are fitted; held out, curve to curve
      error = (go, list) =>
        held ? apart(inSpace(surface, go(filled(start))), there) : mean(list.filter((_, m) => problem.curve[m] === label));
    const lines = { before: before(start), registered: after(start), target: fromPairs(target) };
    return { label, name: nameOf(problem, label), held, ...lines, off: error(after, offs), was: error(before, were) };
  });
  const [out, own] = [(_, m) => fitted[m], curves.filter(({ held }) => held)];
  return {
    curves,
    fitted: mean(offs.filter(out)),
    fittedWas: mean(were.filter(out)),
    held: own.length ? mean(own.map((one) => one.off)) : null,
    heldWas: own.length ? mean(own.map((one) => one.was)) : null,
  };
}
