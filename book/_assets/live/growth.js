// Frames of a growing surface: areas, curvature, and a picture without a graphics card.
import { readNetwork } from "./unet.js";

// {positions (K V 3), faces (3 F), V, K, factors, crossing} from a file of `packed` (livenets.py)
export function readFrames(file) {
  const { config, tensors } = readNetwork(file),
    { shape, data } = tensors.positions;
  const film = { ...config, positions: data, K: shape[0], V: shape[1], faces: Int32Array.from(tensors.faces.data) };
  film.edges = edgesOf(film.faces, film.V);
  film.first = measured(film, 0);
  const last = frame(film, film.K - 1),
    low = [Infinity, Infinity, Infinity],
    high = [-Infinity, -Infinity, -Infinity];
  last.forEach((c, i) => {
    low[i % 3] = Math.min(low[i % 3], c);
    high[i % 3] = Math.max(high[i % 3], c);
  });
  film.centre = low.map((c, i) => (c + high[i]) / 2);
  film.radius = Math.hypot(...low.map((c, i) => (high[i] - c) / 2));
  return film;
}

const frame = ({ positions, V }, k) => positions.subarray(3 * V * k, 3 * V * (k + 1));

function edgesOf(faces, V) {
  const known = new Set();
  for (let i = 0; i < faces.length; i++) {
    const a = faces[i],
      b = faces[i % 3 === 2 ? i - 2 : i + 1];
    known.add(Math.min(a, b) * V + Math.max(a, b));
  }
  return Int32Array.from([...known].flatMap((key) => [Math.floor(key / V), key % V]));
}

// area, unit normals (V 3), curvature (V), areas around vertices (V), and the spread of the curvature times an edge
export function measured(film, k) {
  const x = frame(film, k),
    { faces, V } = film,
    normal = new Float64Array(3 * V),
    share = new Float64Array(V);
  let area = 0;
  for (let t = 0; t < faces.length; t += 3) {
    const [a, b, c] = [3 * faces[t], 3 * faces[t + 1], 3 * faces[t + 2]],
      u = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]],
      v = [x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]];
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]],
      size = Math.hypot(...n) / 2;
    area += size;
    for (const corner of [a, b, c]) {
      share[corner / 3] += size / 3;
      for (let i = 0; i < 3; i++) normal[corner + i] += n[i];
    }
  }
  for (let i = 0; i < 3 * V; i += 3) {
    const size = Math.hypot(normal[i], normal[i + 1], normal[i + 2]) || 1;
    for (let j = i; j < i + 3; j++) normal[j] /= size;
  }
  return { x, area, normal, share, curvature: curvatureOf(film, x, normal) };
}

// how far a vertex stands out of the mean of its neighbours, in edge lengths: positive on gyri
function curvatureOf({ edges, V }, x, normal) {
  const out = new Float64Array(V),
    count = new Float64Array(V);
  let length = 0;
  for (let e = 0; e < edges.length; e += 2) {
    const a = 3 * edges[e],
      b = 3 * edges[e + 1],
      d = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]];
    length += Math.hypot(...d);
    for (let i = 0; i < 3; i++) {
      out[a / 3] -= d[i] * normal[a + i];
      out[b / 3] += d[i] * normal[b + i];
    }
    count[a / 3]++;
    count[b / 3]++;
  }
  return out.map((c, v) => c / count[v] / (length / (edges.length / 2)));
}

// Where vertices are to be seen: right, up and towards the eye, for an eye `turn` degrees round from the lateral side of
// a left hemisphere and `tilt` above.
function seen({ centre, radius, V }, x, { turn, tilt }) {
  const a = (turn * Math.PI) / 180,
    b = (tilt * Math.PI) / 180;
  const eye = [-Math.cos(b) * Math.cos(a), -Math.cos(b) * Math.sin(a), Math.sin(b)],
    right = [Math.sin(a), -Math.cos(a), 0],
    up = [eye[1] * right[2] - eye[2] * right[1], eye[2] * right[0] - eye[0] * right[2], eye[0] * right[1] - eye[1] * right[0]];
  const out = new Float64Array(3 * V);
  for (let i = 0; i < 3 * V; i += 3) {
    [right, up, eye].forEach((axis, j) => {
      for (let m = 0; m < 3; m++) out[i + j] += (axis[m] * (x[i + m] - centre[m])) / radius;
    });
  }
  return { place: out, eye };
}

// Paint triangles into an image (width, width), nearest first by a depth for each pixel; shade(v) -> [r, g, b] at a vertex.
export function paint(image, film, { x, normal }, view, shade) {
  const { width } = image,
    { place, eye } = seen(film, x, view),
    depth = new Float32Array(width * width).fill(-Infinity),
    half = width / 2,
    { faces } = film;
  const colour = new Float32Array(3 * film.V);
  for (let v = 0; v < film.V; v++) {
    const towards = normal[3 * v] * eye[0] + normal[3 * v + 1] * eye[1] + normal[3 * v + 2] * eye[2],
      light = 0.45 + 0.55 * Math.abs(towards);
    colour.set(shade(v).map((c) => light * c), 3 * v);
  }
  image.data.fill(255);
  for (let t = 0; t < faces.length; t += 3) {
    const [a, b, c] = [3 * faces[t], 3 * faces[t + 1], 3 * faces[t + 2]];
    const X = [a, b, c].map((i) => half * (1 + 0.97 * place[i])),
      Y = [a, b, c].map((i) => half * (1 - 0.97 * place[i + 1]));
    const twice = (X[1] - X[0]) * (Y[2] - Y[0]) - (X[2] - X[0]) * (Y[1] - Y[0]);
    if (twice === 0) continue;
    const right = Math.min(width - 1, Math.ceil(Math.max(...X))),
      bottom = Math.min(width - 1, Math.ceil(Math.max(...Y)));
    for (let j = Math.max(0, Math.floor(Math.min(...Y))); j <= bottom; j++) {
      for (let i = Math.max(0, Math.floor(Math.min(...X))); i <= right; i++) {
        const q = ((i - X[0]) * (Y[2] - Y[0]) - (X[2] - X[0]) * (j - Y[0])) / twice,
          r = ((X[1] - X[0]) * (j - Y[0]) - (i - X[0]) * (Y[1] - Y[0])) / twice,
          p = 1 - q - r;
        if (p < 0 || q < 0 || r < 0) continue;
        const near = p * place[a + 2] + q * place[b + 2] + r * place[c + 2],
          at = j * width + i;
        if (near <= depth[at]) continue;
        depth[at] = near;
        for (let m = 0; m < 3; m++) image.data[4 * at + m] = p * colour[a + m] + q * colour[b + m] + r * colour[c + m];
      }
    }
  }
}
