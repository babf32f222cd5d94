// The static page as a host: every element of class qc-live with data-page="NAME" becomes the explorable explore_NAME.js.
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
    save: (state) => history.replaceState(null, "", link(state)),
    tell() {},
    ...files,
  };
}

// a file that stands in the page, or lies beside this one
async function file(name) {
  const here = document.querySelector(`.qc-live script[data-file="${name}"]`);
  if (here) return Uint8Array.from(atob(here.textContent), (byte) => byte.charCodeAt(0)).buffer;
  const answer = await fetch(new URL(name, import.meta.url));
  if (!answer.ok) throw new Error(`${name} could not be loaded (${answer.status})`);
  return answer.arrayBuffer();
}

let worker = null; // one for all explorables of a page, begun by the first that needs it
const files = {
  file,
  worker: () => (worker ??= new Worker(new URL("worker.js", import.meta.url), { type: "module" })),
};

for (const root of document.querySelectorAll(".qc-live[data-page]")) {
  try {
    const { default: spec } = await import(`./explore_${root.dataset.page}.js`),
      host = hostOf(spec, files);
    const explorable = await new Explorable(root, spec, host).begin();
    if (host.start) root.scrollIntoView();
    addEventListener("hashchange", () => { // a link that is followed on the page itself
      const state = carried(spec.name);
      if (state) explorable.change({ ...structuredClone(spec.initial), ...state });
    });
  } catch (error) {
    const note = root.querySelector("[role=status]") ?? root;
    note.textContent = `This figure cannot compute here: ${error.message}. The picture above was drawn when the book was made.`;
  }
}
