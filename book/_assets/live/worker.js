// All that takes more than a moment: a module worker, so that sliders never wait. The newest request of a page wins.
import { answerTuner } from "./tuner.js";
import { plainKernels, wasmKernels } from "./kernels.js";
import { answerBoundary } from "./boundary.js";
import { answerLbs } from "./lbs.js";
import { PolarMesh } from "./mesh.js";
import { answerMu } from "./paint.js";

const TASKS = { tuner: answerTuner, mu: answerMu, lbs: answerLbs, boundary: answerBoundary };
const newest = new Map(); // what is asked, page and part -> the newest request for it
let busy = false,
  begun = null;

// What tasks work with: kernels, meshes made when first needed, files of the page (ArrayBuffers) by name.
class Bench {
  constructor(kernels, files) {
    Object.assign(this, { kernels, files, meshes: new Map() });
  }

  mesh(rings, spokes, power = 1.4) {
    const name = `${rings} x ${spokes}, ${power}`;
    if (!this.meshes.has(name)) this.meshes.set(name, new PolarMesh(rings, spokes, power, this.kernels));
    return this.meshes.get(name);
  }
}

async function begin({ kernels, ...files }) {
  let found = plainKernels;
  try {
    if (kernels) found = await wasmKernels(kernels);
  } catch {
    // no WebAssembly here: the same in JavaScript, slower
  }
  return new Bench(found, files);
}

onmessage = ({ data }) => {
  if (data.begin) {
    begun = begin(data.begin);
    return;
  }
  if (data.more) {
    begun = begun.then((bench) => Object.assign(bench, { files: { ...bench.files, ...data.more } }));
    return;
  }
  const kind = `${data.page} ${data.part}`,
    older = newest.get(kind);
  if (older) postMessage({ id: older.id, passed: true });
  newest.set(kind, data);
  if (!busy) work();
};

const pause = () => new Promise((resolve) => setTimeout(resolve));

async function work() {
  busy = true;
  while (newest.size) {
    const bench = await begun;
    const [kind, { id, page, request, part }] = newest.entries().next().value;
    newest.delete(kind);
    const stale = async () => {
      await pause();
      return [...newest.values()].some((other) => other.page === page);
    };
    try {
      postMessage({ id, answer: await TASKS[page](bench, request, part, stale) });
    } catch (error) {
      postMessage({ id, error: error.message });
    }
    await pause();
  }
  busy = false;
}
