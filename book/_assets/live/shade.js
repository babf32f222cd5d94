// A field of a map as colours, smooth over vertices and to the data's scale, on the disk that the map goes to and on the surface.
import { FINE } from "./given.js";
import { meshOf, sample } from "./mesh.js";
import { shadeOf } from "./plots.js";
import { toPicture } from "./radius.js";

const PIXELS = 192; // of the field's picture, a side
const [LESS, SAME, MORE] = [
  [33, 102, 172],
  [247, 247, 247],
  [178, 24, 43],
];
const SCALES = { mu: [0.05, 0.1, 0.2, 0.5, 1], areas: [1, 2, 3] };

// values (V) of a map's field: |mu|, or log2 of the factor of area, from surface to surface where there are some
export function fieldOf(kind, { mesh: size, shown }, problem, surface) {
  const mesh = meshOf(...size),
    { w } = shown;
  if (kind === "mu") return mesh.onVertices({ x: shown.size, y: shown.size }).x;
  const [p, q] = mesh.derivatives(w),
    log = p.x.map((x, t) => Math.log2(Math.max(1e-9, x * x + p.y[t] ** 2 - q.x[t] ** 2 - q.y[t] ** 2)));
  const values = mesh.onVertices({ x: log, y: log }).x;
  if (!surface) return values;
  const here = densityAt(mesh, problem);
  return values.map((value, v) => {
    const { corners, weights } = surface.locate(w.x[v], w.y[v]);
    return value + corners.reduce((sum, c, k) => sum + weights[k] * surface.density[c], 0) - here[v];
  });
}

const densities = new WeakMap(); // list of a problem -> {mesh, values}

function densityAt(mesh, { density }) {
  if (densities.get(density)?.mesh !== mesh) {
    const fine = meshOf(...FINE),
      places = Array.from(mesh.z.x, (x, v) => fine.locate(x, mesh.z.y[v]));
    densities.set(density, { mesh, values: sample({ x: density, y: density }, places).x });
  }
  return densities.get(density).values;
}

// the least of the usual scales that all but a hundredth of the values keep within
export function scaleOf(kind, ...fields) {
  const sizes = fields.map((values) => Float64Array.from(values, Math.abs).sort()),
    most = Math.max(...sizes.map((sorted) => sorted[Math.floor(0.99 * (sorted.length - 1))]));
  return SCALES[kind].find((scale) => scale >= most) ?? SCALES[kind].at(-1);
}

// red, green, blue of a value
export function colourOf(kind, value, scale) {
  if (kind === "mu") return shadeOf(value / scale);
  const share = Math.max(-1, Math.min(1, value / scale)),
    end = share < 0 ? LESS : MORE;
  return SAME.map((c, k) => c + Math.abs(share) * (end[k] - c));
}

// values (PIXELS^2) at the pixels of the picture's square, NaN outside; w: the map of the mesh, to: into the picture
export function raster({ mesh: size, shown: { w } }, values, radius) {
  const mesh = meshOf(...size),
    to = toPicture(radius),
    out = new Float32Array(PIXELS * PIXELS).fill(NaN),
    X = new Float64Array(mesh.V),
    Y = new Float64Array(mesh.V);
  for (let v = 0; v < mesh.V; v++) {
    const [x, y] = to([w.x[v], w.y[v]]);
    X[v] = ((x + 1) * PIXELS) / 2 - 0.5;
    Y[v] = ((1 - y) * PIXELS) / 2 - 0.5;
  }
  for (let t = 0; t < mesh.F; t++) {
    const [a, b, c] = mesh.faces.subarray(3 * t, 3 * t + 3),
      [bx, by, cx, cy] = [X[b] - X[a], Y[b] - Y[a], X[c] - X[a], Y[c] - Y[a]],
      twice = bx * cy - by * cx;
    const span = (P) =>
      [Math.min(P[a], P[b], P[c]), Math.max(P[a], P[b], P[c])].map((one, k) => (k ? Math.floor(one) : Math.ceil(one)));
    const [[left, right], [top, bottom]] = [span(X), span(Y)];
    for (let j = Math.max(0, top); j <= Math.min(PIXELS - 1, bottom); j++) {
      for (let i = Math.max(0, left); i <= Math.min(PIXELS - 1, right); i++) {
        const s = ((i - X[a]) * cy - (j - Y[a]) * cx) / twice,
          r = (bx * (j - Y[a]) - by * (i - X[a])) / twice;
        if (s >= -1e-6 && r >= -1e-6 && s + r <= 1 + 1e-6)
          out[j * PIXELS + i] = (1 - s - r) * values[a] + s * values[b] + r * values[c];
      }
    }
  }
  return out;
}

// the raster as a canvas
export function imageOf(kind, pixels, scale) {
  const canvas = Object.assign(document.createElement("canvas"), { width: PIXELS, height: PIXELS }),
    pen = canvas.getContext("2d"),
    image = pen.createImageData(PIXELS, PIXELS);
  pixels.forEach((value, i) => {
    if (!Number.isNaN(value)) image.data.set([...colourOf(kind, value, scale), 255], 4 * i);
  });
  pen.putImageData(image, 0, 0);
  return canvas;
}

// red, green, blue (3 V) of a surface's vertices, 0 to 1: the field's colour there within the fold's shade, or that alone
export function coloursOf(surface, kind, pixels, scale) {
  const out = new Float32Array(3 * surface.V);
  for (let v = 0; v < surface.V; v++) {
    const grey = surface.shade[v] / 255,
      [i, j] = [surface.places[2 * v], -surface.places[2 * v + 1]].map((x) =>
        Math.round(((0.985 * x + 1) * PIXELS) / 2 - 0.5),
      ),
      value = pixels?.[j * PIXELS + i] ?? NaN;
    if (Number.isNaN(value)) out.fill(0.45 + 0.5 * grey, 3 * v, 3 * v + 3);
    else
      out.set(
        colourOf(kind, value, scale).map((c) => ((0.6 + 0.4 * grey) * c) / 255),
        3 * v,
      );
  }
  return out;
}

// the scale in a corner of a picture
export function legend(picture, kind, scale) {
  const { pen } = picture,
    low = kind === "mu" ? 0 : -scale;
  for (let k = 0; k < 66; k++) {
    pen.fillStyle = `rgb(${colourOf(kind, low + ((scale - low) * k) / 65, scale)
      .map(Math.round)
      .join()})`;
    pen.fillRect(8 + k, 306, 1.2, 8);
  }
  const ends = kind === "mu" ? ["0", String(scale)] : [`1/${2 ** scale}`, `× ${2 ** scale}`];
  picture.words(ends[0], 8, 302);
  picture.words(ends[1], 74, 302, "right");
}
