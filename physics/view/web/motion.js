/* Numbers out of the page, and frames out of few shapes (physics/view/lowrank.py).
   Legend: t frame, r shape, n numbers in a frame: three for each node of the surface, or one. */

const buffer = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;

/* The shapes of one quantity, which give any of its frames. */
class Shapes {
  constructor(stored) {
    this.rank = stored.rank;
    this.coefficients = new Float32Array(buffer(stored.coefficients));
    this.shapes = new Int16Array(buffer(stored.shapes));
  }

  /* Add frame t to what stands in `sum`. */
  add(t, sum) {
    const n = sum.length;
    for (let r = 0; r < this.rank; r++) {
      const much = this.coefficients[t * this.rank + r], start = r * n;
      for (let i = 0; i < n; i++) sum[i] += much * this.shapes[start + i];
    }
    return sum;
  }
}

/* An exhibit with its arrays unpacked. */
class Exhibit {
  constructor(stored) {
    Object.assign(this, stored);
    for (const key of ["nodes", "triangles", "edges", "outline"]) this[key] = new Uint32Array(buffer(stored[key]));
    this.points = new Float32Array(buffer(stored.points));
    this.motions = stored.motions.map(motion => ({
      ...motion, shapes: new Shapes(motion.motion),
      fields: Object.fromEntries(Object.entries(motion.fields).map(([key, field]) => [key, new Shapes(field)])),
    }));
    this.true = this.motions.find(motion => motion.name === this.truth);
    this.rigid = stored.obstacle && {
      points: new Float32Array(buffer(stored.obstacle.points)), triangles: new Uint32Array(buffer(stored.obstacle.triangles)),
      shapes: new Shapes(stored.obstacle.motion),
    };
  }

  zeros(components) { return new Float64Array(this.points.length / 3 * components); }

  /* Displacements of a motion in frame t [m], and without what it has in common with the truth. */
  displacement(motion, t) {
    const moved = motion.shapes.add(t, this.zeros(3));
    return motion.above ? this.true.shapes.add(t, moved) : moved;
  }

  error(motion, t) { return motion.above ? motion.shapes.add(t, this.zeros(3)) : this.zeros(3); }

  /* The value at each node that a motion is coloured by in frame t, in SI units or those of the field. */
  value(motion, key, t) {
    if (key !== "error" && key !== "displacement") return motion.fields[key] ? motion.fields[key].add(t, this.zeros(1)) : this.zeros(1);
    const vectors = key === "error" ? this.error(motion, t) : this.displacement(motion, t);
    return this.zeros(1).map((_, i) => Math.hypot(vectors[3 * i], vectors[3 * i + 1], vectors[3 * i + 2]));
  }

  /* Where the nodes are in frame t [m]. */
  places(motion, t) { return Float32Array.from(this.displacement(motion, t), (moved, i) => moved + this.points[i]); }

  obstacleAt(t) {
    const moved = this.rigid.shapes.add(t, new Float64Array(this.rigid.points.length));
    return Float32Array.from(moved, (value, i) => value + this.rigid.points[i]);
  }
}
