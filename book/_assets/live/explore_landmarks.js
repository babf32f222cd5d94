// A sulcus between two endpoints on the picture of the curvature: the shortest path at once, LD-Net's beside it.
import { INITIAL } from "./given.js";
import { Hemisphere } from "./hemisphere.js";
import { curveDistance, graphOf, lengthOf, places, shortestPath } from "./paths.js";
import { COLOURS } from "./picture.js";
import { CORTICES } from "./problems.js";
import { gap, three } from "./words.js";

const PIXELS = 200, // of the picture of the curvature, a side
  CLOSER = 3, // the second picture's magnification
  POINTS = 5; // of a curve in the tuner
const WAYS = { shortest: "#56B4E9", floor: "#009E73", network: COLOURS.registered, truth: COLOURS.target };
const surfaces = new Map(); // name -> {hemisphere, graph, image, names, ends, network, truth}
let listed = null;

async function load(host, name) {
  listed ??= JSON.parse(new TextDecoder().decode(await host.file("landmarks.json")));
  if (surfaces.has(name)) return;
  const { file, ...known } = listed[name],
    hemisphere = new Hemisphere(await host.file(file));
  surfaces.set(name, { ...known, hemisphere, graph: graphOf(hemisphere), image: imageOf(hemisphere) });
}

// the curvature as a canvas, which needs a triangle for each pixel
function imageOf(hemisphere) {
  const canvas = Object.assign(document.createElement("canvas"), { width: PIXELS, height: PIXELS }),
    pen = canvas.getContext("2d"),
    image = pen.createImageData(PIXELS, PIXELS);
  for (let i = 0; i < PIXELS * PIXELS; i++) {
    const x = (2 * (i % PIXELS) + 1) / PIXELS - 1,
      y = 1 - (2 * Math.floor(i / PIXELS) + 1) / PIXELS;
    if (x * x + y * y > 1) continue;
    const { corners, weights } = hemisphere.locate(...hemisphere.fromPicture([x, y])),
      shade = corners.reduce((sum, v, k) => sum + weights[k] * hemisphere.shade[v], 0);
    image.data.set([60 + 0.7 * shade, 60 + 0.7 * shade, 60 + 0.7 * shade, 255], 4 * i);
  }
  pen.putImageData(image, 0, 0);
  return canvas;
}

// ---- endpoints: those of the named sulcus, or the vertices that the reader has chosen ----

function endsOf({ hemisphere, sulcus, ends }) {
  const own = surfaces.get(hemisphere)?.ends[sulcus] ?? [];
  return own.map((v, k) => ends[k] ?? v);
}

const place = (hemisphere, v) => [hemisphere.places[2 * v], hemisphere.places[2 * v + 1]];

// the vertex at a point of the picture; by keys at least the next one that way
function chosen(state, index, point, by) {
  const { hemisphere, graph } = surfaces.get(state.hemisphere),
    { corners, weights } = hemisphere.locate(...hemisphere.fromPicture(point)),
    nearest = corners[weights.indexOf(Math.max(...weights))],
    now = endsOf(state)[index];
  if (nearest !== now || by !== "keys") return nearest;
  const [x, y] = place(hemisphere, now),
    near = Array.from(graph.other.subarray(graph.first[now], graph.first[now + 1]));
  const along = near.map((v) => {
    const [u, w] = place(hemisphere, v);
    return ((u - x) * (point[0] - x) + (w - y) * (point[1] - y)) / Math.hypot(u - x, w - y);
  });
  return near[along.indexOf(Math.max(...along))];
}

// ---- paths ----

function answerNow(state) {
  const known = surfaces.get(state.hemisphere),
    { hemisphere, graph, names, ends, network, truth } = known,
    [start, end] = endsOf(state);
  if (start === end) throw new Error("both ends are at the same place; move one of them");
  const cost = hemisphere.curvature.map((h, v) => Math.exp(state.curvature * h - state.depth * hemisphere.depth[v]));
  const floor = shortestPath(graph, cost, start, end),
    shortest = shortestPath(graph, cost.fill(1), start, end);
  const own = start === ends[state.sulcus][0] && end === ends[state.sulcus][1],
    beside = (paths) => (own && paths ? paths[state.sulcus] : null);
  const found = { floor: floor.path, shortest: shortest.path, network: beside(network), truth: beside(truth) };
  return { ...found, ...measured(hemisphere, found), cost: floor.cost, name: names[state.sulcus], own };
}

function measured(hemisphere, { floor, shortest, network, truth }) {
  const deep = (path) => (path.reduce((sum, v) => sum + hemisphere.depth[v], 0) / path.length) * hemisphere.deep,
    apart = (one, other) => (one && other ? curveDistance(hemisphere, one, other) : null);
  return {
    length: lengthOf(hemisphere, floor),
    shortestLength: lengthOf(hemisphere, shortest),
    deep: deep(floor),
    shortestDeep: deep(shortest),
    networkApart: apart(floor, network),
    floorOff: apart(floor, truth),
    networkOff: apart(network, truth),
  };
}

async function answer(state, host) {
  await load(host, state.hemisphere);
  return answerNow(state);
}

// ---- pictures ----

function draw(pictures, state, found) {
  const { hemisphere, image } = surfaces.get(state.hemisphere),
    ends = endsOf(state).map((v) => place(hemisphere, v)),
    middle = [0, 1].map((k) => found.floor.reduce((sum, v) => sum + hemisphere.places[2 * v + k], 0) / found.floor.length);
  const shown = ["truth", "shortest", "floor", "network"].filter((way) => found[way] && (state[way] ?? true));
  pictures.forEach((picture, k) => {
    const [zoom, [x, y]] = k ? [CLOSER, middle] : [1, [0, 0]],
      to = ([u, v]) => [zoom * (u - x), zoom * (v - y)];
    picture.clear();
    picture.raster(image, to);
    for (const way of shown) {
      const line = found[way].map((v) => to(place(hemisphere, v)));
      picture.lines([line], WAYS[way], way === "floor" ? 3 : 2, way === "truth" ? [5, 4] : []);
    }
    ends.forEach((end) => picture.dot(to(end), "white", 5));
    if (!k) picture.mark();
  });
}

// the tuner's state with a path's points as landmarks
function toTuner({ hemisphere: name, sulcus }, path) {
  const { hemisphere, order } = surfaces.get(name),
    first = order[sulcus] * POINTS,
    points = places(hemisphere, path, POINTS).map(({ from, to, share }) =>
      ["x", "y"].map((k) => Number((hemisphere[k][from] * (1 - share) + hemisphere[k][to] * share).toFixed(6))),
    );
  return { problem: name, starts: Object.fromEntries(points.map((point, k) => [first + k, point])) };
}

const mm = (x) => `${three(x)} mm`;

export default {
  name: "landmarks",
  label: "Endpoints, paths and LD-Net",
  initial: INITIAL.landmarks,
  controls: [
    { kind: "choice", name: "hemisphere", label: "hemisphere", also: { ends: {} }, options: CORTICES },
    {
      kind: "choice",
      name: "sulcus",
      label: "sulcus",
      also: { ends: {} },
      options: ({ hemisphere }) => surfaces.get(hemisphere)?.names.map((name, k) => [k, name]) ?? [],
    },
    { kind: "linear", name: "curvature", label: "weight of the curvature in the path's cost", min: 0, max: 2, step: 0.05 },
    { kind: "linear", name: "depth", label: "weight of the depth in the path's cost", min: 0, max: 4, step: 0.1 },
    { kind: "switch", name: "shortest", label: "shortest way on the surface (blue)" },
    { kind: "switch", name: "network", label: "LD-Net's curve (orange)" },
    { kind: "switch", name: "truth", label: "true curve, where it is known (red, dashed)" },
  ],
  views: [
    {
      name: "disk",
      label: "curvature (dark: sulci); drag the two ends; green: path along the floor",
      points: (state) => endsOf(state).map((v) => place(surfaces.get(state.hemisphere).hemisphere, v)),
      drag: (state, index, point, by) => ({ ends: { ...state.ends, [index]: chosen(state, index, point, by) } }),
    },
    { name: "closer", label: "the same, closer" },
  ],
  answer,
  draw,
  words(state, found) {
    const ends = found.own ? found.name : "Ends of your own",
      said = [
        `${ends}: the path along the floor is ${mm(found.length)} long and ${mm(found.deep)} deep on average, ` +
          `at a cost of ${three(found.cost)}`,
        `The shortest way on the surface is ${mm(found.shortestLength)} long and ${mm(found.shortestDeep)} deep`,
      ];
    if (found.networkApart !== null) said.push(`LD-Net's curve is ${mm(found.networkApart)} from the path along the floor`);
    else said.push("LD-Net's curves are stored for the named sulci between their own ends");
    if (!state.truth) return `${said.join(". ")}.`;
    if (found.floorOff !== null) {
      said.push(`From the true curve the path along the floor is ${mm(found.floorOff)} away, LD-Net's ${mm(found.networkOff)}`);
    } else said.push(found.own ? "Nobody knows the true curve of a real cortex" : "Between other ends there is no true curve");
    return `${said.join(". ")}.`;
  },
  data: (state, { floor, ...found }) => ({ path: floor, tuner: toTuner(state, floor), ...found }),
  compare: (found, kernel) => {
    const same = found.floor.filter((v) => kernel.path.includes(v)).length;
    return (
      `The kernel's path has ${kernel.path.length} vertices, of which ${same} are on the page's; ` +
      `relative to each other their costs differ by ${gap(Math.abs(found.cost / kernel.cost - 1))}.`
    );
  },
  question: {
    text:
      "Halve the weight of the depth. How many mm longer than the shortest way on the surface is the path along the " +
      "floor then? ",
    async truth(state, host) {
      const found = await answer({ ...state, depth: state.depth / 2 }, host);
      return found.length - found.shortestLength;
    },
    why: "A sulcus winds: who wants to stay on its floor pays with length, and the two weights say how gladly.",
  },
  onward: {
    page: "live",
    name: "tuner",
    text: "Take the green curve to the tuner",
    state: (state, { floor }) => toTuner(state, floor),
  },
};
