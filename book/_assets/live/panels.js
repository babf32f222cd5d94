// The tuner's pictures: the curves of a problem on the brain and in the disk, with a field as colours, and the trade-off.
import { placesOf } from "./carried.js";
import { toPairs } from "./complex.js";
import { meshOf, sample } from "./mesh.js";
import { COLOURS } from "./picture.js";
import { chart, grid } from "./plots.js";
import { fromPicture, toPicture } from "./radius.js";
import { coloursOf, fieldOf, imageOf, legend, raster, scaleOf } from "./shade.js";
import { off } from "./words.js";

export const HELD = "#0072B2";
const RADIUS = 0.9; // of a tube, mm
const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
const kindsOf = ({ before }) => [...(before ? ["before"] : []), "target", "registered"];
const colourOf = (kind, held) =>
  kind === "before" ? COLOURS.moving : kind === "target" ? COLOURS.target : held ? HELD : COLOURS.registered;
const wordsOf =
  ({ surface, curves }) =>
  (label) => {
    const { name, off: far, was, held } = curves.find((one) => one.label === label),
      unit = surface ? "mm" : "%";
    return `${name}${held ? ", held out" : ""}: ${off(far)} ${unit} off (${off(was)} by the Möbius map)`;
  };

// one side after the other, each in its part of the width, to one scale
export function drawMaps(brain, disk, state, sides) {
  const kind = state.shade === "none" ? null : state.shade,
    fields = sides.map((side) => kind && fieldOf(kind, side, side.problem, side.surface)),
    scale = kind && scaleOf(kind, ...fields);
  brain.element.hidden = !sides.at(-1).surface;
  sides.forEach((side, k) => {
    const [from, to] = sides.length < 2 ? [0, 1] : [k * state.wipe, k ? 1 : state.wipe],
      pixels = kind && raster(side, fields[k], side.problem.radius);
    disk.part(from, to);
    drawDisk(disk, state, side, pixels && imageOf(kind, pixels, scale));
    if (!side.surface) return;
    brain.part(from, to);
    drawBrain(brain, state, side, kind, pixels, scale);
  });
  disk.part(0, 1);
  if (kind) legend(disk, kind, scale);
  if (sides.length > 1) {
    const x = 2.14 * state.wipe - 1.07;
    disk.lines(
      [
        [
          [x, -1.07],
          [x, 1.07],
        ],
      ],
      COLOURS.ink,
      1.5,
    );
    disk.words("A", 8, 20);
    disk.words("B", 312, 20, "right");
  }
  disk.mark();
}

function drawDisk(disk, state, side, image) {
  const { curves, problem, shown, mesh } = side,
    to = toPicture(problem.radius),
    drawn = ({ x, y }) => toPairs({ x, y }).map(to);
  disk.disk();
  if (image) disk.raster(image, (point) => point);
  grid(disk, meshOf(...mesh), shown.w, { to, from: fromPicture(problem.radius), colour: "#1F4E7960" });
  for (const kind of kindsOf(state)) {
    for (const curve of curves) {
      disk.lines(
        [drawn(curve[kind])],
        colourOf(kind, curve.held),
        kind === "target" ? 1.6 : 2,
        kind === "target" ? [4, 3] : [],
      );
    }
  }
  const held = (m) => state.held.includes(problem.curve[m]);
  problem.target.forEach((point, m) => !held(m) && disk.square(to(point), COLOURS.target, 3, 1.2));
  toPairs(shown.points).forEach((point) => disk.dot(to(point), COLOURS.registered, 2));
  const words = wordsOf(side);
  disk.name(
    curves.flatMap(({ label, registered, target }) =>
      [registered, target].map((line) => ({ label, words: words(label), line: dense(drawn(line)) })),
    ),
  );
  disk.circle();
}

// points so near each other that a pointer finds the line between them
const dense = (line) =>
  line.flatMap(([x, y], k) =>
    k
      ? [
          [(x + line[k - 1][0]) / 2, (y + line[k - 1][1]) / 2],
          [x, y],
        ]
      : [[x, y]],
  );

function drawBrain(brain, state, side, kind, pixels, scale) {
  const { surface, curves } = side;
  if (brain.shown !== surface) brain.surface({ ...surface, colour: coloursOf(surface, kind, pixels, scale) });
  else brain.recolour(coloursOf(surface, kind, pixels, scale));
  brain.shown = surface;
  const kinds = kindsOf(state),
    tubes = kinds.flatMap((one, k) =>
      curves.map((curve) => ({
        ...curve,
        ...tubeOf(brain, surface, curve[one], state.unfold, k),
        colour: rgb(colourOf(one, curve.held)),
      })),
    );
  brain.tubes(tubes);
  brain.draw({ ...state, share: state.unfold });
  const words = wordsOf(side);
  brain.name(tubes.map(({ label, points, ways }) => ({ label, words: words(label), points, ways })));
}

// a tube along a line of the disk on the surface as it is unfolded so far, a little off it so that it is seen
function tubeOf(solid, surface, line, unfold, layer) {
  const { normal, unfoldedNormal } = solid.normals,
    places = placesOf(surface, line),
    mixed = (place, from, to) => {
      const [a, b] = [surface.at(place, from), surface.at(place, to)];
      return a.map((c, k) => c + unfold * (b[k] - c));
    };
  const ways = places.map((place) => mixed(place, normal, unfoldedNormal)),
    centres = places.map((place) => mixed(place, surface.vertices, surface.unfolded));
  return {
    points: centres.map((point, i) => point.map((c, n) => c + (0.6 + 0.25 * layer) * RADIUS * ways[i][n])),
    ways,
    radius: RADIUS,
  };
}

// ---- the trade-off, on axes that stay, or are longer where a problem's maps need it ----

const moves = []; // [mean |mu|, log10 of the error] of the maps that were shown of one problem
let movesOf = null;

export function drawChart(picture, { state, asked, shown, surface, fitted, held, coarse }, sweep) {
  const log = (error) => Math.log10(Math.max(error, 0.01)),
    place = (error, mean) => [mean, log(error)],
    now = { gamma: asked.gamma, mean: shown.mean, fitted, held },
    key = JSON.stringify([state.problem, state.held, state.mesh, state.landmarks]);
  if (key !== movesOf) [movesOf, moves.length] = [key, 0];
  const here = place(fitted, shown.mean);
  if (!coarse && String(moves.at(-1)) !== String(here)) moves.push(here);
  const along = (name) =>
    [...sweep, now]
      .sort((a, b) => a.gamma - b.gamma)
      .filter((one) => one[name] !== null)
      .map((one) => place(one[name], one.mean));
  const points = [...moves, ...along("fitted"), ...(held === null ? [] : along("held"))],
    wide = !surface || points.some(([mean]) => mean > 0.2),
    high = !surface || points.some(([, height]) => height > 1);
  chart(picture, {
    x: [0, wide ? 0.6 : 0.2],
    y: [-2, high ? 2 : 1],
    ticks: {
      x: (wide ? [0, 0.2, 0.4, 0.6] : [0, 0.05, 0.1, 0.15, 0.2]).map((x) => [x, String(x)]),
      y: [-2, -1, 0, 1, ...(high ? [2] : [])].map((y) => [y, `${y < -1 ? "≤ " : ""}${10 ** y}`]),
    },
    name: `mean |μ|; up: ${surface ? "mm" : "% of the radius"} off`,
    curves: [
      { points: moves, colour: "#999999", width: 1, dash: [2, 2] },
      { points: along("fitted"), colour: COLOURS.registered, dot: here },
      ...(held === null ? [] : [{ points: along("held"), colour: HELD, dot: place(held, shown.mean) }]),
    ],
  });
}

export function drawMoving(picture, { problem, curves }) {
  const to = toPicture(problem.radius);
  picture.disk();
  for (const { label } of curves)
    picture.lines([problem.moving.filter((_, m) => problem.curve[m] === label).map(to)], COLOURS.moving, 1);
  problem.moving.forEach((point) => picture.dot(to(point), COLOURS.moving, 3));
  picture.mark();
}
