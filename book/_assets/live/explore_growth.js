// A growing cortex: scrub through its frames, look from all sides, and compare its area with a free sheet's.
import { readArrays } from "./files.js";
import { INITIAL } from "./given.js";
import { COLOURS } from "./picture.js";
import { chart } from "./plots.js";
import { Solid, turned } from "./solid.js";
import { edgesOf, normalsOf } from "./triangles.js";
import { gap, short, three } from "./words.js";

const FRAMES = 20,
  FURTHER = 5, // frames, in the question
  LATERAL = [-1, 0, 0]; // of a left hemisphere
let film = null; // once it has been loaded

const last = (state) => Math.min(state.frame, film.K - 1);
const spread = (list) => Math.sqrt(list.reduce((sum, c) => sum + c * c, 0) / list.length);
const mix = (share, from, to) => from.map((c, i) => c + Math.max(0, Math.min(1, share)) * (to[i] - c));

// {positions (K V 3), faces (3 F), V, K, factors, crossing, edges, first} from the page's file
function readFrames(file) {
  const { config, tensors } = readArrays(file),
    [K, V] = tensors.positions.shape,
    faces = Uint16Array.from(tensors.faces.data);
  const film = { ...config, positions: tensors.positions.data, K, V, faces, edges: edgesOf(faces, V) };
  film.first = measured(film, 0);
  return film;
}

const frame = ({ positions, V }, k) => positions.subarray(3 * V * k, 3 * V * (k + 1));

// positions x, area, unit normals (3 V), curvature (V), areas around vertices (V)
function measured(film, k) {
  const x = frame(film, k),
    { normals, areas } = normalsOf(x, film.faces),
    share = new Float64Array(film.V);
  film.faces.forEach((v, i) => {
    share[v] += areas[Math.floor(i / 3)] / 3;
  });
  const area = areas.reduce((a, b) => a + b, 0);
  return { x, area, share, curvature: curvatureOf(film, x, normals) };
}

// how far a vertex stands out of the mean of its neighbours, in edge lengths: positive on gyri
function curvatureOf({ edges: { tail, head }, V }, x, normal) {
  const out = new Float64Array(V),
    count = new Float64Array(V);
  let length = 0;
  for (let e = 0; e < tail.length; e++) {
    const a = 3 * tail[e],
      b = 3 * head[e],
      d = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]];
    length += Math.hypot(...d);
    for (let i = 0; i < 3; i++) {
      out[a / 3] -= d[i] * normal[a + i];
      out[b / 3] += d[i] * normal[b + i];
    }
    count[a / 3]++;
    count[b / 3]++;
  }
  return out.map((c, v) => c / count[v] / (length / tail.length));
}

// ---- what is to be seen ----

// colour of a vertex: light where the surface is convex; dark where it has grown more than on average
const SHADES = {
  curvature: ({ curvature }) => (v) => mix(0.5 + 1.2 * curvature[v], [70, 70, 78], [250, 244, 230]),
  stretch: ({ share, area }) => (v) =>
    mix(1 - 0.8 * Math.log2(((share[v] / film.first.share[v]) * film.first.area) / area) - 0.5, [8, 60, 120], [255, 250, 205]),
  plain: () => () => [222, 205, 190],
};

async function answer(state, host) {
  film ??= readFrames(await host.file("growth.bin"));
  film.areas ??= Array.from({ length: film.K }, (_, k) => measured(film, k).area / film.first.area);
  const k = last(state),
    found = measured(film, k);
  return { ...found, factor: film.factors[k], crossing: film.crossing[k], ratio: film.areas[k] };
}

function drawAreas(picture, k) {
  const line = (values) => values.map((value, i) => [i, value]),
    wanted = line(film.factors.map((factor) => factor ** 2)),
    areas = line(film.areas),
    top = Math.ceil(2 * Math.max(...wanted.map(([, value]) => value))) / 2;
  chart(picture, {
    x: [0, film.K - 1],
    y: [0.5, top],
    ticks: {
      x: [0, film.K - 1].map((i) => [i, String(i)]),
      y: Array.from({ length: Math.floor(top) }, (_, i) => [i + 1, String(i + 1)]),
    },
    name: "frame",
    curves: [
      { points: wanted, colour: COLOURS.target, dash: [5, 3], dot: wanted[k] },
      { points: areas, colour: COLOURS.grid, dot: areas[k] },
    ],
  });
}

export default {
  name: "growth",
  label: "A growing cortex",
  initial: INITIAL.growth,
  controls: [
    { kind: "linear", name: "frame", label: "frame (0: before growth)", min: 0, max: FRAMES - 1, step: 1 },
    { kind: "linear", name: "turn", rare: true, label: "turn in degrees (0: from outside)", min: -180, max: 180, step: 5 },
    { kind: "linear", name: "tilt", rare: true, label: "tilt in degrees (90: from above)", min: -90, max: 90, step: 5 },
    {
      kind: "choice",
      name: "colour",
      label: "colour",
      options: [
        ["curvature", "curvature: light is convex"],
        ["stretch", "stretch: blue has grown more than the rest"],
        ["plain", "none"],
      ],
    },
  ],
  views: [
    { name: "surface", label: "the surface, to turn by pointing or by arrow keys", picture: Solid, drag: turned },
    { name: "areas", label: "factors since the first frame: area (blue), area of a free sheet (red, dashed)" },
  ],
  answer,
  draw([surface, areas], state, found) {
    const shade = SHADES[state.colour](found),
      colour = new Float32Array(found.x.length);
    for (let v = 0; v < film.V; v++) colour.set(shade(v).map((c) => c / 255), 3 * v);
    const shown = { vertices: found.x, unfolded: found.x, faces: film.faces, colour, away: LATERAL };
    surface.surface(shown, frame(film, film.K - 1));
    surface.draw({ ...state, zoom: 1, share: 0 });
    drawAreas(areas, last(state));
  },
  words(state, { area, factor, crossing, curvature }) {
    const said = [
      `Frame ${last(state)} of ${film.K - 1}: the edges' rest lengths are ${three(factor)} times those at first`,
      `The area is ${short(area / 100)} cm²`,
      `Curvature times an edge is ${three(spread(curvature))} in the mean square, ` +
        `${three(spread(film.first.curvature))} at first`,
      `${crossing} of ${film.faces.length / 3} triangles cross others`,
      `The view is turned by ${state.turn}° and tilted by ${state.tilt}°`,
    ];
    return `${said.join(". ")}.`;
  },
  data: (state, { area, ratio, factor, crossing }) => ({ area: ratio, square: area, factor, crossing }),
  compare: (found, kernel) =>
    `The kernel's area has grown by the factor ${short(kernel.area)}; ` +
    `the difference is ${gap(Math.abs(kernel.area - found.ratio))}.`,
  question: {
    text: `Go ${FURTHER} frames further. How many times its present area has the surface then? `,
    async truth(state, host) {
      const now = await answer(state, host);
      return (await answer({ ...state, frame: last(state) + FURTHER }, host)).ratio / now.ratio;
    },
    why:
      "The sheet stays compressed: it folds to make room, and its edges remain shorter than their rest lengths, " +
      "which grow less along furrows.",
  },
};
