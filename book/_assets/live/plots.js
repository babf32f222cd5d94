// Pictures of a map: the deformed grid, |mu| as colours and as a histogram, and a curve on axes.
import { sample } from "./mesh.js";
import { COLOURS } from "./picture.js";

const SIZE = 320,
  MARGIN = 10,
  LINES = 15,
  POINTS = 61,
  BINS = 40;
const places = new WeakMap(); // mesh -> {key, places} of the grid's points: looked for once a problem

// a square grid, in the coordinates of the picture
function squareLines() {
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
export function grid(picture, mesh, w, to, from, colour = COLOURS.grid, dash = []) {
  const key = from([0.5, 0])[0];
  if (places.get(mesh)?.key !== key) {
    places.set(mesh, { key, list: squareLines().map((line) => line.map((point) => mesh.locate(...from(point)))) });
  }
  const lines = places.get(mesh).list.map((line) => {
    const { x, y } = sample(w, line);
    return Array.from(x, (u, j) => to([u, y[j]]));
  });
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

export function heat(picture, mesh, size, from) {
  const { width } = picture.canvas,
    list = pixels(mesh, width, from),
    image = picture.pen.createImageData(width, width);
  image.data.fill(255);
  for (let i = 0; i < list.length; i++) {
    if (list[i] < 0) continue;
    const value = size[list[i]];
    image.data.set(value < 1 ? SHADES[Math.floor(255 * value)] : FOLD, 4 * i);
  }
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

export function histogram(picture, size) {
  const counts = new Float64Array(BINS),
    { pen } = picture,
    left = 14,
    width = SIZE - 28,
    floor = SIZE - 40;
  for (const value of size) counts[Math.min(BINS - 1, Math.floor(BINS * value))]++;
  const top = Math.max(...counts);
  picture.clear();
  pen.fillStyle = COLOURS.grid;
  counts.forEach((count, k) => {
    const height = (count / top) * (floor - 20);
    pen.fillRect(left + (k * width) / BINS, floor - height, width / BINS - 1, height);
  });
  pen.fillStyle = COLOURS.ink;
  pen.fillRect(left, floor, width, 1);
  for (const tick of [0, 0.25, 0.5, 0.75, 1]) picture.words(String(tick), left + tick * width, floor + 17, "center");
  picture.words("|μ|", left + width / 2, floor + 34, "center");
}

// landmark error (log) against mean |mu|; the present one as a dot
export function curvePicture(picture, sweep, now) {
  const { pen } = picture,
    left = 46,
    floor = SIZE - 40,
    all = [...sweep, { error: now.landmarkError, mean: now.mean }];
  const logs = all.map(({ error }) => Math.log10(Math.max(error, 1e-9)));
  const low = Math.floor(Math.min(...logs)),
    high = Math.max(low + 1, Math.ceil(Math.max(...logs)));
  const widest = 1.15 * Math.max(0.05, ...all.map(({ mean }) => mean));
  const X = (mean) => left + (mean / widest) * (SIZE - left - 12),
    Y = (log) => floor - ((log - low) / (high - low)) * (floor - 16);
  picture.clear();
  pen.fillStyle = COLOURS.ink;
  pen.fillRect(left, floor, SIZE - left - 10, 1);
  pen.fillRect(left, 10, 1, floor - 10);
  for (let tick = low; tick <= high; tick++) picture.words(`1e${tick}`, left - 6, Y(tick) + 4, "right");
  for (const share of [0, 0.4, 0.8])
    picture.words(share ? (share * widest).toPrecision(2) : "0", X(share * widest), floor + 16, "center");
  picture.words("mean |μ|", (SIZE + left) / 2, floor + 34, "center");
  pen.beginPath();
  sweep.forEach(({ error, mean }, k) => pen[k ? "lineTo" : "moveTo"](X(mean), Y(Math.log10(Math.max(error, 1e-9)))));
  picture.stroke(COLOURS.grid, 1.5);
  pen.fillStyle = COLOURS.registered;
  pen.beginPath();
  pen.arc(X(now.mean), Y(logs[logs.length - 1]), 5, 0, 7);
  pen.fill();
  picture.stroke("black", 1);
}
