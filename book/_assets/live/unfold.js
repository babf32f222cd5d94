// A folded surface smoothed until the floors of its sulci can be seen (pages/livesurfaces.py has the same).

const ROUNDS = 150; // of averaging over neighbours

// Positions (3 V) after rounds in which each vertex moves half of the way to its neighbours' mean, one of the rim to that of
// its neighbours on the rim, so that the opening stays open; scaled back about their middle to the area of the surface.
export function unfolded({ vertices, faces, V }) {
  const { first, other } = neighbours(faces, V);
  let x = Float64Array.from(vertices),
    next = new Float64Array(x.length);
  for (let round = 0; round < ROUNDS; round++) {
    for (let v = 0; v < V; v++) {
      const count = first[v + 1] - first[v];
      for (let k = 0; k < 3; k++) {
        let sum = 0;
        for (let i = first[v]; i < first[v + 1]; i++) sum += x[3 * other[i] + k];
        next[3 * v + k] = (x[3 * v + k] + sum / count) / 2;
      }
    }
    [x, next] = [next, x];
  }
  const scale = Math.sqrt(area(vertices, faces) / area(x, faces)),
    middle = [0, 1, 2].map((k) => x.reduce((sum, c, i) => (i % 3 === k ? sum + c : sum), 0) / V);
  return Float32Array.from(x, (c, i) => middle[i % 3] + scale * (c - middle[i % 3]));
}

// whose mean a vertex moves to: `first` (V + 1) says where its own begin in `other`
function neighbours(faces, V) {
  const seen = new Map(); // edge -> how many triangles it has
  for (let i = 0; i < faces.length; i++) {
    const a = faces[i],
      b = faces[i % 3 === 2 ? i - 2 : i + 1],
      key = Math.min(a, b) * V + Math.max(a, b);
    seen.set(key, (seen.get(key) ?? 0) + 1);
  }
  const rim = new Uint8Array(V),
    lists = Array.from({ length: V }, () => []);
  for (const [key, count] of seen) if (count === 1) rim[Math.floor(key / V)] = rim[key % V] = 1;
  for (const key of seen.keys()) {
    const a = Math.floor(key / V),
      b = key % V;
    if (!rim[a] || rim[b]) lists[a].push(b);
    if (!rim[b] || rim[a]) lists[b].push(a);
  }
  const first = new Int32Array(V + 1);
  lists.forEach((list, v) => (first[v + 1] = first[v] + list.length));
  return { first, other: Int32Array.from(lists.flat()) };
}

function area(x, faces) {
  let sum = 0;
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = [3 * faces[i], 3 * faces[i + 1], 3 * faces[i + 2]],
      [u, v, w] = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]],
      [p, q, r] = [x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]];
    sum += Math.hypot(v * r - w * q, w * p - u * r, u * q - v * p) / 2;
  }
  return sum;
}
