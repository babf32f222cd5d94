// JupyterLab as a host, through anywidget: the state is the trait `state`, what was found is `found`, files are bytes.
import { Explorable } from "./explorable.js";

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

export async function render({ model, el }, spec, worker) {
  const root = document.createElement("div");
  root.className = "qc-live";
  root.dataset.page = spec.name;
  root.append("The figure is loading, and computes its first map ...");
  el.append(root);
  const waiting = new Map();
  let count = 0;
  const host = {
    start: model.get("state"),
    link: null,
    save(state) {
      if (same(state, model.get("state"))) return; // it came from Python
      model.set("state", structuredClone(state));
      model.save_changes();
    },
    tell(found) {
      model.set("found", structuredClone(found));
      model.save_changes();
    },
    // the bytes of a trait as an ArrayBuffer of their own
    async file(name) {
      const bytes = model.get("files")[name];
      if (!bytes) throw new Error(`${name} is missing.`);
      return bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
    },
    worker,
    ask: (state) =>
      new Promise((resolve, reject) => {
        waiting.set(++count, { resolve, reject });
        model.send({ ask: count, state: structuredClone(state) });
      }),
  };
  model.on("msg:custom", ({ answers, found, error }) => {
    const { resolve, reject } = waiting.get(answers) ?? {};
    waiting.delete(answers);
    error ? reject?.(new Error(error)) : resolve?.(found);
  });
  const own = { ...spec, initial: model.get("initial") },
    explorable = await new Explorable(root, own, host).begin().catch((error) => {
      root.textContent = `This figure cannot compute here: ${error.message}.`;
      throw error;
    });
  for (const control of root.querySelectorAll("input, select, button, canvas")) {
    control.dataset.lmSuppressShortcuts = "true"; // or JupyterLab takes arrow keys for its own
  }
  model.on("change:state", () => {
    const state = model.get("state");
    if (!same(state, explorable.state)) explorable.change(state, true);
  });
}
