// Controls from a list: {kind: "log" | "linear" | "choice" | "switch" | "names", name, label, ...} for the state's `name`; those
// that are `rare` are folded, those with `when` are there for states that it holds for.
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
    show: (state) =>
      rows.forEach((row, k) => {
        row.element.hidden = Boolean(list[k].when) && !list[k].when(state);
        row.show(state);
      }),
  };
}

// a row of a label and its control, in the order given
const row = (kind, ...parts) => make("div", { className: `qc-live-${kind}` }, ...parts);

// A slider; a log one moves in the exponent of 10, and the state has the number itself. marks: [[value, sign, words], ...]
function slider({ name, label, min, max, step, digits = 3, also = {}, marks = [] }, act, there = Number, back = Number) {
  const id = freshId(),
    input = make("input", { id, type: "range", min, max, step }),
    output = make("output", { htmlFor: id });
  const send = (settled) => act({ [name]: back(Number(input.value)), ...also }, settled);
  const signs = marks.map(([value, textContent, words]) => {
    const sign = make("span", { textContent, title: `${words}: ${value.toLocaleString("en")}` });
    sign.style.left = `${(100 * (there(value) - min)) / (max - min)}%`;
    return sign;
  });
  if (marks.length) input.setAttribute("aria-description", signs.map((sign) => sign.title).join(", "));
  input.addEventListener("input", () => send(false));
  input.addEventListener("change", () => send(true));
  return {
    element: row(
      "slider",
      make("label", { htmlFor: id, textContent: label }),
      input,
      output,
      ...(signs.length ? [make("div", { className: "qc-live-marks", ariaHidden: "true" }, ...signs)] : []),
    ),
    show(state) {
      input.value = there(state[name]);
      output.textContent = state[name].toLocaleString("en", { maximumSignificantDigits: digits });
      input.setAttribute("aria-valuetext", output.textContent);
    },
  };
}

// a list without an entry that it has, or with one that it has not
export const toggled = (list, one) =>
  list.includes(one) ? list.filter((other) => other !== one) : [...list, one].sort((a, b) => a - b);

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

  // buttons, pressed or not, for a list of labels; options(state): [[label, words], ...]
  names({ name, label, options, also = {} }, act) {
    const list = make("div", { className: "qc-live-names", role: "group", ariaLabel: label });
    return {
      element: make("div", {}, make("span", { textContent: label }), list),
      show(state) {
        const all = options(state);
        while (list.children.length > all.length) list.lastChild.remove();
        all.forEach(([one, textContent], k) => {
          const button = list.children[k] ?? list.appendChild(make("button", { type: "button" }));
          Object.assign(button, { textContent, ariaPressed: String(state[name].includes(one)) });
          button.onclick = () => act({ [name]: toggled(state[name], one), ...also });
        });
      },
    };
  },

  switch({ name, label, also = () => ({}) }, act) {
    const id = freshId(),
      input = make("input", { id, type: "checkbox" });
    input.addEventListener("change", () => act({ [name]: input.checked, ...also(input.checked) }));
    return {
      element: row("switch", input, make("label", { htmlFor: id, textContent: label })),
      show: (state) => {
        input.checked = state[name];
      },
    };
  },
};

// rows of words as rows of a table, the first of them and the first of each as headings
export const tableRows = (rows) =>
  rows.map((row, i) => {
    const cells = row.map((text, k) => make(i && k ? "td" : "th", { textContent: text, scope: k ? "col" : "row" }));
    return make("tr", {}, ...cells);
  });
