// Fourier compression of Beltrami coefficients on the square (plane/fourier.py): only the frequencies |m|, |n| <= k of mu on
// its pixels are kept.
import { zeros } from "./complex.js";

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
