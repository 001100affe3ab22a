"use strict";
// A small three-dimensional viewer on a 2-D canvas: about a thousand faces, sorted from back to front, need no WebGL.
class StructureView {
  static VIEWS = { iso: [-0.62, 0.42], x: [Math.PI / 2, 0], y: [Math.PI, 0], z: [0, Math.PI / 2] };
  // from grey (still) to dark red (moving most): lightness falls all the way, so every colour vision reads it
  static SCALE = ["#d5dce4", "#e6d3b3", "#f1c27a", "#ee9f4a", "#dd7429", "#bd4a18", "#8c2a0f"];

  constructor(figure, css) {
    this.css = css;
    this.canvas = figure.querySelector("canvas");
    this.pen = this.canvas.getContext("2d");
    this.read(JSON.parse(figure.querySelector("script").textContent));
    this.amplitude = 0.4;
    this.speed = 0.35;
    this.ghost = true;
    this.phase = Math.PI / 2;
    this.playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.connect(figure);
    this.choose(this.mode);
    this.reset();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    this.visible = true;
    new IntersectionObserver((entries) => { this.visible = entries[0].isIntersecting; this.start(); }).observe(this.canvas);
    for (const event of ["beforeprint", "afterprint"]) addEventListener(event, () => this.draw());
    this.start();
  }

  read(data) {
    const unpack = (text, Kind) => new Kind(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
    this.rest = unpack(data.positions, Float32Array);
    this.quads = unpack(data.quads, Uint32Array);
    this.lines = unpack(data.lines, Uint32Array);
    this.shapes = unpack(data.shapes, Float32Array);
    this.names = data.modes;
    this.mode = data.first;
    this.n = this.rest.length / 3;
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    this.rest.forEach((v, i) => { low[i % 3] = Math.min(low[i % 3], v); high[i % 3] = Math.max(high[i % 3], v); });
    this.centre = low.map((v, k) => (v + high[k]) / 2);
    this.size = Math.hypot(...low.map((v, k) => high[k] - v)) || 1;
    this.screen = new Float32Array(3 * this.n);
    this.restScreen = new Float32Array(3 * this.n);
    this.level = new Float32Array(this.n);
    // a line that is the edge of a face is drawn with the face; the others stand alone
    const edges = new Set();
    const key = (a, b) => (a < b ? a * this.n + b : b * this.n + a);
    for (let q = 0; q < this.quads.length; q += 4) for (let k = 0; k < 4; k++) edges.add(key(this.quads[q + k], this.quads[q + (k + 1) % 4]));
    this.bars = [];
    for (let i = 0; i < this.lines.length; i += 2) if (!edges.has(key(this.lines[i], this.lines[i + 1]))) this.bars.push(i);
  }

  connect(figure) {
    const find = (name) => figure.querySelector("." + name);
    const list = find("mode");
    this.names.forEach((name, i) => list.add(new Option(name, i, i === this.mode, i === this.mode)));
    list.onchange = () => this.choose(Number(list.value));
    find("amplitude").oninput = (e) => { this.amplitude = e.target.value / 100; this.draw(); };
    find("speed").oninput = (e) => { this.speed = e.target.value / 100; };
    find("ghost").onchange = (e) => { this.ghost = e.target.checked; this.draw(); };
    this.button = find("play");
    this.button.onclick = () => { this.playing = !this.playing; this.start(); };
    find("views").onclick = (e) => { const name = e.target.dataset.view; if (name) { this.reset(name); } };
    this.pointer();
  }

  pointer() {
    const canvas = this.canvas;
    canvas.onpointerdown = (e) => { canvas.setPointerCapture(e.pointerId); canvas.focus({ preventScroll: true }); this.held = [e.clientX, e.clientY]; };
    canvas.onpointerup = canvas.onpointercancel = () => { this.held = null; };
    canvas.onpointermove = (e) => {
      if (!this.held) return;
      const [dx, dy] = [e.clientX - this.held[0], e.clientY - this.held[1]];
      this.held = [e.clientX, e.clientY];
      if (e.shiftKey) { this.shift[0] += dx; this.shift[1] += dy; } else this.turn(-dx * 0.008, dy * 0.008);
      this.draw();
    };
    // the wheel scrolls the page until the view has been clicked
    canvas.addEventListener("wheel", (e) => {
      if (document.activeElement !== canvas) return;
      e.preventDefault();
      this.zoomBy(Math.exp(-e.deltaY * 0.0015));
    }, { passive: false });
    canvas.ondblclick = () => this.reset();
    canvas.onkeydown = (e) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
      if (step) this.turn(...step);
      else if (e.key === "+" || e.key === "-") this.zoomBy(e.key === "+" ? 1.1 : 1 / 1.1);
      else if (e.key === " ") this.button.click();
      else return;
      e.preventDefault();
      this.draw();
    };
  }

  turn(azimuth, elevation) {
    this.azimuth += azimuth;
    this.elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, this.elevation + elevation));
  }

  zoomBy(factor) {
    this.zoom = Math.max(0.2, Math.min(20, this.zoom * factor));
    this.draw();
  }

  reset(view = "iso") {
    [this.azimuth, this.elevation] = StructureView.VIEWS[view];
    this.zoom = 1;
    this.shift = [0, 0];
    this.draw();
  }

  choose(mode) {
    this.mode = mode;
    const shape = this.shapes.subarray(3 * this.n * mode, 3 * this.n * (mode + 1));
    this.shape = shape;
    for (let i = 0; i < this.n; i++) this.level[i] = Math.hypot(shape[3 * i], shape[3 * i + 1], shape[3 * i + 2]);
    this.draw();
  }

  start() {
    this.button.textContent = this.playing ? "Pause" : "Play";
    this.button.setAttribute("aria-pressed", String(this.playing));
    if (this.running || !this.playing || !this.visible) return;
    this.running = true;
    let last = null;
    const step = (now) => {
      if (!this.playing || !this.visible) { this.running = false; return; }
      if (last !== null) this.phase += Math.min(0.1, (now - last) / 1000) * 2 * Math.PI * (0.1 + 1.6 * this.speed);
      last = now;
      this.draw();
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  // Points of the model on the screen, with depth (larger is nearer): turned about z, tilted, with a weak perspective.
  project(swing, out) {
    const [ca, sa] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    const [ce, se] = [Math.cos(this.elevation), Math.sin(this.elevation)];
    const pixels = this.zoom * Math.min(this.width * 0.9, this.height * 0.9) / this.size;
    for (let i = 0; i < 3 * this.n; i += 3) {
      const x = this.rest[i] + swing * this.shape[i] - this.centre[0];
      const y = this.rest[i + 1] + swing * this.shape[i + 1] - this.centre[1];
      const z = this.rest[i + 2] + swing * this.shape[i + 2] - this.centre[2];
      const right = ca * x + sa * y, away = -sa * x + ca * y;
      const depth = -ce * away + se * z;
      const scale = pixels / (1 - depth / (3.5 * this.size));
      out[i] = this.width / 2 + this.shift[0] + scale * right;
      out[i + 1] = this.height / 2 + this.shift[1] - scale * (se * away + ce * z);
      out[i + 2] = depth;
    }
  }

  draw() {
    const { canvas, pen } = this;
    if (!canvas.clientWidth || this.shift === undefined) return;
    const ratio = window.devicePixelRatio || 1;
    [this.width, this.height] = [canvas.clientWidth, canvas.clientHeight];
    const [w, h] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.lineJoin = "round";
    if (this.ghost) { this.project(0, this.restScreen); this.drawGhost(); }
    this.project(Math.sin(this.phase) * this.amplitude * 0.2 * this.size, this.screen);
    this.drawSolid();
    this.drawTriad();
    this.drawScale();
  }

  drawGhost() {
    const { pen, restScreen: s, lines } = this;
    pen.beginPath();
    for (let i = 0; i < lines.length; i += 2) {
      const a = 3 * lines[i], b = 3 * lines[i + 1];
      pen.moveTo(s[a], s[a + 1]);
      pen.lineTo(s[b], s[b + 1]);
    }
    pen.strokeStyle = this.css("--rule");
    pen.lineWidth = 0.8;
    pen.stroke();
  }

  drawSolid() {
    const { pen, screen: s, quads, lines } = this;
    const things = [];
    for (let q = 0; q < quads.length; q += 4) {
      things.push([(s[3 * quads[q] + 2] + s[3 * quads[q + 1] + 2] + s[3 * quads[q + 2] + 2] + s[3 * quads[q + 3] + 2]) / 4, q, true]);
    }
    for (const i of this.bars) things.push([(s[3 * lines[i] + 2] + s[3 * lines[i + 1] + 2]) / 2, i, false]);
    things.sort((a, b) => a[0] - b[0]);
    for (const [, at, isFace] of things) isFace ? this.drawFace(at) : this.drawBar(at);
    pen.globalAlpha = 1;
  }

  drawFace(q) {
    const { pen, screen: s, quads } = this;
    const [a, b, c, d] = [quads[q], quads[q + 1], quads[q + 2], quads[q + 3]];
    pen.beginPath();
    pen.moveTo(s[3 * a], s[3 * a + 1]);
    for (const k of [b, c, d]) pen.lineTo(s[3 * k], s[3 * k + 1]);
    pen.closePath();
    const level = (this.level[a] + this.level[b] + this.level[c] + this.level[d]) / 4;
    pen.fillStyle = this.colour(level, this.light(a, b, c, d));
    pen.fill();
    pen.strokeStyle = "rgba(12, 20, 30, 0.35)";
    pen.lineWidth = 0.6;
    pen.stroke();
  }

  drawBar(i) {
    const { pen, screen: s, lines } = this;
    const [a, b] = [lines[i], lines[i + 1]];
    pen.beginPath();
    pen.moveTo(s[3 * a], s[3 * a + 1]);
    pen.lineTo(s[3 * b], s[3 * b + 1]);
    pen.strokeStyle = this.colour((this.level[a] + this.level[b]) / 2, 0.85);
    pen.lineWidth = 3;
    pen.stroke();
  }

  // How squarely the face meets the eye, from its diagonals on the screen: enough light to tell the sides apart.
  light(a, b, c, d) {
    const s = this.screen, pixels = this.zoom * Math.min(this.width, this.height) * 0.9 / this.size;
    const u = [s[3 * c] - s[3 * a], s[3 * c + 1] - s[3 * a + 1], (s[3 * c + 2] - s[3 * a + 2]) * pixels];
    const v = [s[3 * d] - s[3 * b], s[3 * d + 1] - s[3 * b + 1], (s[3 * d + 2] - s[3 * b + 2]) * pixels];
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const long = Math.hypot(...n) || 1;
    return 0.62 + 0.38 * Math.abs((0.35 * n[0] - 0.5 * n[1] + 0.79 * n[2]) / long);
  }

  colour(level, light) {
    const at = Math.max(0, Math.min(1, level)) * (StructureView.SCALE.length - 1);
    const low = Math.min(StructureView.SCALE.length - 2, Math.floor(at)), part = at - low;
    const [p, q] = [StructureView.SCALE[low], StructureView.SCALE[low + 1]].map((hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)));
    return `rgb(${p.map((value, k) => Math.round(light * (value + part * (q[k] - value)))).join(",")})`;
  }

  drawTriad() {
    const { pen } = this;
    const [ca, sa] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    const [ce, se] = [Math.cos(this.elevation), Math.sin(this.elevation)];
    const [x0, y0, long] = [46, this.height - 46, 30];
    const axes = [["x", ca, -sa * se, "#D55E00"], ["y", sa, ca * se, "#009E73"], ["z", 0, ce, "#0072B2"]];
    pen.font = "600 12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    for (const [name, right, up, colour] of axes) {
      pen.strokeStyle = pen.fillStyle = colour;
      pen.lineWidth = 2;
      pen.beginPath();
      pen.moveTo(x0, y0);
      pen.lineTo(x0 + long * right, y0 - long * up);
      pen.stroke();
      pen.fillText(name, x0 + (long + 9) * right, y0 - (long + 9) * up);
    }
  }

  drawScale() {
    const { pen } = this;
    const [x, y, wide, high] = [this.width - 26, 30, 12, Math.min(180, this.height - 80)];
    const steps = 60;
    for (let i = 0; i < steps; i++) {
      pen.fillStyle = this.colour(1 - i / (steps - 1), 1);
      pen.fillRect(x, y + (i * high) / steps, wide, high / steps + 1);
    }
    pen.fillStyle = this.css("--soft");
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    [1, 0.5, 0].forEach((value) => pen.fillText(String(value), x - 5, y + (1 - value) * high));
    pen.fillText("displacement / largest", this.width - 14, y - 16);
    pen.textAlign = "left";
    pen.fillStyle = this.css("--ink");
    pen.font = "600 14px system-ui, sans-serif";
    pen.fillText(this.names[this.mode], 14, 18);
  }
}
