/* Bodies drawn by WebGL: panels one beside the other, or one above the other where it is narrow, all seen by one camera. */

const VERTEX = `#version 300 es
in vec3 place; in float value;
uniform vec3 right, up, eye, centre; uniform vec3 scale; uniform vec2 moved; uniform float nearer;
out vec3 at; out float level;
void main() {
  vec3 from = place - centre;
  at = vec3(dot(from, right), dot(from, up), dot(from, eye));
  level = value;
  gl_Position = vec4(at.xy * scale.xy + moved, -at.z * scale.z - nearer, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 at; in float level;
uniform sampler2D colours; uniform vec4 plain; uniform float lit; uniform bool mapped;
out vec4 colour;
void main() {
  float light = 1.0;
  if (lit > 0.0) {  /* a line has no normal */
    vec3 normal = normalize(cross(dFdx(at), dFdy(at)));
    light -= lit * (1.0 - abs(normal.z) * 0.85 - abs(normal.y) * 0.15);
  }
  vec4 own = mapped ? vec4(texture(colours, vec2(clamp(level, 0.0, 1.0) * 255.0 / 256.0 + 0.5 / 256.0, 0.5)).rgb, 1.0) : plain;
  colour = vec4(own.rgb * light * own.a, own.a);
}`;

class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = this.gl = canvas.getContext("webgl2", {antialias: true, preserveDrawingBuffer: true, premultipliedAlpha: true});
    if (!gl) throw new Error("this browser shows no WebGL 2");
    const program = this.program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "place");
    gl.bindAttribLocation(program, 1, "value");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || "WebGL");
    gl.useProgram(program);
    this.uniform = name => gl.getUniformLocation(program, name);
    this.buffers = [gl.createBuffer(), gl.createBuffer(), gl.createBuffer()];
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  /* 256 colours, as bytes of red, green and blue. */
  set colours(bytes) {
    const gl = this.gl;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, bytes);
  }

  /* Size of the canvas in pixels of the screen; `ratio` is height over width of a panel. Gives whether panels stand side by side. */
  resize(panels, ratio) {
    const width = this.canvas.clientWidth, beside = panels === 1 || width > 600;
    const height = Math.min(0.75 * innerHeight, beside ? width / panels * ratio : width * ratio * panels);
    const pixels = [width, height].map(side => Math.round(side * devicePixelRatio));
    if (this.canvas.width !== pixels[0] || this.canvas.height !== pixels[1]) {
      this.canvas.style.height = `${Math.round(height)}px`;
      [this.canvas.width, this.canvas.height] = pixels;
    }
    return beside;
  }

  /* Panels: lists of layers {places, index, values?, plain?, lines?}; see `layer`. */
  draw(panels, camera, beside) {
    const gl = this.gl, width = this.canvas.width, height = this.canvas.height;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    for (const [name, vector] of [["right", camera.right], ["up", camera.up], ["eye", camera.eye], ["centre", camera.centre]])
      gl.uniform3fv(this.uniform(name), vector);
    panels.forEach((layers, i) => {
      const w = Math.floor(beside ? width / panels.length : width), h = Math.floor(beside ? height : height / panels.length);
      gl.viewport(beside ? i * w : 0, beside ? 0 : height - (i + 1) * h, w, h);
      const pixels = camera.zoom * Math.min(w / camera.half[0], h / camera.half[1]);
      gl.uniform3f(this.uniform("scale"), pixels / w, pixels / h, 0.05 / Math.max(...camera.half));
      gl.uniform2f(this.uniform("moved"), 2 * camera.moved[0] / w * devicePixelRatio, -2 * camera.moved[1] / h * devicePixelRatio);
      layers.forEach(layer => this.layer(layer));
    });
  }

  /* places (3 n) and the corners of triangles or lines among them; coloured by values between 0 and 1, or plain [r, g, b, a]. */
  layer({places, index, values, plain, lines}) {
    const gl = this.gl;
    [[places, 3], [values || new Float32Array(places.length / 3), 1]].forEach(([data, size], i) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[i]);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, size, gl.FLOAT, false, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers[2]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.DYNAMIC_DRAW);
    gl.uniform1i(this.uniform("mapped"), values ? 1 : 0);
    gl.uniform4fv(this.uniform("plain"), plain || [0, 0, 0, 1]);
    gl.uniform1f(this.uniform("lit"), lines ? 0 : 0.4);
    gl.uniform1f(this.uniform("nearer"), lines || 0);
    const clear = plain && plain[3] < 1;
    gl.depthMask(!clear);
    if (clear) gl.enable(gl.BLEND); else gl.disable(gl.BLEND);
    gl.drawElements(lines ? gl.LINES : gl.TRIANGLES, index.length, gl.UNSIGNED_INT, 0);
    gl.depthMask(true);
  }
}
