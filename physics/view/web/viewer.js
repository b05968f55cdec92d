/* The controls: what is shown, how it is turned, which frame; and what is taken home, PNG and CSV. */

const three = value => Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5 || value === 0
  ? String(Number(value.toPrecision(3))) : value.toExponential(2);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

class Viewer {
  constructor(root) {
    this.root = root;
    this.find = what => root.querySelector(what);
    const data = JSON.parse(this.find(".data").textContent);
    this.colours = Object.fromEntries(Object.entries(data.colours).map(([name, text]) => [name, new Uint8Array(buffer(text))]));
    this.exhibits = data.exhibits.map(stored => new Exhibit(stored));
    this.canvas = this.find("canvas");
    this.stage = new Stage(this.canvas);
    [this.left, this.right] = root.querySelectorAll(".names select");
    this.slider = this.find("input");
    this.fill(this.find(".exhibit"), this.exhibits.map(exhibit => exhibit.title));
    this.find(".exhibits").hidden = this.exhibits.length < 2;
    this.listen();
    this.show(0);
    new ResizeObserver(() => this.draw()).observe(this.canvas.parentElement);
  }

  fill(select, names) { select.replaceChildren(...names.map((name, i) => new Option(name, i))); }

  listen() {
    const on = (what, event, act) => this.find(what).addEventListener(event, act);
    on(".exhibit", "change", event => this.show(Number(event.target.value)));
    for (const select of [this.left, this.right, this.find(".quantity")]) select.addEventListener("change", () => this.draw());
    this.slider.addEventListener("input", () => { this.stop(); this.draw(); });
    on(".home", "click", () => { this.home(); this.draw(); });
    on(".play", "click", () => this.playing ? this.stop() : this.play());
    on(".worst", "click", () => this.go(this.curve(this.shown[0]).reduce((best, value, t, all) => value > all[best] ? t : best, 0)));
    on(".png", "click", () => this.picture());
    on(".csv", "click", () => this.save(new Blob([this.table()], {type: "text/csv"}), "csv"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    this.hands();
  }

  /* Mouse, fingers, wheel and keys on the picture. */
  hands() {
    const held = new Map(), canvas = this.canvas;
    canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, event); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, event => held.delete(event.pointerId));
    canvas.addEventListener("pointermove", event => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const across = event.clientX - before.clientX, down = event.clientY - before.clientY;
      const other = [...held.values()].find(finger => finger.pointerId !== event.pointerId);
      if (other) {
        const apart = finger => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY);
        this.camera.zoom *= apart(event) / Math.max(1, apart(before));
        this.move(across / 2, down / 2);
      } else if (event.shiftKey || event.buttons === 2) this.move(across, down);
      else this.turn(-0.008 * across, 0.008 * down);
      held.set(event.pointerId, event);
      this.draw();
    });
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("wheel", event => {
      if (document.activeElement !== canvas) return;  /* who only scrolls past it does not zoom */
      event.preventDefault();
      this.camera.zoom *= Math.exp(-0.0015 * event.deltaY);
      this.draw();
    }, {passive: false});
    canvas.addEventListener("keydown", event => {
      const act = {ArrowLeft: () => this.turn(-0.1, 0), ArrowRight: () => this.turn(0.1, 0), ArrowUp: () => this.turn(0, 0.1),
        ArrowDown: () => this.turn(0, -0.1), "+": () => { this.camera.zoom *= 1.2; }, "-": () => { this.camera.zoom /= 1.2; },
        "0": () => this.home()}[event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      act();
      this.draw();
    });
  }

  /* Begin with an exhibit: the first prediction beside the truth, in its last frame. */
  show(number) {
    this.stop();
    const exhibit = this.exhibit = this.exhibits[number], names = exhibit.motions.map(motion => motion.name);
    const truth = names.indexOf(exhibit.truth);
    this.find(".names").hidden = names.length < 2;
    this.fill(this.left, names);
    this.fill(this.right, [...names, "nothing"]);
    this.left.value = String(Math.max(0, names.findIndex(name => name !== exhibit.truth)));
    this.right.value = String(truth >= 0 && names.length > 1 ? truth : names.length);
    this.find(".about-truth").hidden = truth < 0 || names.length < 2;
    this.fill(this.find(".quantity"), exhibit.quantities.map(quantity => quantity.name));
    this.slider.max = exhibit.frames.length - 1;
    this.find(".time").hidden = exhibit.frames.length < 2;
    this.home();
    this.go(truth < 0 && exhibit.frames[0].startsWith("phase") ? 0 : exhibit.frames.length - 1);
  }

  get shown() {
    return [this.left, this.right].map(select => this.exhibit.motions[Number(select.value)]).filter(motion => motion);
  }

  get quantity() { return this.exhibit.quantities[Number(this.find(".quantity").value)]; }
  get frame() { return Number(this.slider.value); }

  curve(motion) { return motion.curves[this.quantity.key] || this.exhibit.frames.map(() => 0); }

  go(frame) { this.slider.value = frame; this.draw(); }

  /* The camera as in the pictures: turned about the vertical, then towards or away from the eye. */
  home() {
    const {centre, half, eye} = this.exhibit.camera;
    const upright = Math.hypot(eye[0], eye[1]) < 0.01;
    this.camera = {centre, half, zoom: 1, moved: [0, 0], around: upright ? -Math.PI / 2 : Math.atan2(eye[1], eye[0]),
      above: Math.asin(Math.max(-1, Math.min(1, eye[2])))};
    this.turn(0, 0);
  }

  turn(around, above) {
    const camera = this.camera;
    camera.around += around;
    camera.above = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, camera.above + above));
    const [s, c, up, flat] = [Math.sin(camera.around), Math.cos(camera.around), Math.sin(camera.above), Math.cos(camera.above)];
    camera.eye = [flat * c, flat * s, up];
    camera.right = [-s, c, 0];
    camera.up = cross(camera.eye, camera.right);
  }

  move(across, down) { this.camera.moved[0] += across; this.camera.moved[1] += down; }

  play() {
    const frames = this.exhibit.frames.length, each = Math.max(40, 5000 / frames);
    const began = performance.now(), first = this.frame === frames - 1 ? 0 : this.frame;
    this.find(".play").textContent = "❚❚";
    this.find(".play").setAttribute("aria-label", "stop");
    this.find(".said").setAttribute("aria-live", "off");
    const step = now => {
      this.go((first + Math.floor(Math.max(0, now - began) / each)) % frames);
      this.playing = requestAnimationFrame(step);
    };
    this.playing = requestAnimationFrame(step);
  }

  stop() {
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    this.find(".play").textContent = "▶";
    this.find(".play").setAttribute("aria-label", "play");
    this.find(".said").setAttribute("aria-live", "polite");
  }

  draw() {
    const {exhibit, quantity, frame, shown} = this;
    const top = Math.max(...shown.map(motion => Math.max(...this.curve(motion)))) || 1;
    const colour = (name, opacity) => {
      const digits = getComputedStyle(this.root).getPropertyValue(name).trim().slice(1);
      return [...(digits.length === 3 ? digits.replace(/./g, "$&$&") : digits).match(/../g).map(pair => parseInt(pair, 16) / 255), opacity];
    };
    const [low, high] = shown.length > 1 ? [0.6, 0.85] : [0.45, 0.6], [wide, tall] = exhibit.camera.half;  /* room to turn */
    const ratio = Math.min(high, Math.max(low, 1.1 * tall / wide));
    this.beside = this.stage.resize(shown.length, ratio);
    this.stage.colours = this.colours[quantity.colours];
    const rigid = exhibit.rigid && {places: exhibit.obstacleAt(frame), index: exhibit.rigid.triangles, plain: [0.6, 0.62, 0.64, 0.55]};
    this.stage.draw(shown.map(motion => {
      const places = exhibit.places(motion, frame), value = exhibit.value(motion, quantity.key, frame);
      const values = Float32Array.from(value, each => quantity.signed ? 0.5 + each / top / 2 : each / top);
      const layers = [{places, index: exhibit.triangles, values}, {places, index: exhibit.edges, plain: colour("--mesh", 0.45), lines: 1e-4}];
      if (exhibit.true && motion !== exhibit.true)
        layers.push({places: exhibit.places(exhibit.true, frame), index: exhibit.outline, plain: colour("--truth", 1), lines: 2e-4});
      return rigid ? [...layers, rigid] : layers;
    }), this.camera, this.beside);
    this.tell(quantity, top);
  }

  /* The words and the curve around the picture. */
  tell(quantity, top) {
    const {exhibit, frame, shown} = this, {factor, unit} = quantity, frames = exhibit.frames.length;
    this.find(".low").textContent = quantity.signed ? three(-top * factor) : "0";
    this.find(".high").textContent = three(top * factor);
    this.find(".unit").textContent = `${quantity.name} [${unit}]`;
    const map = this.colours[quantity.colours];
    const stops = Array.from({length: 17}, (_, i) => Math.round(i * 255 / 16)).map(i => `rgb(${map.slice(3 * i, 3 * i + 3).join()})`);
    this.find(".scale").style.background = `linear-gradient(to right, ${stops.join()})`;
    this.find(".scale").setAttribute("aria-label", `colours from ${this.find(".low").textContent} to ${three(top * factor)} ${unit}`);
    const words = shown.map(motion => `${three(factor * this.curve(motion)[frame])} ${unit} (${motion.name})`);
    this.find(".worst").textContent = quantity.key === "error" ? "worst frame" : "largest frame";
    this.find(".drawn").textContent = shown.map(motion => motion.drawn).join("; ");
    this.find(".said").textContent = `${exhibit.frames[frame]}: largest ${quantity.name} ${words.join(", ")}`;
    this.slider.setAttribute("aria-valuetext", exhibit.frames[frame]);
    const across = t => 1000 * t / Math.max(1, frames - 1);
    [".first", ".second"].forEach((name, i) => this.find(name).setAttribute("points", !shown[i] ? "" :
      this.curve(shown[i]).map((value, t) => `${across(t).toFixed(1)},${(98 - 95 * value / top).toFixed(1)}`).join(" ")));
    for (const end of ["x1", "x2"]) this.find("line").setAttribute(end, across(frame));
  }

  /* The picture with names, frame and colours around it. */
  picture() {
    const {canvas, shown} = this, ratio = devicePixelRatio, room = 40 * ratio, style = getComputedStyle(document.body);
    const page = Object.assign(document.createElement("canvas"), {width: canvas.width, height: canvas.height + 2 * room});
    const draw = page.getContext("2d");
    draw.fillStyle = style.backgroundColor;
    draw.fillRect(0, 0, page.width, page.height);
    draw.drawImage(canvas, 0, room);
    draw.fillStyle = style.color;
    draw.font = `${14 * ratio}px sans-serif`;
    draw.textAlign = "center";
    shown.forEach((motion, i) => {
      if (this.beside) draw.fillText(motion.name, (i + 0.5) * page.width / shown.length, 0.6 * room);
      else draw.fillText(motion.name, page.width / 2, 0.6 * room + i * canvas.height / shown.length);
    });
    draw.fillText(this.find(".said").textContent, page.width / 2, page.height - 0.6 * room, page.width - 10);
    const map = this.colours[this.quantity.colours], wide = 0.4 * page.width / 256, y = page.height - 0.4 * room;
    draw.fillText(this.find(".low").textContent, 0.27 * page.width, page.height - 0.1 * room);
    draw.fillText(`${this.find(".high").textContent} ${this.quantity.unit}`, 0.76 * page.width, page.height - 0.1 * room);
    for (let i = 0; i < 256; i++) {
      draw.fillStyle = `rgb(${map.slice(3 * i, 3 * i + 3).join()})`;
      draw.fillRect(0.3 * page.width + i * wide, y, wide + 1, 0.3 * room);
    }
    page.toBlob(blob => this.save(blob, "png"));
  }

  /* The nodes of the surface in this frame, SI units. */
  table() {
    const {exhibit, frame, shown} = this, quote = text => `"${text.replaceAll('"', '""')}"`;
    const columns = [["node", [...exhibit.nodes]], ...["x", "y", "z"].map((axis, k) => [`${axis} at rest [m]`, exhibit.zeros(1).map(
      (_, i) => exhibit.points[3 * i + k])])];
    for (const motion of shown) {
      const moved = exhibit.displacement(motion, frame);
      ["x", "y", "z"].forEach((axis, k) => columns.push([`${motion.name}: u${axis} [m]`, exhibit.zeros(1).map((_, i) => moved[3 * i + k])]));
      for (const {key, name, unit} of exhibit.quantities.filter(each => each.key !== "displacement"))
        columns.push([`${motion.name}: ${name} [${key === "error" ? "m" : unit}]`, exhibit.value(motion, key, frame)]);
    }
    const rows = [...exhibit.nodes].map((_, i) => columns.map(([, values]) => Number(values[i].toPrecision(7))).join(","));
    return [columns.map(([name]) => quote(name)).join(","), ...rows, ""].join("\n");
  }

  save(blob, ending) {
    const link = Object.assign(document.createElement("a"), {href: URL.createObjectURL(blob),
      download: `${`${this.exhibit.title} ${this.exhibit.frames[this.frame]}`.replace(/[^\w.-]+/g, "-")}.${ending}`});
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
}

for (const root of document.querySelectorAll(".viewer"))
  try {
    new Viewer(root);
  } catch (error) {
    root.querySelector("canvas").replaceWith(Object.assign(document.createElement("p"), {className: "alarm",
      textContent: `The moving picture cannot be shown: ${error.message}. The tables hold its figures.`}));
    for (const part of root.querySelectorAll(".controls,.names,.bar,.time")) part.hidden = true;
  }
