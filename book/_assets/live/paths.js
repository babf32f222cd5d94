// Shortest paths along the edges of a surface (registration/landmarks.py), and curves in space: lengths and distances.
import { distance, edgesOf } from "./triangles.js";

const SAMPLES = 400; // on a curve whose distance to another is measured

// Neighbours of each vertex and the edges' lengths in space: `first` (V + 1) says where a vertex' own begin in `other`.
export function graphOf({ faces, vertices, V }) {
  const { tail, head } = edgesOf(faces, V),
    first = new Int32Array(V + 1),
    other = new Int32Array(2 * tail.length),
    length = new Float64Array(2 * tail.length);
  for (const ends of [tail, head]) for (const v of ends) first[v + 1]++;
  for (let v = 0; v < V; v++) first[v + 1] += first[v];
  const next = first.slice(),
    at = (v) => vertices.subarray(3 * v, 3 * v + 3);
  tail.forEach((a, e) => {
    for (const ends of [[a, head[e]], [head[e], a]]) {
      other[next[ends[0]]] = ends[1];
      length[next[ends[0]]++] = distance(at(a), at(head[e]));
    }
  });
  return { first, other, length };
}

// Dijkstra's: an edge costs its length times the mean of `cost` (V) over its ends. {path: vertices, cost of it}
export function shortestPath({ first, other, length }, cost, start, end) {
  const total = new Float64Array(cost.length).fill(Infinity),
    previous = new Int32Array(cost.length).fill(-1),
    queue = []; // [sum, vertex], the cheapest last
  const reach = (v, sum, from) => {
    [total[v], previous[v]] = [sum, from];
    let [low, high] = [0, queue.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (queue[middle][0] > sum) low = middle + 1;
      else high = middle;
    }
    queue.splice(low, 0, [sum, v]);
  };
  reach(start, 0, -1);
  while (queue.length) {
    const [sum, v] = queue.pop();
    if (v === end) break;
    if (sum > total[v]) continue; // it was reached more cheaply since
    for (let i = first[v]; i < first[v + 1]; i++) {
      const through = sum + (length[i] * (cost[v] + cost[other[i]])) / 2;
      if (through < total[other[i]]) reach(other[i], through, v);
    }
  }
  const path = [end];
  while (path[path.length - 1] !== start) path.push(previous[path[path.length - 1]]);
  return { path: path.reverse(), cost: total[end] };
}

// ---- curves: vertices of a path, points by arc length in space ----

// lengths of a path up to each of its vertices
function lengths({ vertices }, path) {
  const at = (v) => vertices.subarray(3 * v, 3 * v + 3),
    along = [0];
  path.slice(1).forEach((v, k) => along.push(along[k] + distance(at(path[k]), at(v))));
  return along;
}

export const lengthOf = (hemisphere, path) => lengths(hemisphere, path).pop();

// `count` places at equal steps along a path, ends included: two vertices and the share of the second
export function places(hemisphere, path, count) {
  const along = lengths(hemisphere, path),
    total = along[along.length - 1];
  let k = 0;
  return Array.from({ length: count }, (_, i) => {
    const wanted = (total * i) / (count - 1);
    while (k < path.length - 2 && along[k + 1] <= wanted) k++;
    return { from: path[k], to: path[k + 1], share: Math.min(1, (wanted - along[k]) / (along[k + 1] - along[k])) };
  });
}

// mean distance between two lists of points in space, both ways averaged
export function apart(one, other) {
  const nearest = (from, to) => {
    let sum = 0;
    for (const [x, y, z] of from) {
      let least = Infinity;
      for (const [u, v, w] of to) least = Math.min(least, (x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2);
      sum += Math.sqrt(least);
    }
    return sum / from.length;
  };
  return (nearest(one, other) + nearest(other, one)) / 2;
}

// the same in mm of two paths
export function curveDistance(hemisphere, ...paths) {
  const points = paths.map((path) =>
    places(hemisphere, path, SAMPLES).map(({ from, to, share }) =>
      [0, 1, 2].map((k) => {
        const [a, b] = [hemisphere.vertices[3 * from + k], hemisphere.vertices[3 * to + k]];
        return a + share * (b - a);
      }),
    ),
  );
  return apart(...points);
}
