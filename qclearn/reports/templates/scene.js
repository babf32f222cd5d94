// A surface with maps on it, to be turned by mouse, finger and keys; what it shows stands as JSON in the page.
"use strict";
{
  const VERTEX = `
    attribute vec3 place, normal; attribute float tone;
    uniform mat3 turn; uniform vec2 size;
    varying float shown; varying vec3 way;
    void main() {
      vec3 p = turn * place;
      gl_Position = vec4(p.xy * size, -0.5 * p.z, 1.0);
      way = turn * normal; shown = tone;
    }`;
  const FRAGMENT = `
    precision mediump float;
    uniform sampler2D colours; varying float shown; varying vec3 way;
    void main() {
      vec3 colour = gl_FrontFacing ? texture2D(colours, vec2(shown * 0.984375 + 0.0078125, 0.5)).rgb : vec3(0.55, 0.52, 0.49);
      gl_FragColor = vec4(colour * (0.55 + 0.45 * abs(normalize(way).z)), 1.0);
    }`;
  const STEP = Math.PI / 24; // an arrow key turns so far
  const data = JSON.parse(document.getElementById("data").textContent),
    canvas = document.getElementById("scene"),
    viewer = canvas.closest(".viewer"),
    gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const begin = { turn: 0, tilt: 0, zoom: 1 };
  let state = { ...begin };

  // the sum of the faces' normals around each vertex
  function normalsOf(places, faces) {
    const normals = new Float32Array(places.length);
    for (let i = 0; i < faces.length; i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => 3 * faces[i + k]),
        u = [0, 1, 2].map((k) => places[b + k] - places[a + k]),
        v = [0, 1, 2].map((k) => places[c + k] - places[a + k]);
      for (let k = 0; k < 3; k++) {
        const across = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
        for (const corner of [a, b, c]) normals[corner + k] += across;
      }
    }
    return normals;
  }

  function build() {
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    const places = Float32Array.from(new Int16Array(bytes(data.places).buffer), (x) => x / 32767),
      faces = new Uint16Array(bytes(data.faces).buffer);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    const slot = (name, array, width, type, scaled) => {
      const place = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, array, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, width, type, scaled, 0, 0);
    };
    slot("place", places, 3, gl.FLOAT, false);
    slot("normal", normalsOf(places, faces), 3, gl.FLOAT, false);
    const uniform = (name) => gl.getUniformLocation(program, name);
    return { slot, count: faces.length, turn: uniform("turn"), size: uniform("size") };
  }

  function show(map) {
    const colours = bytes(map.colours),
      stops = [0, 9, 18, 27, 36, 45, 54, 63].map((k) => `rgb(${colours.subarray(3 * k, 3 * k + 3).join()})`);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, colours.length / 3, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, colours);
    scene.slot("tone", bytes(map.tones), 1, gl.UNSIGNED_BYTE, true);
    viewer.querySelector(".low").textContent = map.ends[0].replace("-", "−");
    viewer.querySelector(".high").textContent = map.ends[1];
    viewer.querySelector(".unit").textContent = map.unit;
    viewer.querySelector(".ramp").style.background = `linear-gradient(to right, ${stops})`;
    draw();
  }

  function draw() {
    const [a, b, c, d] = [Math.cos(state.turn), Math.sin(state.turn), Math.cos(state.tilt), Math.sin(state.tilt)],
      rows = [[a, 0, b], [d * b, c, -d * a], [-c * b, d, c * a]],
      [wide, high] = [canvas.clientWidth, canvas.clientHeight].map((n) => Math.round(n * devicePixelRatio)),
      scale = Math.min(wide / data.half[0], high / data.half[1]) / 2 * state.zoom;
    if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
    gl.viewport(0, 0, wide, high);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const turn = [0, 1, 2].flatMap((k) => rows.map((row) => row.reduce((sum, r, i) => sum + r * data.view[i][k], 0)));
    gl.uniformMatrix3fv(scene.turn, false, turn);
    gl.uniform2f(scene.size, (2 * scale) / wide, (2 * scale) / high);
    gl.drawElements(gl.TRIANGLES, scene.count, gl.UNSIGNED_SHORT, 0);
  }

  function move({ turn = 0, tilt = 0, zoom = 1 }) {
    state.turn += turn;
    state.tilt = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, state.tilt + tilt));
    state.zoom = Math.max(0.5, Math.min(8, state.zoom * zoom));
    draw();
  }

  function listen() {
    const keys = {
      ArrowLeft: { turn: -STEP }, ArrowRight: { turn: STEP }, ArrowUp: { tilt: -STEP }, ArrowDown: { tilt: STEP },
      "+": { zoom: 1.2 }, "=": { zoom: 1.2 }, "-": { zoom: 1 / 1.2 },
    };
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in keys || event.key === "0")) return;
      event.preventDefault();
      if (event.key === "0") state = { ...begin };
      move(keys[event.key] ?? {});
    });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) move({ turn: event.movementX / 150, tilt: event.movementY / 150 });
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      move({ zoom: Math.exp(-event.deltaY / 600) });
    }, { passive: false });
    new ResizeObserver(draw).observe(canvas);
  }

  const scene = gl && build();
  if (scene) {
    data.maps.forEach((map, k) => {
      const label = document.createElement("label"),
        choice = Object.assign(document.createElement("input"), { type: "radio", name: "map", checked: k === 0 });
      choice.addEventListener("change", () => show(map));
      label.append(choice, map.label);
      viewer.querySelector(".maps").append(label);
    });
    show(data.maps[0]);
    listen();
  } else {
    viewer.replaceChildren("This browser offers no WebGL, which the surface in 3-D needs; the pictures above show the same maps.");
  }
}
