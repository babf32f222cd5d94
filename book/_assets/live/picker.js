// The browser's part of book/qcbook/picker.py: pictures of two surfaces, and what is clicked, dragged and typed.
const TURNS = { ArrowLeft: [-25, 0], ArrowRight: [25, 0], ArrowUp: [0, -25], ArrowDown: [0, 25] };
const ZOOMS = { "+": 1.2, "=": 1.2, "-": 1 / 1.2 };

const make = (tag, properties, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  element.dataset.lmSuppressShortcuts = "true"; // or JupyterLab takes the keys for its own
  return element;
};

function view(model, side) {
  const picture = make("img", { alt: "", draggable: false });
  picture.style = "display:block;cursor:crosshair;touch-action:none";
  const cross = make("span", { textContent: "+" });
  cross.style = "position:absolute;left:50%;top:50%;transform:translate(-50%,-50%);pointer-events:none;color:#C00000";
  const keys = "arrow keys turn, plus and minus zoom, Enter marks the place in the middle, u undoes, s saves";
  const box = make("div", { tabIndex: 0 }, picture, cross);
  box.style = "position:relative;width:max-content";
  box.setAttribute("role", "application");
  box.setAttribute("aria-label", `${side} surface: ${keys}`);
  let address = null, drag = null, waits = false, turn = null;
  const flush = () => {
    if (waits || !turn) return; // one picture at a time: the kernel does not fall behind the hand
    model.send({ do: "turn", side, ...turn });
    [waits, turn] = [true, null];
  };
  const add = (right, down, zoom = 1) => {
    turn = { right: (turn?.right ?? 0) + right, down: (turn?.down ?? 0) + down, zoom: (turn?.zoom ?? 1) * zoom };
    flush();
  };
  const click = (x, y) => model.send({ do: "click", side, x: Math.round(x), y: Math.round(y) });
  picture.onpointerdown = (event) => {
    drag = { x: event.clientX, y: event.clientY, far: 0 };
    picture.setPointerCapture(event.pointerId);
  };
  picture.onpointermove = (event) => {
    if (!drag) return;
    const [right, down] = [event.clientX - drag.x, event.clientY - drag.y];
    drag = { x: event.clientX, y: event.clientY, far: drag.far + Math.abs(right) + Math.abs(down) };
    if (drag.far > 3) add(right, down);
  };
  picture.onpointerup = (event) => {
    if (drag && drag.far <= 3) click(event.offsetX, event.offsetY);
    drag = null;
  };
  box.onwheel = (event) => {
    if (document.activeElement !== box) return; // the page scrolls
    event.preventDefault();
    add(0, 0, event.deltaY < 0 ? 1.1 : 1 / 1.1);
  };
  box.onkeydown = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const plain = { u: "undo", s: "save" }[event.key];
    if (event.key in TURNS) add(...TURNS[event.key]);
    else if (event.key in ZOOMS) add(0, 0, ZOOMS[event.key]);
    else if (event.key === "Enter") click(picture.width / 2, picture.height / 2);
    else if (plain) model.send({ do: plain });
    else return;
    event.preventDefault();
  };
  const show = () => {
    if (address) URL.revokeObjectURL(address);
    address = URL.createObjectURL(new Blob([model.get("pictures")[side]], { type: "image/jpeg" }));
    picture.src = address;
  };
  model.on("msg:custom", ({ turned }) => {
    if (turned !== side) return;
    waits = false;
    flush();
  });
  model.on("change:pictures", show);
  show();
  return make("figure", { style: "margin:0" }, make("figcaption", { textContent: side }), box);
}

function render({ model, el }) {
  const name = make("input", { type: "text", size: 30 });
  const said = make("p", {});
  said.setAttribute("role", "status");
  const button = (words, what) => make("button", { textContent: words, onclick: () => model.send({ do: what }) });
  name.onchange = () => {
    model.set("names", [...model.get("names").slice(0, -1), name.value]);
    model.save_changes();
  };
  const tell = () => {
    name.value = model.get("names").at(-1);
    said.textContent = model.get("said");
  };
  model.on("change:names change:said", tell);
  tell();
  const sides = make("div", {}, view(model, "moving"), view(model, "control"));
  sides.style = "display:flex;flex-wrap:wrap;gap:8px";
  el.append(make("label", {}, "name of the curve ", name), button("Undo", "undo"), button("Save", "save"), said, sides);
}
export default { render };
