// All that takes more than a moment: a module worker, so that sliders never wait. The newest request of a page wins.
import boundary from "./explore_boundary.js";
import howsure from "./explore_howsure.js";
import lbs from "./explore_lbs.js";
import mu from "./explore_mu.js";
import { wasmKernels } from "./kernels.js";
import { meshes } from "./mesh.js";
import { solve } from "./solvers.js";

const TASKS = { tuner: solve, mu: mu.work, lbs: lbs.work, boundary: boundary.work, howsure: howsure.work };
const newest = new Map(); // what is asked, page and part -> the newest request for it
const files = {}; // of the page, ArrayBuffers by name
let busy = false,
  bench = null; // a promise of what tasks work with: files, meshes on the kernels, and networks that have been made

async function begin() {
  const kernels = await wasmKernels(files.kernels);
  return { kernels, files, mesh: meshes(kernels), networks: {} };
}

onmessage = ({ data }) => {
  if (data.files) {
    Object.assign(files, data.files);
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
    await (bench ??= begin()).catch(() => {}); // what is asked meanwhile takes an older question's place
    const [kind, { id, page, request, part }] = newest.entries().next().value;
    newest.delete(kind);
    const stale = async () => {
      await pause();
      return [...newest.values()].some((other) => other.page === page);
    };
    try {
      postMessage({ id, answer: await TASKS[page](await bench, request, part, stale) });
    } catch (error) {
      postMessage({ id, error: error.message });
    }
    await pause();
  }
  busy = false;
}
