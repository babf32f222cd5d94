// A growing cortex: scrub through its frames, look from all sides, and compare its area with what its edges want.
import { measured, paint, readFrames } from "./growth.js";
import { COLOURS } from "./picture.js";

const FRAMES = 20,
  FURTHER = 5, // frames, in the question
  WIDTH = 320,
  LEFT = 40,
  FLOOR = 280; // of the picture of areas, in pixels
let film = null; // once it has been loaded

const short = (x) => String(Number(x.toPrecision(4)));
const last = (state) => Math.min(state.frame, film.K - 1);
const spread = (list) => Math.sqrt(list.reduce((sum, c) => sum + c * c, 0) / list.length);
const mix = (share, from, to) => from.map((c, i) => c + Math.max(0, Math.min(1, share)) * (to[i] - c));

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
  const { pen } = picture,
    wanted = film.factors.map((factor) => factor ** 2),
    top = Math.ceil(2 * Math.max(...wanted)) / 2;
  const X = (i) => LEFT + (i / (film.K - 1)) * (WIDTH - LEFT - 16),
    Y = (value) => FLOOR - ((value - 0.5) / (top - 0.5)) * (FLOOR - 16);
  picture.clear();
  pen.fillStyle = COLOURS.ink;
  pen.fillRect(LEFT, FLOOR, WIDTH - LEFT - 10, 1);
  pen.fillRect(LEFT, 10, 1, FLOOR - 10);
  for (let value = 1; value <= top; value++) picture.words(String(value), LEFT - 8, Y(value) + 4, "right");
  for (const i of [0, film.K - 1]) picture.words(String(i), X(i), FLOOR + 16, "center");
  picture.words("frame", (WIDTH + LEFT) / 2, FLOOR + 32, "center");
  for (const [values, colour, dash] of [
    [wanted, COLOURS.target, [5, 3]],
    [film.areas, COLOURS.grid, []],
  ]) {
    pen.beginPath();
    values.forEach((value, i) => pen[i ? "lineTo" : "moveTo"](X(i), Y(value)));
    picture.stroke(colour, 1.8, dash);
    pen.beginPath();
    pen.arc(X(k), Y(values[k]), 4, 0, 7);
    pen.fillStyle = colour;
    pen.fill();
  }
}

export default {
  name: "growth",
  label: "A growing cortex",
  initial: { frame: 0, turn: 0, tilt: 10, colour: "curvature" },
  controls: [
    { kind: "linear", name: "frame", label: "frame (0: before growth)", min: 0, max: FRAMES - 1, step: 1 },
    { kind: "linear", name: "turn", label: "turn in degrees (0: from outside)", min: -180, max: 180, step: 5 },
    { kind: "linear", name: "tilt", label: "tilt in degrees (90: from above)", min: -90, max: 90, step: 5 },
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
    {
      name: "surface",
      label: "the surface, to turn by pointing or by arrow keys",
      anywhere: true,
      points: ({ turn, tilt }) => [[turn / 190, tilt / 190]],
      drag: (state, index, [x, y], by) =>
        by === "press" ? {} : { turn: Math.round(190 * x), tilt: Math.max(-90, Math.min(90, Math.round(190 * y))) },
    },
    { name: "areas", label: "factors since the first frame: area (blue), area that the edges want (red, dashed)" },
  ],
  answer,
  draw([surface, areas], state, found) {
    const { width } = surface.canvas,
      image = surface.pen.createImageData(width, width);
    paint(image, film, found, state, SHADES[state.colour](found));
    surface.pen.putImageData(image, 0, 0);
    drawAreas(areas, last(state));
  },
  words(state, { area, factor, crossing, curvature }) {
    const said = [
      `Frame ${last(state)}, the last is ${film.K - 1}: the edges want ${short(factor)} times their first length`,
      `The area is ${short(area / 100)} cm²`,
      `Curvature times an edge is ${short(spread(curvature))} in the mean square, ` +
        `${short(spread(film.first.curvature))} at first`,
      `${crossing} of ${film.faces.length / 3} triangles cross others`,
      `Seen from ${state.turn}° round and ${state.tilt}° above`,
    ];
    return `${said.join(". ")}.`;
  },
  data: (state, { area, ratio, factor, crossing }) => ({ area: ratio, square: area, factor, crossing }),
  compare: (found, kernel) =>
    `The kernel's area has grown by the factor ${short(kernel.area)}; ` +
    `the difference is ${Math.abs(kernel.area - found.ratio).toExponential(1)}.`,
  question: {
    text: `Go ${FURTHER} frames further. How many times its present area has the surface then? `,
    async truth(state, host) {
      const now = await answer(state, host);
      return (await answer({ ...state, frame: last(state) + FURTHER }, host)).ratio / now.ratio;
    },
    why:
      "The sheet stays compressed: it folds to make room, and its edges remain shorter than they want to be; " +
      "along furrows they want less.",
  },
};
