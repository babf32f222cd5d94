// A canvas that shows the unit disk, with points that mouse, finger and arrow keys move, and the strokes that all share.
import { make } from "./controls.js";

export const COLOURS = {
  grid: "#1F4E79",
  target: "#B22222",
  registered: "#E69F00",
  moving: "#117733",
  fold: "#D000D0",
  ink: "#222222",
};
const SIZE = 320,
  LARGEST = 1.4, // times its size is a picture shown at most
  MARGIN = 10,
  REACH = 24, // pixels of the picture, its rim, and how far from a point a finger may be
  CLICK = 4; // pixels that a pointer moves in a click, at most
const STEP = 0.01; // of the disk's radius, by which an arrow key moves a point; ten times with shift

// view: name, label; for what can be moved: points(state) -> [[x, y], ...] and drag(state, index, point, by) -> part of a
// state, by a "pointer", by "keys", or "press" (Enter); anywhere: a pointer may begin everywhere; click(state, label) -> part of
// a state, for the lines that are `named`, which also say their words where a pointer is
export class Picture {
  constructor(view, title) {
    Object.assign(this, { view, title, chosen: 0, points: [] });
    this.makeCanvas(...this.size);
    this.begin();
    this.describe("");
    this.named = []; // [{label, words, line: [[x, y], ...] in parts of the canvas}]
    if (view.drag) this.listen();
    if (view.click) this.nameLines();
  }

  get size() {
    return [SIZE, SIZE];
  }

  makeCanvas(...size) {
    const { view } = this;
    this.sharpness = LARGEST * Math.min(2, Math.max(1, globalThis.devicePixelRatio || 1));
    const [width, height] = size.map((pixels) => Math.round(pixels * this.sharpness));
    this.canvas = make("canvas", { width, height });
    this.canvas.setAttribute("role", view.drag ? "application" : "img");
    this.tip = make("span", { className: "qc-live-tip", hidden: true });
    this.element = make("figure", {}, this.canvas, this.tip, make("figcaption", { textContent: view.label }));
    if (!view.drag) return;
    this.canvas.tabIndex = 0;
    this.canvas.style.touchAction = "none";
  }

  begin() {
    this.pen = this.canvas.getContext("2d");
    this.pen.scale(this.sharpness, this.sharpness);
  }

  describe(words) {
    this.canvas.setAttribute("aria-label", `${this.title}: ${this.view.label}. ${words}`.trim());
  }

  handles(state) {
    this.points = this.view.points ? this.view.points(state) : [];
    if (this.chosen >= this.points.length) this.chosen = 0;
  }

  // ---- moving points ----

  listen() {
    const { canvas } = this;
    const role = "picture with points to move: arrow keys move the chosen one, Page Up and Page Down choose another";
    canvas.setAttribute("aria-roledescription", role);
    canvas.addEventListener("pointerdown", (event) => this.take(event));
    canvas.addEventListener(
      "pointermove",
      (event) => this.dragging && this.strayed(event) && this.onDrag(this.chosen, this.at(event), false, "pointer"),
    );
    const drop = (event) => {
      if (!this.dragging) return;
      this.dragging = false;
      if (this.strayed(event)) this.onDrag(this.chosen, this.at(event), true, "pointer");
    };
    canvas.addEventListener("pointerup", drop);
    canvas.addEventListener("pointercancel", drop);
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect(),
      radius = (box.width * (SIZE / 2 - MARGIN)) / SIZE;
    const x = (event.clientX - box.left - box.width / 2) / radius,
      y = (box.top + box.height / 2 - event.clientY) / radius;
    return inDisk(x, y);
  }

  take(event) {
    const [x, y] = this.at(event),
      far = this.points.map(([u, v]) => Math.hypot(u - x, v - y));
    const nearest = far.indexOf(Math.min(...far)),
      { anywhere } = this.view;
    if (nearest < 0 || (!anywhere && far[nearest] * (SIZE / 2) > REACH)) return;
    this.chosen = nearest;
    this.dragging = true;
    this.canvas.focus({ preventScroll: true }); // or the point would slip from below the pointer
    this.canvas.setPointerCapture(event.pointerId);
    event.preventDefault();
    if (this.view.click) this.begun = [event.clientX, event.clientY]; // it may be a click
    else this.onDrag(nearest, anywhere ? [x, y] : this.points[nearest], false, "pointer");
  }

  // whether a pointer that was pressed has moved, where it might also click
  strayed({ clientX, clientY }) {
    if (this.begun && Math.hypot(clientX - this.begun[0], clientY - this.begun[1]) < CLICK) return false;
    this.begun = null;
    return true;
  }

  // ---- named lines ----

  nameLines() {
    const { canvas, tip } = this;
    let from = null;
    canvas.addEventListener("pointerdown", (event) => (from = [event.clientX, event.clientY]));
    canvas.addEventListener("pointermove", (event) => {
      const line = event.buttons ? null : this.lineAt(event);
      tip.hidden = !line;
      canvas.style.cursor = line ? "pointer" : "";
      if (!line) return;
      tip.textContent = line.words;
      Object.assign(tip.style, { left: `${event.offsetX}px`, top: `${event.offsetY}px` });
    });
    canvas.addEventListener("pointerleave", () => (tip.hidden = true));
    canvas.addEventListener("click", (event) => {
      const line = this.lineAt(event);
      if (line && Math.hypot(event.clientX - from[0], event.clientY - from[1]) < CLICK) this.onClick(line.label);
    });
  }

  // the named line below a pointer
  lineAt({ clientX, clientY }) {
    const box = this.canvas.getBoundingClientRect();
    let best = { far: REACH / 2 };
    for (const one of this.named) {
      for (const [x, y] of one.line) {
        const far = Math.hypot(box.left + x * box.width - clientX, box.top + y * box.height - clientY);
        if (far < best.far) best = { far, one };
      }
    }
    return best.one;
  }

  // lines of the disk by name: [{label, words, line: [[x, y], ...]}]
  name(list) {
    this.named = list.map((one) => ({ ...one, line: one.line.map(([x, y]) => [this.X(x) / SIZE, this.Y(y) / SIZE]) }));
  }

  key(event) {
    const size = STEP * (event.shiftKey ? 10 : 1),
      moves = { ArrowLeft: [-size, 0], ArrowRight: [size, 0], ArrowUp: [0, size], ArrowDown: [0, -size] };
    const turn = { PageDown: 1, PageUp: -1 }[event.key],
      move = moves[event.key],
      count = this.points.length;
    const press = (event.key === "Enter" || event.key === " ") && this.view.anywhere;
    if (!count || !(turn || move || press)) return;
    event.preventDefault();
    if (turn) {
      this.chosen = (this.chosen + turn + count) % count;
      this.onChoose();
      return;
    }
    const [x, y] = this.points[this.chosen];
    if (press) this.onDrag(this.chosen, [x, y], true, "press");
    else this.onDrag(this.chosen, inDisk(x + move[0], y + move[1]), true, "keys");
  }

  // ---- strokes ----

  // what is drawn from here on is seen between two parts of the width alone
  part(from, to) {
    const { pen } = this;
    pen.restore();
    pen.save();
    pen.beginPath();
    pen.rect(from * SIZE, 0, (to - from) * SIZE, SIZE);
    pen.clip();
  }

  X(x) {
    return SIZE / 2 + x * (SIZE / 2 - MARGIN);
  }
  Y(y) {
    return SIZE / 2 - y * (SIZE / 2 - MARGIN);
  }

  clear() {
    this.pen.fillStyle = "white";
    this.pen.fillRect(0, 0, SIZE, SIZE);
  }

  // a circle about a point, its radius in pixels
  arc([x, y], radius) {
    this.pen.beginPath();
    this.pen.arc(this.X(x), this.Y(y), radius, 0, 7);
  }

  // an empty disk
  disk() {
    this.clear();
    this.circle();
  }

  circle() {
    this.ring([0, 0], 1, COLOURS.ink, 1);
  }

  // a canvas that covers the square around the disk; to: where a point of it goes
  raster(image, to) {
    const [left, top] = to([-1, 1]),
      [right, bottom] = to([1, -1]);
    this.pen.drawImage(image, this.X(left), this.Y(top), this.X(right) - this.X(left), this.Y(bottom) - this.Y(top));
  }

  stroke(colour, width = 1, dash = []) {
    Object.assign(this.pen, { strokeStyle: colour, lineWidth: width });
    this.pen.setLineDash(dash);
    this.pen.stroke();
    this.pen.setLineDash([]);
  }

  path(points) {
    points.forEach(([x, y], k) => this.pen[k ? "lineTo" : "moveTo"](this.X(x), this.Y(y)));
  }

  // lines: arrays of [x, y]
  lines(lines, colour, width = 0.8, dash = []) {
    this.pen.beginPath();
    lines.forEach((line) => this.path(line));
    this.stroke(colour, width, dash);
  }

  // a triangle, or any polygon
  face(corners, colour) {
    this.pen.beginPath();
    this.path(corners);
    this.pen.closePath();
    this.pen.fillStyle = colour;
    this.pen.fill();
    this.stroke(colour, 1);
  }

  dot(point, colour, radius = 4) {
    this.arc(point, radius);
    this.pen.fillStyle = colour;
    this.pen.fill();
    this.stroke("black", 0.7);
  }

  square([x, y], colour, half = 4, width = 1.6) {
    this.pen.strokeStyle = colour;
    this.pen.lineWidth = width;
    this.pen.strokeRect(this.X(x) - half, this.Y(y) - half, 2 * half, 2 * half);
  }

  // a ring around the point that the keys would move
  mark() {
    const point = this.points[this.chosen];
    if (!point) return;
    this.arc(point, 9);
    this.stroke(COLOURS.ink, 1.2, [3, 2]);
  }

  // a circle of the disk: what the brush covers
  ring(point, radius, colour, width = 1.5) {
    this.arc(point, radius * (SIZE / 2 - MARGIN));
    this.stroke(colour, width);
  }

  words(text, x, y, align = "left") {
    Object.assign(this.pen, { fillStyle: COLOURS.ink, font: "15px sans-serif", textAlign: align });
    this.pen.fillText(text, x, y);
  }
}

export function inDisk(x, y, most = 0.98) {
  const shrink = Math.max(1, Math.hypot(x, y) / most);
  return [x / shrink, y / shrink];
}

// canvases side by side on one
export function sheetOf(canvases, gap = 20) {
  const sheet = make("canvas", {
    width: canvases.reduce((sum, canvas) => sum + canvas.width + gap, -gap),
    height: Math.max(...canvases.map((canvas) => canvas.height)),
  });
  const pen = sheet.getContext("2d");
  pen.fillStyle = "white";
  pen.fillRect(0, 0, sheet.width, sheet.height);
  canvases.reduce((at, canvas) => {
    pen.drawImage(canvas, at, 0);
    return at + canvas.width + gap;
  }, 0);
  return sheet;
}
