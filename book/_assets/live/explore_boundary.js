// The free boundary: harmonic measure seen from a pole, and what descents of two losses make of the right map.
import { ask } from "./ask.js";
import { SIZE, STEPS } from "./boundary.js";
import { PolarMesh } from "./mesh.js";
import { COLOURS } from "./picture.js";
import { grid } from "./plots.js";

const same = (point) => point,
  FAIR = 0.2; // width of the band where harmonic measure is that of the arc length
const WIDTH = 320,
  LEFT = 46,
  FLOOR = 280; // of the picture of losses, in pixels
const LOWEST = 1e-4; // share of a loss at the start below which it is not drawn
const COLLAPSED = 0.05; // mean distance from 1, as in the text
const NAMES = { printed: "the printed loss", penalised: "the printed loss with ρ L_Boundary", right: "energy minus area" };
let mesh = null; // for the pictures

const answer = (state, host) => ask(host, "boundary", state);
const short = (x) => (x !== 0 && Math.abs(x) < 0.001 ? x.toExponential(2) : String(Number(x.toPrecision(4))));
const turn = (k) => (2 * Math.PI * k) / SIZE[1];

// the band's inner edge at the middle of each boundary edge
const inner = (measure) =>
  Array.from(measure, (step, k) => {
    const r = Math.max(0.02, 1 - (FAIR * step) / turn(1));
    return [r * Math.cos(turn(k + 0.5)), r * Math.sin(turn(k + 0.5))];
  });

// harmonic measure of the half circle that is nearest to the pole
function nearHalf({ measure }, [x, y]) {
  const angle = Math.atan2(y, x);
  return measure.reduce((sum, step, k) => sum + (Math.cos(turn(k + 0.5) - angle) > 0 ? step : 0), 0) / (2 * Math.PI);
}

function drawLosses(picture, values, step) {
  const { pen } = picture,
    end = Math.max(10, values.length - 1),
    X = (k) => LEFT + (k / end) * (WIDTH - LEFT - 14),
    shares = [0, 1].map((i) => values.map((row) => Math.max(LOWEST, row[i] / values[0][i]))),
    top = Math.ceil(Math.log10(Math.max(1, ...shares.flat())) + 0.1),
    low = Math.log10(LOWEST),
    Y = (share) => FLOOR - ((Math.log10(share) - low) / (top - low)) * (FLOOR - 16);
  picture.clear();
  pen.fillStyle = COLOURS.ink;
  pen.fillRect(LEFT, FLOOR, WIDTH - LEFT - 10, 1);
  pen.fillRect(LEFT, 10, 1, FLOOR - 10);
  for (let tick = low; tick <= top; tick++) picture.words(`1e${tick}`, LEFT - 6, Y(10 ** tick) + 4, "right");
  for (const k of [0, Math.round(end / 2), end]) picture.words(String(k), X(k), FLOOR + 16, "center");
  picture.words("step", (WIDTH + LEFT) / 2, FLOOR + 32, "center");
  [COLOURS.target, COLOURS.grid].forEach((colour, i) => {
    pen.beginPath();
    shares[i].forEach((share, k) => pen[k ? "lineTo" : "moveTo"](X(k), Y(share)));
    picture.stroke(colour, 1.8, i ? [5, 3] : []);
    const k = Math.min(step, values.length - 1);
    pen.beginPath();
    pen.arc(X(k), Y(shares[i][k]), 4, 0, 7);
    pen.fillStyle = colour;
    pen.fill();
  });
}

function draw([seen, image, losses], state, { w, centred, measure, values }) {
  mesh ??= new PolarMesh(...SIZE);
  const circle = Array.from({ length: SIZE[1] + 1 }, (_, k) => [Math.cos(turn(k)), Math.sin(turn(k))]),
    band = inner(measure);
  seen.clear();
  seen.face([...circle, ...band, band[0]].reverse(), COLOURS.registered);
  seen.face([...band], "white");
  seen.circle();
  seen.dot(state.pole, COLOURS.target, 5);
  seen.mark();
  const shown = state.centred ? centred : w;
  image.clear();
  image.circle();
  grid(image, mesh, shown, same, same);
  for (let v = mesh.free; v < mesh.V; v++) image.dot([shown.x[v], shown.y[v]], COLOURS.registered, 2.5);
  image.dot([1, 0], COLOURS.ink, 3.5);
  drawLosses(losses, values, state.step);
}

export default {
  name: "boundary",
  label: "Harmonic measure and two losses",
  initial: { strength: 0.5, pole: [0.5, 0.6], loss: "printed", step: 0, centred: false },
  controls: [
    { kind: "linear", name: "strength", label: "strength of μ (0: the disk as it is)", min: 0, max: 0.9, step: 0.05 },
    { kind: "choice", name: "loss", label: "loss that descends", options: Object.entries(NAMES) },
    { kind: "linear", name: "step", label: "steps of the descent", min: 0, max: STEPS, step: 1 },
    { kind: "switch", name: "centred", label: "show the map with f(0) = 0 restored" },
  ],
  views: [
    {
      name: "measure",
      label: "the pole to drag (red); width of the band: harmonic measure",
      points: (state) => [state.pole],
      drag: (state, index, point) => ({ pole: point.map((c) => Number(c.toFixed(4))) }),
    },
    { name: "image", label: "grid and boundary points (orange) under the map at this step" },
    { name: "losses", label: "shares of the start that are left: printed (red), energy minus area (blue, dashed)" },
  ],
  answer,
  draw,
  words(state, found) {
    const { measure, values, off, spread, folds, w } = found,
      [x, y] = state.pole,
      fair = turn(1),
      step = Math.min(state.step, values.length - 1),
      ended = state.step > step ? `, where it ended` : "";
    const [least, most] = [Math.min(...measure), Math.max(...measure)].map((one) => short(one / fair)),
      near = short(100 * nearHalf(found, state.pole)),
      centre = short(Math.hypot(w.x[0], w.y[0])),
      [printed, energy] = [0, 1].map((k) => `${short(values[step][k])} (${short(values[0][k])} at the start)`);
    const said = [
      `Seen from ${short(x)} ${y < 0 ? "−" : "+"} ${short(Math.abs(y))} i the boundary steps are ` +
        `${least} to ${most} times the mean; ` +
        `the half circle nearest to the pole gets ${near} %`,
      `Step ${step} of a descent of ${NAMES[state.loss]}${ended}: printed loss ${printed}, energy minus area ${energy}`,
      spread < COLLAPSED
        ? `The disk has collapsed: on average ${short(spread)} from the point 1`
        : `With f(0) = 0 restored the map is up to ${short(off)} from the right one; as it is |f(0)| is ${centre}`,
    ];
    return `${said.join(". ")}. ${folds} folds. On this mesh of ${SIZE.slice(0, 2).join(" x ")}, in ${found.ms.toFixed(0)} ms.`;
  },
  data(state, { w, centred, measure, values, off, spread, folds }) {
    const shown = state.centred ? centred : w;
    const map = new Float64Array(2 * shown.x.length).map((_, i) => (i % 2 ? shown.y : shown.x)[i >> 1]);
    return { map, measure, off, spread, folds, losses: values[Math.min(state.step, values.length - 1)] };
  },
  compare({ w, centred, values }, kernel) {
    const gap = ({ x, y }) => Math.max(...x.map((u, v) => Math.hypot(u - kernel.map[v][0], y[v] - kernel.map[v][1])));
    const gaps = [w, centred].map(gap);
    const said = `The kernel's descent has ${kernel.count} steps, here there are ${values.length - 1}`;
    return `${said}; the largest difference of the two maps is ${Math.min(...gaps).toExponential(1)}.`;
  },
  question: {
    text:
      "Bring the pole half the way to the centre. Of 100 particles that diffuse from it, how many first meet the circle " +
      "on the half that is nearest to it? ",
    async truth(state, host) {
      const pole = state.pole.map((c) => c / 2);
      return 100 * nearHalf(await answer({ ...state, pole, step: 0 }, host), pole);
    },
    why: "For μ = 0 the density is the Poisson kernel (1 − |a|²) / |eⁱˢ − a|²; μ bends it.",
  },
};
