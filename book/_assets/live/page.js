// The static page as a host: every element of class qc-live with data-page="NAME" becomes the explorable explore_NAME.js.
// This script runs while the page still comes: its own element names the explorables, so that they begin to compute.
import { difference, Explorable } from "./explorable.js";

const PREFIX = "#live-"; // a link that carries a state: #live-NAME=JSON of what differs from the start

function carried(name) {
  const start = `${PREFIX}${name}=`;
  if (!location.hash.startsWith(start)) return null;
  try {
    return JSON.parse(decodeURIComponent(location.hash.slice(start.length)));
  } catch {
    return null; // a link that was cut off: the explorable starts as always
  }
}

function hostOf(spec, files) {
  const start = carried(spec.name);
  const link = (state) =>
    `${location.href.split("#")[0]}${PREFIX}${spec.name}=${encodeURIComponent(JSON.stringify(difference(state, spec.initial)))}`;
  return {
    start,
    link,
    onward: ({ page, name }, state) => `${page}.html${PREFIX}${name}=${encodeURIComponent(JSON.stringify(state))}`,
    ask: null,
    save: (state) => window.Reveal || history.replaceState(null, "", link(state)), // slides have their number there
    tell() {},
    ...files,
  };
}

const { explorables, carried: carriedFiles } = document.querySelector("script[data-explorables]").dataset;

// an element, once the page has come as far as behind it
const appeared = (selector) =>
  new Promise((resolve) => {
    const look = () => {
      const found = document.querySelector(selector);
      if (!found || (document.readyState === "loading" && !found.nextElementSibling)) return;
      watcher.disconnect();
      resolve(found);
    };
    const watcher = new MutationObserver(look);
    watcher.observe(document, { childList: true, subtree: true });
    document.addEventListener("readystatechange", look);
    look();
  });

// a file that stands in the page, or lies beside this one
async function file(name) {
  if (carriedFiles.split(" ").includes(name)) {
    const { textContent } = await appeared(`.qc-live script[data-file="${name}"]`);
    return Uint8Array.from(atob(textContent), (byte) => byte.charCodeAt(0)).buffer;
  }
  const answer = await fetch(new URL(name, import.meta.url)).catch(() => null);
  if (!answer?.ok) throw new Error(`${name} could not be loaded (${answer?.status ?? "no answer"})`);
  return answer.arrayBuffer();
}

const workers = {}; // for all explorables of a page, each begun by the first that needs it
const files = {
  file,
  worker: (name) => (workers[name] ??= new Worker(new URL("worker.js", import.meta.url), { type: "module" })),
};

async function bring(name) {
  const spec = import(`./explore_${name}.js`).then((module) => module.default),
    host = spec.then((found) => hostOf(found, files)),
    early = Promise.all([spec, host]).then(([spec, host]) => spec.answer({ ...spec.initial, ...host.start }, host));
  early.catch(() => {}); // it is heard of below
  const root = await appeared(`.qc-live[data-page=${name}]`);
  root.querySelector("[role=status]").textContent = "The figure is loading, and computes its first map ...";
  try {
    await show(root, await spec, await host, await early);
  } catch (error) {
    const note = root.querySelector("[role=status]") ?? root;
    note.textContent = `This figure cannot compute here: ${error.message}. The picture above was drawn when the book was made.`;
  }
}

async function show(root, spec, host, early) {
  const explorable = await new Explorable(root, spec, host).begin(early);
  if (host.start) root.scrollIntoView();
  addEventListener("hashchange", () => { // a link that is followed on the page itself
    const state = carried(spec.name);
    if (state) explorable.change({ ...structuredClone(spec.initial), ...state });
  });
}

for (const name of explorables.split(" ")) bring(name);
