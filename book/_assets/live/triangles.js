// What triangles (3 F) of any surface have: edges, and normals in space.

// tail, head (E): the edges, the lower vertex first; faceEdge (3 F): corner k's edge to corner k + 1
export function edgesOf(faces, V) {
  const known = new Map(),
    tail = [],
    head = [],
    faceEdge = new Int32Array(faces.length);
  for (let i = 0; i < faces.length; i++) {
    const next = i % 3 === 2 ? i - 2 : i + 1,
      a = Math.min(faces[i], faces[next]),
      b = Math.max(faces[i], faces[next]),
      key = a * V + b;
    if (!known.has(key)) {
      known.set(key, tail.length);
      tail.push(a);
      head.push(b);
    }
    faceEdge[i] = known.get(key);
  }
  return { tail: Int32Array.from(tail), head: Int32Array.from(head), faceEdge };
}

export const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a) => {
  const size = Math.hypot(...a) || 1;
  return a.map((c) => c / size);
};

// of points (3 V): unit normals of the vertices (3 V), the faces' weighted by their areas, and these areas (F)
export function normalsOf(points, faces) {
  const normals = new Float32Array(points.length),
    areas = new Float64Array(faces.length / 3),
    at = (v) => points.subarray(3 * v, 3 * v + 3);
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = faces.subarray(i, i + 3),
      n = cross(minus(at(b), at(a)), minus(at(c), at(a)));
    areas[i / 3] = Math.hypot(...n) / 2;
    for (const v of [a, b, c]) for (let k = 0; k < 3; k++) normals[3 * v + k] += n[k];
  }
  for (let v = 0; v < normals.length; v += 3) normals.set(unit(normals.subarray(v, v + 3)), v);
  return { normals, areas };
}
