// Controls from a list: {kind: "log" | "linear" | "choice" | "switch", name, label, ...} for the state's `name`; those
// that are `rare` are folded.
// The options of a choice are a list, or a function of the state where they come with the answer.
// Labels are names for everybody: what a screen reader says is what is to be read.

export const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};
// an id of an element's own; by chance, since JupyterLab loads this module once for each widget
export const freshId = () => `qc-live-${Math.random().toString(36).slice(2)}`;

// {element, show(state)}; act(part of a state, whether the movement has ended)
export function buildControls(list, act) {
  const rows = list.map((one) => kinds[one.kind](one, act)),
    some = (rare) => rows.filter((_, k) => Boolean(list[k].rare) === rare),
    grid = (rare) => make("div", { className: "qc-live-controls" }, ...some(rare).map((row) => row.element));
  const folded = make("details", {}, make("summary", { textContent: "More controls" }), grid(true));
  return {
    elements: [grid(false), ...(list.some(({ rare }) => rare) ? [folded] : [])],
    show: (state) => rows.forEach((row) => row.show(state)),
  };
}

// a row of a label and its control, in the order given
const row = (kind, ...parts) => make("div", { className: `qc-live-${kind}` }, ...parts);

// A slider; a log one moves in the exponent of 10, and the state has the number itself.
function slider({ name, label, min, max, step, digits = 3, also = {} }, act, there = Number, back = Number) {
  const id = freshId(),
    input = make("input", { id, type: "range", min, max, step }),
    output = make("output", { htmlFor: id });
  const send = (settled) => act({ [name]: back(Number(input.value)), ...also }, settled);
  input.addEventListener("input", () => send(false));
  input.addEventListener("change", () => send(true));
  return {
    element: row("slider", make("label", { htmlFor: id, textContent: label }), input, output),
    show(state) {
      input.value = there(state[name]);
      output.textContent = state[name].toLocaleString("en", { maximumSignificantDigits: digits });
      input.setAttribute("aria-valuetext", output.textContent);
    },
  };
}

const kinds = {
  log: (one, act) => slider(one, act, Math.log10, (x) => Number((10 ** x).toPrecision(6))),
  linear: slider,

  choice({ name, label, options, also = {} }, act) {
    const id = freshId(),
      select = make("select", { id }),
      listed = typeof options === "function" ? options : () => options;
    select.addEventListener("change", () => act({ [name]: select.value, ...also }));
    return {
      element: row("choice", make("label", { htmlFor: id, textContent: label }), select),
      show: (state) => {
        const list = listed(state);
        if (select.length !== list.length)
          select.replaceChildren(...list.map(([value, text]) => make("option", { value, textContent: text })));
        select.value = state[name];
      },
    };
  },

  switch({ name, label }, act) {
    const id = freshId(),
      input = make("input", { id, type: "checkbox" });
    input.addEventListener("change", () => act({ [name]: input.checked }));
    return {
      element: row("switch", input, make("label", { htmlFor: id, textContent: label })),
      show: (state) => {
        input.checked = state[name];
      },
    };
  },
};
