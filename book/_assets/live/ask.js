// Questions to the worker: promises that give null where a newer question of the same page has taken their place.

const waiting = new Map(),
  started = new WeakMap();
let count = 0,
  failed = null; // why there is no worker

// a worker of the host, told once what it works with; a quick one has what is there at once, and waits for no longer answer
async function workerOf(host, quick = false) {
  const worker = host.worker(quick ? "quick" : "main");
  if (!started.has(worker)) {
    worker.onmessage = ({ data }) => {
      const { resolve, reject } = waiting.get(data.id) ?? {};
      waiting.delete(data.id);
      if (data.error) reject?.(new Error(data.error));
      else resolve?.(data.passed ? null : data.answer);
    };
    worker.onerror = (event) => {
      event.preventDefault?.();
      failed = new Error("worker.js could not be loaded");
      for (const { reject } of waiting.values()) reject(failed);
      waiting.clear();
    };
    started.set(worker, hand(worker, host, { kernels: "kernels.wasm" }));
  }
  await started.get(worker);
  return worker;
}

// files of the host, key -> name; an error where one of them cannot be loaded
async function hand(worker, host, files) {
  const found = await Promise.all(Object.entries(files).map(async ([key, name]) => [key, await host.file(name)]));
  worker.postMessage({ files: Object.fromEntries(found) });
}

// part: what of the answer is wanted, for tasks that have several
export async function ask(host, page, request, part = "all") {
  const worker = await workerOf(host, part === "coarse"),
    id = ++count;
  return new Promise((resolve, reject) => {
    if (failed) reject(failed);
    waiting.set(id, { resolve, reject });
    worker.postMessage({ id, page, request, part });
  });
}

// more files for the worker
export const give = async (host, files) => hand(await workerOf(host), host, files);
