// Questions to the worker: promises that give null where a newer question of the same page has taken their place.

const waiting = new Map(),
  started = new WeakMap();
let count = 0,
  failed = null; // why there is no worker

// the host's worker, told once what it works with; files that are missing are null
async function workerOf(host, files) {
  const worker = host.worker();
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
    started.set(
      worker,
      Promise.all(Object.entries(files).map(async ([key, name]) => [key, await fileOf(host, name)])).then((entries) =>
        worker.postMessage({ begin: Object.fromEntries(entries) }),
      ),
    );
  }
  await started.get(worker);
  return worker;
}

async function fileOf(host, name) {
  try {
    return await host.file(name);
  } catch {
    return null;
  }
}

// part: what of the answer is wanted, for tasks that have several
export async function ask(host, page, request, part = "all") {
  const worker = await workerOf(host, { kernels: "kernels.wasm" }),
    id = ++count;
  return new Promise((resolve, reject) => {
    if (failed) reject(failed);
    waiting.set(id, { resolve, reject });
    worker.postMessage({ id, page, request, part });
  });
}

// More files for the worker, key -> name; an error where one of them cannot be loaded.
export async function give(host, files) {
  const found = await Promise.all(Object.entries(files).map(async ([key, name]) => [key, await host.file(name)]));
  const worker = await workerOf(host, { kernels: "kernels.wasm" });
  worker.postMessage({ more: Object.fromEntries(found) });
}
