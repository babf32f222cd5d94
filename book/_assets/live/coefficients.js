// Beltrami coefficients that a reader sets and paints, and their Fourier compression on the square (plane/fourier.py).
import { zeros } from "./complex.js";

const BUMP = { x: 0.3, y: 0.2, width: 0.3 };

// how a preset varies over the disk: a complex factor at (x, y)
const PRESETS = {
  constant: () => [1, 0],
  radial(x, y) {
    // of z |z|^(K - 1)
    const square = x * x + y * y;
    return square > 0 ? [(x * x - y * y) / square, (2 * x * y) / square] : [1, 0];
  },
  waves: (x, y) => [Math.sin(4 * x) * Math.cos(3 * y), 0],
  bump: (x, y) => [Math.exp(-((x - BUMP.x) ** 2 + (y - BUMP.y) ** 2) / BUMP.width ** 2), 0],
  blank: () => [0, 0],
};

// mu at a point: the preset times the number of the sliders, then what was painted over it, [x, y, radius, re, im] each
export function muAt({ preset, size, direction, strokes }, x, y) {
  for (let k = strokes.length - 1; k >= 0; k--) {
    const [u, v, radius, re, im] = strokes[k];
    if ((x - u) ** 2 + (y - v) ** 2 <= radius * radius) return [re, im];
  }
  const [a, b] = PRESETS[preset](x, y),
    [c, d] = value({ size, direction });
  return [a * c - b * d, a * d + b * c];
}

// what the sliders say, and the brush paints
export function value({ size, direction }) {
  const angle = (direction * Math.PI) / 180;
  return [size * Math.cos(angle), size * Math.sin(angle)];
}

export function muOnFaces(state, mesh) {
  const mu = zeros(mesh.F),
    centre = mesh.onFaces(mesh.z);
  for (let t = 0; t < mesh.F; t++) [mu.x[t], mu.y[t]] = muAt(state, centre.x[t], centre.y[t]);
  return mu;
}

// ---- compression: only the frequencies |m|, |n| <= k of mu on the pixels of the square are kept ----

const ratio = (x, y) => Math.max(Math.abs(x), Math.abs(y)) / (Math.hypot(x, y) || 1);

// Radians that pixels are turned before the faces below them are looked for: those on the square's diagonals lie on edges.
const ASIDE = 1e-9;

// mu on the faces, without its frequencies above k, side x side pixels
export function compressed(mesh, mu, k, side) {
  const image = zeros(side * side);
  for (let row = 0; row < side; row++) {
    for (let column = 0; column < side; column++) {
      const x = (2 * column + 1) / side - 1,
        y = (2 * row + 1) / side - 1,
        shrink = ratio(x, y);
      const { face } = mesh.locate((x - ASIDE * y) * shrink, (y + ASIDE * x) * shrink),
        at = row * side + column;
      image.x[at] = mu.x[face];
      image.y[at] = mu.y[face];
    }
  }
  return fromSquare(mesh, lowPass(lowPass(image, k, side), k, side), side);
}

// Each row without its frequencies above k; transposed, so that two of them are the two-dimensional transform.
function lowPass(image, k, side) {
  const kernel = Float64Array.from({ length: side }, (_, shift) => {
    // what keeping |m| <= k convolves with
    let sum = 1;
    for (let m = 1; m <= Math.min(k, (side - 1) >> 1); m++) sum += 2 * Math.cos((2 * Math.PI * m * shift) / side);
    return 2 * k + 1 > side ? Number(shift === 0) : sum / side;
  });
  const out = zeros(side * side);
  for (let row = 0; row < side; row++) {
    for (let p = 0; p < side; p++) {
      let x = 0,
        y = 0;
      for (let q = 0; q < side; q++) {
        const weight = kernel[(p - q + side) % side],
          from = row * side + q;
        x += weight * image.x[from];
        y += weight * image.y[from];
      }
      out.x[p * side + row] = x;
      out.y[p * side + row] = y;
    }
  }
  return out;
}

// the image, bilinear at the centroids of the faces, constant beyond the outer pixels
function fromSquare(mesh, image, side) {
  const mu = zeros(mesh.F),
    centre = mesh.onFaces(mesh.z);
  const place = (c) => Math.min(Math.max(((c + 1) * side - 1) / 2, 0), side - 1);
  for (let t = 0; t < mesh.F; t++) {
    const x = centre.x[t],
      y = centre.y[t],
      grow = 1 / ratio(x, y);
    const row = place(y * grow),
      column = place(x * grow),
      i = Math.min(Math.floor(row), side - 2);
    const j = Math.min(Math.floor(column), side - 2),
      a = row - i,
      b = column - j,
      at = i * side + j;
    for (const part of ["x", "y"]) {
      const v = image[part];
      mu[part][t] = (1 - a) * ((1 - b) * v[at] + b * v[at + 1]) + a * ((1 - b) * v[at + side] + b * v[at + side + 1]);
    }
  }
  return mu;
}
