// Möbius maps of the disk: drag the pole, turn; circles stay circles and angles stay angles.
import { INITIAL } from "./given.js";
import { mobius, mobiusSlope } from "./mobius.js";
import { COLOURS } from "./picture.js";
import { squareLines } from "./plots.js";
import { gap, short } from "./words.js";

const POINTS = 181,
  SMALL = { centre: [0.5, 0], radius: 0.2 };

const circle = ([x, y], radius) =>
  Array.from({ length: POINTS }, (_, k) => [
    x + radius * Math.cos((2 * Math.PI * k) / (POINTS - 1)),
    y + radius * Math.sin((2 * Math.PI * k) / (POINTS - 1)),
  ]);

// what is carried along: name -> lines of the disk
const FIGURES = {
  polar: () => [
    ...[0.2, 0.4, 0.6, 0.8, 1].map((r) => circle([0, 0], r)),
    ...Array.from({ length: 24 }, (_, k) =>
      Array.from({ length: 31 }, (_, j) => [
        (j / 30) * Math.cos((Math.PI * k) / 12),
        (j / 30) * Math.sin((Math.PI * k) / 12),
      ]),
    ),
  ],
  square: squareLines,
  circles: () =>
    [circle([0, 0], 0), circle([0, 0], 0.6)].flatMap((ring) =>
      [0, 60, 120].flatMap((k) => [0.1, 0.2, 0.3].map((r) => circle(ring[k], r))),
    ),
};

const parameters = ({ size, direction, turn }) => {
  const angle = (direction * Math.PI) / 180;
  return [size * Math.cos(angle), size * Math.sin(angle), (turn * Math.PI) / 180];
};

// centre and radius of the circle through three points
function through([ax, ay], [bx, by], [cx, cy]) {
  const ux = bx - ax,
    uy = by - ay,
    vx = cx - ax,
    vy = cy - ay,
    d = 2 * (ux * vy - uy * vx),
    p = ux * ux + uy * uy,
    q = vx * vx + vy * vy;
  const x = (vy * p - uy * q) / d,
    y = (ux * q - vx * p) / d;
  return { centre: [ax + x, ay + y], radius: Math.hypot(x, y) };
}

function answer(state) {
  const [ax, ay, theta] = parameters(state),
    c = Math.cos(theta),
    s = Math.sin(theta);
  const map = ([x, y]) => mobius(x, y, ax, ay, c, s),
    source = FIGURES[state.figure](),
    small = circle(SMALL.centre, SMALL.radius);
  const image = small.map(map),
    round = through(image[0], image[60], image[120]);
  const off = Math.max(
    ...image.map(([x, y]) => Math.abs(Math.hypot(x - round.centre[0], y - round.centre[1]) / round.radius - 1)),
  );
  const [stretchX, stretchY] = mobiusSlope(0, 0, ax, ay, c, s);
  return {
    a: [ax, ay],
    theta,
    source,
    small,
    lines: source.map((line) => line.map(map)),
    image,
    ...round,
    off,
    origin: map([0, 0]),
    stretch: Math.hypot(stretchX, stretchY),
    largest: (1 + state.size) / (1 - state.size),
  };
}

export default {
  name: "mobius",
  label: "Möbius maps of the disk",
  initial: INITIAL.mobius,
  controls: [
    { kind: "linear", name: "size", label: "|a|, distance of the pole from the centre", min: 0, max: 0.95, step: 0.01 },
    {
      kind: "linear",
      name: "direction",
      label: "arg a, direction of the pole in degrees",
      min: -180,
      max: 180,
      step: 1,
    },
    { kind: "linear", name: "turn", label: "θ, turn of the disk in degrees", min: -180, max: 180, step: 1 },
    {
      kind: "choice",
      name: "figure",
      label: "figure",
      options: [
        ["polar", "polar grid"],
        ["square", "square grid"],
        ["circles", "circles"],
      ],
    },
  ],
  views: [
    {
      name: "before",
      label: "the disk, and the pole a to drag",
      points: (state) => [parameters(state).slice(0, 2)],
      drag: (state, index, [x, y]) => ({
        size: Math.min(0.95, Number(Math.hypot(x, y).toFixed(4))),
        direction: Number(((Math.atan2(y, x) * 180) / Math.PI).toFixed(2)),
      }),
    },
    { name: "after", label: "its image: a has come to 0" },
  ],
  answer,
  draw([before, after], state, found) {
    for (const [picture, lines, small, pole] of [
      [before, found.source, found.small, found.a],
      [after, found.lines, found.image, [0, 0]],
    ]) {
      picture.disk();
      picture.lines(lines, COLOURS.grid);
      picture.lines([small], COLOURS.target, 2);
      picture.dot(pole, COLOURS.registered, 5);
    }
    before.mark();
  },
  words(state, { a: [ax, ay], radius, off, stretch, largest }) {
    const pole = `a = ${short(ax)} ${ay < 0 ? "−" : "+"} ${short(Math.abs(ay))} i, θ = ${short(state.turn)}°`;
    const red = `The red circle of radius ${SMALL.radius} has become a circle of radius ${short(radius)}`;
    const lengths = `Lengths change by ${short(stretch)} at 0, by up to ${short(largest)} on the circle`;
    const round = off < 1e-9 ? ", round up to rounding errors" : "";
    return `${pole}. ${red}${round}. ${lengths}. Angles do not change: no folds, μ = 0.`;
  },
  data: (state, { a, theta, centre, radius, stretch, largest }) => ({ a, theta, centre, radius, stretch, largest }),
  compare(found, kernel) {
    const difference = gap(Math.abs(kernel.radius - found.radius));
    return `The kernel's red circle has radius ${short(kernel.radius)}; the difference is ${difference}.`;
  },
  question: {
    text: "Bring the pole to the opposite place, −a. What radius has the red circle's image then? ",
    truth: (state) => answer({ ...state, direction: state.direction + 180 }).radius,
    why: "Small circles grow where the pole comes from and shrink on the other side, and all stay circles.",
  },
};
