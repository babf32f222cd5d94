// Pictures of a map: the deformed grid, |mu| as colours, and a curve on axes.
import { toPairs } from "./complex.js";
import { sample } from "./mesh.js";
import { COLOURS } from "./picture.js";
import { ten } from "./words.js";

const SIZE = 320,
  MARGIN = 10,
  LINES = 15,
  POINTS = 61;
const places = new WeakMap(); // mesh -> {key, places} of the grid's points: looked for once a problem

// a square grid, in the coordinates of the picture
export function squareLines() {
  const lines = [];
  for (let k = 0; k < LINES; k++) {
    const c = (2 * (k + 0.5)) / LINES - 1,
      most = Math.sqrt(1 - c * c);
    const line = Array.from({ length: POINTS }, (_, j) => [c, ((2 * j) / (POINTS - 1) - 1) * most]);
    lines.push(
      line,
      line.map(([x, y]) => [y, x]),
    );
  }
  return lines;
}

// to: from the disk to the picture, from: back; the same for all but the cortex
const same = (point) => point;
export function grid(picture, mesh, w, { to = same, from = same, colour = COLOURS.grid, dash = [] } = {}) {
  const key = from([0.5, 0])[0];
  if (places.get(mesh)?.key !== key) {
    places.set(mesh, { key, list: squareLines().map((line) => line.map((point) => mesh.locate(...from(point)))) });
  }
  const lines = places.get(mesh).list.map((line) => toPairs(sample(w, line)).map(to));
  picture.lines(lines, colour, 0.8, dash);
}

// light where there is little to see, as YlGnBu is; the hues differ in lightness for every kind of eye
const STOPS = [
  [255, 255, 217],
  [199, 233, 180],
  [65, 182, 196],
  [34, 94, 168],
  [8, 29, 88],
];
const SHADES = Array.from({ length: 256 }, (_, i) => {
  const at = (i / 255) * (STOPS.length - 1),
    k = Math.min(Math.floor(at), STOPS.length - 2);
  return STOPS[k].map((c, n) => Math.round(c + (at - k) * (STOPS[k + 1][n] - c)));
});
export const shadeOf = (share) => SHADES[Math.floor(255 * Math.min(1, Math.max(0, share)))];
const FOLD = [208, 0, 208];
const faceOf = new WeakMap(); // mesh -> {key, list}: the triangle below each pixel

function pixels(mesh, size, from) {
  const key = `${size} ${from([0.5, 0])[0]}`;
  if (faceOf.get(mesh)?.key !== key) {
    const list = new Int32Array(size * size).fill(-1),
      radius = size / 2 - (MARGIN * size) / SIZE;
    for (let i = 0; i < size * size; i++) {
      const x = ((i % size) + 0.5 - size / 2) / radius,
        y = (size / 2 - Math.floor(i / size) - 0.5) / radius;
      if (x * x + y * y < 1) list[i] = mesh.locate(...from([x, y])).face;
    }
    faceOf.set(mesh, { key, list });
  }
  return faceOf.get(mesh).list;
}

export function heat(picture, mesh, size, from = same) {
  const { width } = picture.canvas,
    list = pixels(mesh, width, from),
    image = picture.pen.createImageData(width, width);
  image.data.fill(255);
  for (let i = 0; i < list.length; i++) {
    if (list[i] < 0) continue;
    const value = size[list[i]];
    image.data.set(value < 1 ? shadeOf(value) : FOLD, 4 * i);
  }
  picture.canvas.classList.add("qc-live-heat"); // live.css
  picture.pen.putImageData(image, 0, 0);
  picture.circle();
  const { pen } = picture;
  for (let k = 0; k < 100; k++) {
    pen.fillStyle = `rgb(${SHADES[Math.floor(2.55 * k)].join()})`;
    pen.fillRect(8 + 0.6 * k, SIZE - 14, 0.7, 8);
  }
  picture.words("0", 8, SIZE - 18);
  picture.words("1", 68, SIZE - 18, "right");
}

// Curves on axes. x, y: [low, high], beyond which nothing is drawn; ticks: {x, y}, of [place, words]; curves:
// {points: [[x, y], ...], colour, dash, width, dot: a place or none}
export function chart(picture, { x: [x0, x1], y: [y0, y1], ticks, name, curves }) {
  const { pen } = picture,
    left = 46,
    floor = SIZE - 40;
  const share = (x, low, high) => Math.min(1, Math.max(0, (x - low) / (high - low))),
    X = (x) => left + share(x, x0, x1) * (SIZE - left - 14),
    Y = (y) => floor - share(y, y0, y1) * (floor - 16);
  picture.clear();
  pen.fillStyle = COLOURS.ink;
  pen.fillRect(left, floor, SIZE - left - 10, 1);
  pen.fillRect(left, 10, 1, floor - 10);
  for (const [x, words] of ticks.x) picture.words(words, X(x), floor + 16, "center");
  for (const [y, words] of ticks.y) picture.words(words, left - 6, Y(y) + 4, "right");
  picture.words(name, (SIZE + left) / 2, floor + 34, "center");
  for (const { points, colour, dash = [], width = 1.8, dot } of curves) {
    pen.beginPath();
    points.forEach(([x, y], k) => pen[k ? "lineTo" : "moveTo"](X(x), Y(y)));
    picture.stroke(colour, width, dash);
    if (!dot) continue;
    pen.beginPath();
    pen.arc(X(dot[0]), Y(dot[1]), 4, 0, 7);
    pen.fillStyle = colour;
    pen.fill();
  }
}

// ticks at the powers of ten from 10^low to 10^high, for logarithms
export const powers = (low, high) => Array.from({ length: high - low + 1 }, (_, k) => [low + k, ten(low + k)]);
