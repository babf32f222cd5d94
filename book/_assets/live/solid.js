// A surface in 3-D on one WebGL canvas, with tubes upon it, to be turned by mouse, finger and arrow keys.
import { Picture } from "./picture.js";
import { cross, minus, normalsOf, unit } from "./triangles.js";

const SIZE = [560, 420],
  SIDES = 6; // of a tube
const TURN = 5; // degrees an arrow key turns, three times with shift
const VERTEX = `
attribute vec3 place, unfolded, normal, unfoldedNormal, colour;
uniform vec3 middle, right, up, eye; uniform vec2 scale; uniform float share;
varying vec3 shown, way;
void main() {
  vec3 p = mix(place, unfolded, share) - middle;
  gl_Position = vec4(dot(p, right) * scale.x, dot(p, up) * scale.y, -dot(p, eye) * 0.4 * min(scale.x, scale.y), 1.0);
  way = mix(normal, unfoldedNormal, share); shown = colour;
}`;
const FRAGMENT = `
precision highp float;
uniform vec3 eye; varying vec3 shown, way;
void main() { gl_FragColor = vec4(shown * (0.3 + 0.75 * max(dot(normalize(way), eye), 0.0)), 1.0); }`;
const PARTS = { place: 3, unfolded: 3, normal: 3, unfoldedNormal: 3, colour: 3 };

export class Solid extends Picture {
  // view: name, label, drag(state, index, [turn, tilt] in degrees) -> part of a state
  constructor(view, title) {
    super(view, title);
    this.buffers = {};
    this.canvas.className = "qc-live-solid";
  }

  get size() {
    return SIZE;
  }

  begin() {
    this.pen = this.canvas.getContext("webgl", { preserveDrawingBuffer: true, antialias: true });
    if (!this.pen) throw new Error("the browser offers no WebGL, which a surface in 3-D needs");
    const { pen } = this,
      program = pen.createProgram();
    for (const [kind, source] of Object.entries({ VERTEX_SHADER: VERTEX, FRAGMENT_SHADER: FRAGMENT })) {
      const shader = pen.createShader(pen[kind]);
      pen.shaderSource(shader, source);
      pen.compileShader(shader);
      pen.attachShader(program, shader);
    }
    pen.linkProgram(program);
    pen.useProgram(program);
    pen.enable(pen.DEPTH_TEST);
    pen.clearColor(0, 0, 0, 0); // the page's ground
    pen.getExtension("OES_element_index_uint");
    this.place = (name) => pen.getUniformLocation(program, name);
    this.slots = Object.fromEntries(Object.keys(PARTS).map((name) => [name, pen.getAttribLocation(program, name)]));
  }

  handles() {}

  // ---- turning ----

  listen() {
    const { canvas } = this;
    canvas.setAttribute("aria-roledescription", "surface in 3-D: arrow keys turn it");
    let from = null;
    canvas.addEventListener("pointerdown", (event) => {
      from = [event.clientX, event.clientY];
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      event.preventDefault();
    });
    const turn = (event, settled) => {
      if (!from) return;
      const box = canvas.getBoundingClientRect(),
        angles = [((from[0] - event.clientX) / box.width) * 180, ((event.clientY - from[1]) / box.height) * 180];
      from = settled ? null : [event.clientX, event.clientY];
      this.onDrag(0, angles, settled, "pointer");
    };
    canvas.addEventListener("pointermove", (event) => turn(event, false));
    canvas.addEventListener("pointerup", (event) => turn(event, true));
    canvas.addEventListener("pointercancel", (event) => turn(event, true));
    canvas.addEventListener("keydown", (event) => {
      const size = TURN * (event.shiftKey ? 3 : 1),
        move = { ArrowLeft: [size, 0], ArrowRight: [-size, 0], ArrowUp: [0, size], ArrowDown: [0, -size] }[event.key];
      if (!move) return;
      event.preventDefault();
      this.onDrag(0, move, true, "keys");
    });
  }

  // ---- drawing ----

  // vertices, unfolded (3 V), faces (3 F), colour (3 V) 0 to 1, away: the direction that is seen first; whole: points that
  // the picture has room for
  surface({ vertices, unfolded, faces, colour, away }, whole = vertices) {
    this.away = away;
    this.middle = middleOf(whole);
    this.radius = 1.02 * Math.max(...[whole, unfolded].map((points) => farthest(points, this.middle)));
    const [normal, unfoldedNormal] = [vertices, unfolded].map((points) => normalsOf(points, faces).normals);
    this.normals = { normal, unfoldedNormal };
    this.keep("surface", { place: vertices, unfolded, ...this.normals, colour }, faces);
  }

  // lists of {points, ways: [[x, y, z], ...], colour: [r, g, b], radius}: centres in mm, and which way is off the surface
  tubes(list) {
    const parts = { place: [], normal: [], colour: [] },
      faces = [];
    for (const one of list) tube(one, parts, faces);
    const place = Float32Array.from(parts.place),
      normal = Float32Array.from(parts.normal);
    const colour = Float32Array.from(parts.colour);
    this.keep("tubes", { place, unfolded: place, normal, unfoldedNormal: normal, colour }, faces);
  }

  // other colours of the surface
  recolour(colour) {
    this.pen.bindBuffer(this.pen.ARRAY_BUFFER, this.buffers.surface.parts.colour);
    this.pen.bufferData(this.pen.ARRAY_BUFFER, colour, this.pen.STATIC_DRAW);
  }

  // what is drawn from here on is seen between two parts of the width alone
  part(from, to) {
    const { pen, canvas } = this;
    pen.enable(pen.SCISSOR_TEST);
    pen.scissor(Math.round(from * canvas.width), 0, Math.round((to - from) * canvas.width), canvas.height);
  }

  // where a point is seen, in parts of the canvas, after `draw`; ways: which way is off the surface; those seen from behind go
  name(list) {
    const { right, up, eye, scale } = this.seen,
      dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    this.named = list.map(({ points, ways, ...one }) => ({
      ...one,
      line: points
        .filter((_, i) => dot(ways[i], eye) > 0)
        .map((point) => minus(point, this.middle))
        .map((p) => [0.5 + (dot(p, right) * scale[0]) / 2, 0.5 - (dot(p, up) * scale[1]) / 2]),
    }));
  }

  keep(name, arrays, faces) {
    const { pen } = this,
      kept = (this.buffers[name] ??= { corners: pen.createBuffer(), parts: {} });
    for (const part of Object.keys(PARTS)) {
      kept.parts[part] ??= pen.createBuffer();
      pen.bindBuffer(pen.ARRAY_BUFFER, kept.parts[part]);
      pen.bufferData(pen.ARRAY_BUFFER, arrays[part], pen.STATIC_DRAW);
    }
    pen.bindBuffer(pen.ELEMENT_ARRAY_BUFFER, kept.corners);
    pen.bufferData(pen.ELEMENT_ARRAY_BUFFER, Uint32Array.from(faces), pen.STATIC_DRAW);
    kept.count = faces.length;
  }

  // turn, tilt: degrees; zoom: 1 shows all; share: how far unfolded
  draw({ turn, tilt, zoom, share }) {
    const { pen, canvas } = this,
      a = Math.atan2(this.away[1], this.away[0]) + (turn * Math.PI) / 180,
      b = (tilt * Math.PI) / 180;
    const right = [-Math.sin(a), Math.cos(a), 0],
      eye = [Math.cos(a) * Math.cos(b), Math.sin(a) * Math.cos(b), Math.sin(b)];
    const up = [-Math.cos(a) * Math.sin(b), -Math.sin(a) * Math.sin(b), Math.cos(b)],
      scale = zoom / this.radius;
    pen.viewport(0, 0, canvas.width, canvas.height);
    pen.clear(pen.COLOR_BUFFER_BIT | pen.DEPTH_BUFFER_BIT);
    const given = { middle: this.middle, right, up, eye };
    for (const [name, value] of Object.entries(given)) pen.uniform3fv(this.place(name), value);
    this.seen = { right, up, eye, scale: [(scale * canvas.height) / canvas.width, scale] };
    pen.uniform2f(this.place("scale"), ...this.seen.scale);
    for (const [name, { parts, corners, count }] of Object.entries(this.buffers)) {
      pen.uniform1f(this.place("share"), name === "surface" ? share : 0);
      for (const part of Object.keys(PARTS)) {
        pen.bindBuffer(pen.ARRAY_BUFFER, parts[part]);
        pen.enableVertexAttribArray(this.slots[part]);
        pen.vertexAttribPointer(this.slots[part], PARTS[part], pen.FLOAT, false, 0, 0);
      }
      pen.bindBuffer(pen.ELEMENT_ARRAY_BUFFER, corners);
      pen.drawElements(pen.TRIANGLES, count, pen.UNSIGNED_INT, 0);
    }
  }
}

// the state of a surface that is turned by [turn, tilt] degrees
export const turned = (state, index, [turn, tilt]) => ({
  turn: ((state.turn + turn + 540) % 360) - 180,
  tilt: Math.min(90, Math.max(-90, state.tilt + tilt)),
});

// ---- geometry ----

// the middle of the box around points (3 V), and how far they reach from it, seen from any side of a picture of 4 to 3
function middleOf(points) {
  const low = [Infinity, Infinity, Infinity],
    high = [-Infinity, -Infinity, -Infinity];
  points.forEach((c, i) => {
    low[i % 3] = Math.min(low[i % 3], c);
    high[i % 3] = Math.max(high[i % 3], c);
  });
  return low.map((c, k) => (c + high[k]) / 2);
}

function farthest(points, [x, y, z]) {
  let most = 0;
  for (let i = 0; i < points.length; i += 3) {
    const across = 0.75 * Math.hypot(points[i] - x, points[i + 1] - y);
    most = Math.max(most, Math.abs(points[i + 2] - z), across);
  }
  return most;
}

// rings of SIDES corners about the points of a line, joined by triangles
function tube({ points, ways, colour, radius }, { place, normal, colour: colours }, faces) {
  const first = place.length / 3;
  points.forEach((point, k) => {
    const along = unit(minus(points[Math.min(k + 1, points.length - 1)], points[Math.max(k - 1, 0)])),
      side = unit(cross(along, ways[k])),
      off = cross(side, along);
    for (let j = 0; j < SIDES; j++) {
      const c = Math.cos((2 * Math.PI * j) / SIDES),
        s = Math.sin((2 * Math.PI * j) / SIDES),
        way = [0, 1, 2].map((i) => c * off[i] + s * side[i]);
      normal.push(...way);
      place.push(...way.map((w, i) => point[i] + radius * w));
      colours.push(...colour);
      if (k + 1 === points.length) continue;
      const a = first + k * SIDES + j,
        b = first + k * SIDES + ((j + 1) % SIDES);
      faces.push(a, b, a + SIDES, b, b + SIDES, a + SIDES);
    }
  });
}
