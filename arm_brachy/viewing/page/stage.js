// Draws the shapes of arm_brachy.viewing in a canvas and plays films of them. WebGL 1, no library,
// no request. Coordinates come as whole multiples of film.unit; z is up.
'use strict';

const STAGE_VERTEX = `
attribute vec3 place; attribute vec3 normal; attribute vec3 tint;
uniform mat4 model, view; uniform vec4 colour; uniform float tinted, dot;
varying vec3 across; varying vec4 shade;
void main() {
  gl_Position = view * model * vec4(place, 1.0);
  gl_PointSize = dot;
  across = mat3(model[0].xyz, model[1].xyz, model[2].xyz) * normal;
  shade = vec4(mix(colour.rgb, tint, tinted), colour.a);
}`;
const STAGE_FRAGMENT = `
precision mediump float;
varying vec3 across; varying vec4 shade;
uniform vec3 light; uniform float lit;
void main() {
  float facing = abs(dot(normalize(across + vec3(1e-9)), light));
  gl_FragColor = vec4(shade.rgb * mix(1.0, 0.45 + 0.55 * facing, lit), shade.a);
}`;
const SEGMENTS = 16, HEAD = 2.0, HEAD_LENGTH = 3.0, LOST = 0.35;   // of an arrow, in its shaft's widths

// --- 4 x 4 matrices, column by column, and vectors.
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                         a[0] * b[1] - a[1] * b[0]];
const length = a => Math.hypot(a[0], a[1], a[2]);
const unit = a => { const l = length(a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };
const product = (a, b) => { const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++)
    for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out; };
const posed = (x, y, z, p) => new Float32Array([...x, 0, ...y, 0, ...z, 0, ...p, 1]);
const IDENTITY = posed([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]);
const scaled = (v, s) => [v[0] * s, v[1] * s, v[2] * s];

function along(a, b, width) {    // a unit cylinder or cone from a to b
  const z = minus(b, a), e = unit(z);
  const x = unit(cross(Math.abs(e[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], e)), y = cross(e, x);
  return posed(scaled(x, width), scaled(y, width), z, scaled([a[0] + b[0], a[1] + b[1],
                                                              a[2] + b[2]], 0.5));
}

// --- unit bodies about the origin: places, normals, corner numbers.
function sphere() {
  const place = [], index = [], rings = SEGMENTS / 2;
  for (let i = 0; i <= rings; i++) for (let j = 0; j <= SEGMENTS; j++) {
    const u = Math.PI * i / rings, v = 2 * Math.PI * j / SEGMENTS;
    place.push(0.5 * Math.sin(u) * Math.cos(v), 0.5 * Math.sin(u) * Math.sin(v), 0.5 * Math.cos(u));
    if (i < rings && j < SEGMENTS) {
      const a = i * (SEGMENTS + 1) + j, b = a + SEGMENTS + 1;
      index.push(a, b, a + 1, b, b + 1, a + 1);
    }
  }
  return {place, normal: place, index};
}
function turned(top) {           // cylinder (top 0.5) or cone (top 0), z from -0.5 to 0.5
  const place = [], normal = [], index = [];
  const ring = (r, z, n) => { for (let j = 0; j <= SEGMENTS; j++) {
    const v = 2 * Math.PI * j / SEGMENTS, c = Math.cos(v), s = Math.sin(v);
    place.push(r * c, r * s, z); normal.push(...(n || [c, s, 0.5 - top])); } };
  ring(0.5, -0.5); ring(top, 0.5); ring(0.5, -0.5, [0, 0, -1]); ring(top, 0.5, [0, 0, 1]);
  const w = SEGMENTS + 1;
  for (let j = 0; j < SEGMENTS; j++) {
    index.push(j, j + 1, w + j, w + j, j + 1, w + j + 1);
    for (const base of [2 * w, 3 * w]) if (j > 0) index.push(base, base + j, base + j + 1);
  }
  return {place, normal, index};
}
function box() {
  const place = [], normal = [], index = [];
  for (let axis = 0; axis < 3; axis++) for (const side of [-0.5, 0.5]) {
    const n = [0, 0, 0]; n[axis] = 2 * side;
    const first = place.length / 3;
    for (const [u, v] of [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) {
      const p = [0, 0, 0]; p[axis] = side; p[(axis + 1) % 3] = u; p[(axis + 2) % 3] = v;
      place.push(...p); normal.push(...n);
    }
    index.push(first, first + 1, first + 2, first, first + 2, first + 3);
  }
  return {place, normal, index};
}

class Stage {
  constructor(root, film) {
    this.film = film; this.hidden = new Set(); this.shapes = [];
    this.canvas = root.querySelector('canvas.solid');
    this.paper = root.querySelector('canvas.names');
    const gl = this.gl = this.canvas.getContext('webgl', {antialias: true, alpha: false,
                                                          preserveDrawingBuffer: true});
    if (!gl) { root.classList.add('blind'); return; }
    this.program(); this.bodies = {};
    for (const [name, body] of [['sphere', sphere()], ['cylinder', turned(0.5)],
                                ['cone', turned(0)], ['box', box()]]) this.bodies[name] =
      {place: this.buffer(body.place), normal: this.buffer(body.normal),
       index: this.corners(body.index), count: body.index.length};
    this.changing = {place: gl.createBuffer(), normal: gl.createBuffer(), tint: gl.createBuffer()};
    this.surfaces = []; this.hear(film.meshes);
    this.turn = -0.6; this.lift = 0.45;
    this.handle();
  }
  program() {
    const gl = this.gl, p = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, STAGE_VERTEX],
                                [gl.FRAGMENT_SHADER, STAGE_FRAGMENT]]) {
      const s = gl.createShader(kind); gl.shaderSource(s, text); gl.compileShader(s);
      gl.attachShader(p, s);
    }
    gl.linkProgram(p); gl.useProgram(p);
    this.at = name => gl.getAttribLocation(p, name);
    this.given = {};
    for (const name of ['model', 'view', 'colour', 'tinted', 'dot', 'light', 'lit'])
      this.given[name] = gl.getUniformLocation(p, name);
    this.slots = {place: this.at('place'), normal: this.at('normal'), tint: this.at('tint')};
    gl.enable(gl.DEPTH_TEST); gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
  hear(meshes) {                   // those of a frame that stands alone take the place of the old
    for (const old of this.surfaces) this.gl.deleteBuffer(old.index);
    this.surfaces = meshes.map(m => ({list: m, index: this.corners(m)}));
  }
  buffer(values) { const gl = this.gl, b = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, b);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.STATIC_DRAW); return b; }
  corners(values) { const gl = this.gl, b = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, b);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(values), gl.STATIC_DRAW); return b; }
  attribute(name, buffer) { const gl = this.gl, slot = this.slots[name];
    if (slot < 0) return;
    if (!buffer) { gl.disableVertexAttribArray(slot); return; }
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.enableVertexAttribArray(slot);
    gl.vertexAttribPointer(slot, 3, gl.FLOAT, false, 0, 0); }
  upload(name, values) { const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.changing[name]);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    this.attribute(name, this.changing[name]); }

  points(shape) {                  // [[x, y, z], ...] in m
    const out = [], p = shape.p, u = this.film.unit;
    for (let i = 0; i < p.length; i += 3) out.push([p[i] * u, p[i + 1] * u, p[i + 2] * u]);
    return out;
  }
  show(shapes) { this.shapes = shapes; if (!this.target) this.look(); this.draw(); }
  look() {                         // the camera at all that there is, without the arm's length
    const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
    const some = this.shapes.filter(s => s.m !== undefined && s.h);
    for (const s of some.length ? some : this.shapes) for (const p of this.points(s))
      for (let k = 0; k < 3; k++) { low[k] = Math.min(low[k], p[k]); high[k] = Math.max(high[k], p[k]); }
    if (low[0] > high[0]) return;
    this.target = [0, 1, 2].map(k => (low[k] + high[k]) / 2);
    this.far = Math.max(1e-3, 1.45 * length(minus(high, low)));
  }
  eye() {
    const c = Math.cos(this.lift);
    return [this.target[0] + this.far * c * Math.sin(this.turn),
            this.target[1] - this.far * c * Math.cos(this.turn),
            this.target[2] + this.far * Math.sin(this.lift)];
  }
  camera() {
    const eye = this.eye(), z = unit(minus(eye, this.target));
    const x = unit(cross([0, 0, 1], z)), y = cross(z, x);
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const view = new Float32Array([x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0,
                                   -dot(x, eye), -dot(y, eye), -dot(z, eye), 1]);
    const near = this.far / 50, far = this.far * 10, f = 1 / Math.tan(0.35);
    const aspect = this.canvas.width / this.canvas.height;
    const lens = new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0,
                                   (far + near) / (near - far), -1, 0, 0,
                                   2 * far * near / (near - far), 0]);
    this.axes = [x, y, z];
    return product(lens, view);
  }
  resize() {
    const ratio = window.devicePixelRatio || 1;
    for (const c of [this.canvas, this.paper]) {
      const w = Math.round(c.clientWidth * ratio), h = Math.round(c.clientHeight * ratio);
      if (c.width !== w || c.height !== h) { c.width = w; c.height = h; }
    }
  }
  draw() {
    const gl = this.gl;
    if (!gl || !this.target) return;
    this.resize();
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0.975, 0.98, 0.985, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const view = this.seen = this.camera();
    gl.uniformMatrix4fv(this.given.view, false, view);
    const [x, y, z] = this.axes;
    gl.uniform3fv(this.given.light, unit([x[0] * .3 + y[0] * .4 + z[0], x[1] * .3 + y[1] * .4 + z[1],
                                          x[2] * .3 + y[2] * .4 + z[2]]));
    const shown = this.shapes.filter(s => !this.hidden.has(this.film.layers[s.l]));
    gl.depthMask(true); gl.disable(gl.CULL_FACE);
    for (const s of shown) if (s.c[3] >= 1 && s.k !== 'text') this.solid(s);
    gl.depthMask(false); gl.enable(gl.CULL_FACE);
    for (const s of shown) if (s.c[3] < 1) for (const side of [gl.FRONT, gl.BACK]) {
      if (s.k === 'triangles' && !s.h) gl.disable(gl.CULL_FACE); else gl.enable(gl.CULL_FACE);
      gl.cullFace(side);
      this.solid(s);
      if (s.k === 'triangles' && !s.h) break;
    }
    gl.depthMask(true);
    this.write(shown.filter(s => s.k === 'text'));
  }
  solid(s) {
    const gl = this.gl, u = this.film.unit, size = (s.z || 0) * u;
    gl.uniform4fv(this.given.colour, s.c); gl.uniform1f(this.given.tinted, s.h ? 1 : 0);
    gl.uniform1f(this.given.lit, s.k === 'dots' || (s.m !== undefined && !s.h) ? 0 : 1);
    gl.uniform1f(this.given.dot, 2.5 * (window.devicePixelRatio || 1));
    if (s.k === 'triangles') return this.surface(s);
    const p = this.points(s);
    if (s.k === 'dots') return this.dots(p);
    if (s.k === 'spheres') for (const c of p)
      this.body('sphere', posed([size, 0, 0], [0, size, 0], [0, 0, size], c));
    if (s.k === 'line') for (let i = 1; i < p.length; i++)
      this.body('cylinder', along(p[i - 1], p[i], size));
    if (s.k === 'arrow') this.arrow(p[0], p[1], size);
    const name = {disc: 'cylinder', ellipsoid: 'sphere', box: 'box'}[s.k];
    if (name) { const a = s.a, d = s.d.map(v => v * u);
      this.body(name, posed(scaled([a[0], a[3], a[6]], d[0]), scaled([a[1], a[4], a[7]], d[1]),
                            scaled([a[2], a[5], a[8]], d[2]), p[0])); }
  }
  arrow(a, b, size) {
    const all = length(minus(b, a)), head = Math.min(HEAD_LENGTH * size, LOST * all);
    const neck = [0, 1, 2].map(k => b[k] - (b[k] - a[k]) * head / (all || 1));
    this.body('cylinder', along(a, neck, size)); this.body('cone', along(neck, b, HEAD * size));
  }
  body(name, model) {
    const gl = this.gl, b = this.bodies[name];
    gl.uniformMatrix4fv(this.given.model, false, model);
    this.attribute('place', b.place); this.attribute('normal', b.normal); this.attribute('tint');
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, b.index);
    gl.drawElements(gl.TRIANGLES, b.count, gl.UNSIGNED_SHORT, 0);
  }
  dots(p) {
    this.gl.uniformMatrix4fv(this.given.model, false, IDENTITY);
    this.upload('place', new Float32Array(p.flat()));
    this.attribute('normal'); this.attribute('tint');
    this.gl.drawArrays(this.gl.POINTS, 0, p.length);
  }
  surface(s) {
    const gl = this.gl, mesh = this.surfaces[s.m], list = mesh.list, u = this.film.unit;
    const place = Float32Array.from(s.p, v => v * u), normal = new Float32Array(place.length);
    const corner = k => [place[3 * k], place[3 * k + 1], place[3 * k + 2]];
    for (let i = 0; i < list.length; i += 3) {
      const a = corner(list[i]), n = cross(minus(corner(list[i + 1]), a),
                                           minus(corner(list[i + 2]), a));
      for (let j = 0; j < 3; j++) for (let k = 0; k < 3; k++) normal[3 * list[i + j] + k] += n[k];
    }
    const tint = new Float32Array(place.length);
    if (s.h) for (let i = 0; i < s.h.length; i++)
      tint.set(this.film.palette[parseInt(s.h[i], 32)], 3 * i);
    gl.uniformMatrix4fv(this.given.model, false, IDENTITY);
    this.upload('place', place); this.upload('normal', normal); this.upload('tint', tint);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.index);
    gl.drawElements(gl.TRIANGLES, list.length, gl.UNSIGNED_SHORT, 0);
    if (s.h) this.drawn = place;             // what a test, or a person at the console, looks at
  }
  write(texts) {
    const ink = this.paper.getContext('2d'), m = this.seen, ratio = window.devicePixelRatio || 1;
    ink.clearRect(0, 0, this.paper.width, this.paper.height);
    ink.font = `${12 * ratio}px system-ui, sans-serif`; ink.lineWidth = 3 * ratio;
    ink.strokeStyle = 'rgba(255,255,255,.85)';
    for (const s of texts) {
      const [x, y, z] = this.points(s)[0];
      const w = m[3] * x + m[7] * y + m[11] * z + m[15];
      const h = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w;
      const v = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
      const at = [(h + 1) / 2 * this.paper.width, (1 - v) / 2 * this.paper.height];
      ink.fillStyle = `rgb(${s.c.slice(0, 3).map(c => Math.round(200 * c)).join(',')})`;
      ink.strokeText(s.x, ...at); ink.fillText(s.x, ...at);
    }
  }
  handle() {
    let from = null;
    const again = () => requestAnimationFrame(() => this.draw());
    this.paper.addEventListener('pointerdown', e => { from = e; this.paper.setPointerCapture(e.pointerId); });
    this.paper.addEventListener('pointerup', () => { from = null; });
    this.paper.addEventListener('pointermove', e => {
      if (!from) return;
      const dx = e.clientX - from.clientX, dy = e.clientY - from.clientY; from = e;
      if (e.shiftKey || e.buttons === 2) {
        const step = this.far / this.paper.clientHeight * 0.75, [x, y] = this.axes;
        this.target = this.target.map((t, k) => t - step * (dx * x[k] - dy * y[k]));
      } else {
        this.turn -= 0.008 * dx;
        this.lift = Math.min(1.55, Math.max(-1.55, this.lift + 0.008 * dy));
      }
      again();
    });
    this.paper.addEventListener('contextmenu', e => e.preventDefault());
    this.paper.addEventListener('wheel', e => { e.preventDefault();
      this.far *= Math.exp(0.001 * e.deltaY); again(); }, {passive: false});
    new ResizeObserver(again).observe(this.canvas);
  }
}

// A stage with a slider, a button, a legend and a list of layers; returns {stage, show, film}.
function playFilm(root, film, hear) {
  const stage = new Stage(root, film), slider = root.querySelector('input[type=range]');
  const clock = root.querySelector('output'), button = root.querySelector('button.play');
  let now = -1, timer = null;
  function show(k) {
    now = Math.max(0, Math.min(film.frames.length - 1, Math.round(k)));
    const [t, shapes] = film.frames[now];
    slider.value = now; clock.textContent = `t = ${t.toFixed(2)} s`;
    stage.show(shapes.map(i => film.shapes[i]));
    if (hear) hear(t, now);
  }
  function play() {
    if (timer) { cancelAnimationFrame(timer); timer = null; button.textContent = 'Play'; return; }
    button.textContent = 'Pause';
    if (now === film.frames.length - 1) now = 0;
    let began = performance.now(), from = film.frames[now][0];
    const step = () => {
      const t = from + (performance.now() - began) / 1000;
      let k = now;
      while (k < film.frames.length - 1 && film.frames[k + 1][0] <= t) k++;
      if (k !== now) show(k);
      if (k === film.frames.length - 1) { timer = 1; play(); return; }
      timer = requestAnimationFrame(step);
    };
    slider.addEventListener('input', () => { began = performance.now(); from = film.frames[now][0]; });
    timer = requestAnimationFrame(step);
  }
  if (slider) {
    slider.max = Math.max(0, film.frames.length - 1);
    slider.addEventListener('input', () => show(+slider.value));
    button.addEventListener('click', play);
  }
  listLayers(root, film, stage);
  if (film.frames.length) show(film.start || 0);
  return {stage, show, film, frame: () => now};
}
function listLayers(root, film, stage) {
  const list = root.querySelector('.layers'), known = new Set();
  stage.list = () => { for (const layer of film.layers) {
    if (known.has(layer)) continue;
    known.add(layer);
    const label = document.createElement('label'), tick = document.createElement('input');
    tick.type = 'checkbox'; tick.checked = true;
    tick.addEventListener('change', () => {
      if (tick.checked) stage.hidden.delete(layer); else stage.hidden.add(layer);
      stage.draw(); });
    label.append(tick, ` ${layer}`); list.append(label);
  } };
  stage.list();
  const bar = root.querySelector('.legend i');
  bar.style.background = `linear-gradient(to right, ${film.palette.map(
    c => `rgb(${c.map(v => Math.round(255 * v)).join(',')})`).join(',')})`;
  root.querySelector('.legend b').textContent = `${(1e3 * film.full_colour).toPrecision(2)} mm`;
}
