// The potentials of a function F over a cell, h = n_refᵀ (q − q_ref): chart.py has their letters.

const [RADIUS, ANGLE, HEIGHT] = [0, 1, 2]; // coordinates of a sector
const IN_SECTOR = ["radius", "angle", "height", "tilt about x", "tilt about y", "spin"];
const IN_BOX = ["x", "y", "z"];

// Make the potentials from what cell_loop.py writes. `weights`: coefficients of q_ref and n_ref.
export class CellPotentials {
  constructor(data) {
    Object.assign(this, data, { chart: true });
    const { parent, n, r, widths } = data;
    this.size = n * (1 + r);
    this.T = new Float64Array(parent.length);
    this.dT = widths.map(() => new Float64Array(parent.length));
    this.sums = [0, ...widths].map(() => new Float64Array(this.size));
  }

  // The coordinates of a placed frame that the cell uses, and their gradients along v and ω.
  measure({ p, R }) {
    const { sector, middle } = this;
    if (!sector)
      return [0, 1, 2].map((i) => [p[i] - middle[i], [0, 1, 2].map((k) => Number(k === i))]);
    const { origin, axes, radius, height, half, bend, stretch, spinMiddle } = sector;
    const away = p.map((v, i) => v - origin[i]);
    const [x, y, z] = axes.map((axis) => dot(axis, away));
    const rho = Math.hypot(x, y);
    const [c, s] = [x / rho, y / rho];
    const outward = axes[0].map((v, i) => c * v + s * axes[1][i]);
    const around = axes[1].map((v, i) => (c * v - s * axes[0][i]) / rho);
    const eta = z - height;
    const inside = Math.min(Math.max(eta, -half), half);
    const [b, k] = [bend, stretch].map((each) => value(each, inside));
    const slope = (each) => (inside === eta ? value(derivative(each), eta) : 0);
    const y0 = (rho - radius - b) / k;
    const along = (slope(bend) + slope(stretch) * y0) / k;
    const radial = outward.map((v, i) => v / k - along * axes[2][i]);
    const angle = Math.atan2(y, x);
    const found = [
      [y0, radial],
      [angle, around],
      [eta, axes[2]],
    ];
    if (spinMiddle === null) return found;
    // R = R_a(φ) R_0 R_z(ψ): the frame's x axis in the axes that turn with the angle
    const column = (i) => [R[i], R[3 + i], R[6 + i]];
    const [first, second] = sector.tool.map((v) => turned(v, axes[2], angle));
    const spin = Math.atan2(dot(second, column(0)), dot(first, column(0)));
    const whole = 2 * Math.PI * Math.round((spin - spinMiddle) / (2 * Math.PI));
    const share = -dot(axes[2], column(2));
    found[5] = [spin - whole, [...around.map((v) => share * v), ...column(2)]];
    return found;
  }

  // The coordinates of which F has a range: [i, middle, half-width, tolerance] of each.
  ranges() {
    const { moved, widths, offset, bounds, removed } = this;
    const ranges = moved.map((i, j) => [i, offset[j], bounds[j] * widths[j], 1e-6 * widths[j]]);
    for (const { i, most } of removed) if (most !== null) ranges.push([i, 0, most, 1e-6]);
    return ranges;
  }

  // The height for which a range of the radius holds, m; null for other coordinates.
  heightOf(i, y) {
    const { sector } = this;
    return sector && i === RADIUS && sector.half ? this.length(HEIGHT, y, y[HEIGHT][0]) : null;
  }

  // The coordinate by which the frame stands where F has no value: {i, name, low, high, at}, its
  // range there and its value, m or, if it is an `angle`, rad; with the `height` for which a range
  // of radius is. Null where F has one.
  beyond(frame) {
    const { sector } = this;
    const y = this.measure(frame);
    const out = this.ranges().filter(
      ([i, middle, half, more]) => Math.abs(y[i][0] - middle) > half + more,
    );
    if (!out.length) return null;
    // a radius counts at a height that F covers
    const [i, middle, half] = out.find(([one]) => one !== RADIUS) || out[0];
    const scaled = (v) => this.length(i, y, v);
    const [low, high, at] = [middle - half, middle + half, y[i][0]].map(scaled);
    const height = this.heightOf(i, y);
    const name = (sector ? IN_SECTOR : IN_BOX)[i];
    return {
      i,
      name,
      low,
      high,
      at,
      angle: Boolean(sector && i !== RADIUS && i !== HEIGHT),
      height,
    };
  }

  // The point of these at which coordinate i is farthest up or down, in the range that F has there:
  // its value as beyond() gives it, and its height.
  farthest(i, points, up) {
    const R = [1, 0, 0, 0, 1, 0, 0, 0, 1];
    const all = points.map((p) => this.measure({ p, R }));
    const y = all.reduce((a, b) => (up === b[i][0] > a[i][0] ? b : a));
    return { value: this.length(i, y, y[i][0]), height: this.heightOf(i, y) };
  }

  // A value of coordinate i where the others are y: from the axis, the base or the middle.
  length(i, y, v) {
    const { sector, middle } = this;
    if (!sector) return middle[i] + v;
    const { origin, axes, radius, height, half, bend, stretch } = sector;
    if (i === HEIGHT) return dot(axes[2], origin) + height + v;
    if (i !== RADIUS) return v;
    const inside = Math.min(Math.max(y[HEIGHT][0], -half), half);
    return radius + value(bend, inside) + value(stretch, inside) * v;
  }

  // q_ref and n_ref, and their slopes, at coordinates u.
  evaluate(u) {
    const { T, dT, sums, size, parent, variable, weights } = this;
    for (const sum of sums) sum.fill(0);
    for (let t = 0; t < T.length; t++) {
      const x = u[variable[t]];
      const up = parent[t];
      T[t] = t ? T[up] * x : 1;
      for (let j = 0; j < dT.length; j++)
        dT[j][t] = t ? dT[j][up] * x + (variable[t] === j ? T[up] : 0) : 0;
      for (let i = 0; i < size; i++) {
        const w = weights[t * size + i];
        sums[0][i] += w * T[t];
        for (let j = 0; j < dT.length; j++) sums[j + 1][i] += w * dT[j][t];
      }
    }
  }

  // Add h, and their gradients below J, at the q where the frame is placed.
  add(q, frame, A, h, at) {
    const { n, r, moved, widths, offset, removed, sums } = this;
    const y = this.measure(frame);
    this.evaluate(moved.map((i, j) => (y[i][0] - offset[j]) / widths[j]));
    const away = Float64Array.from(q, (v, i) => v - sums[0][i * (1 + r)]);
    for (const { i, joint, sign } of removed) {
      const rest = away[joint] - sign * y[i][0];
      away[joint] = rest - 2 * Math.PI * Math.round(rest / (2 * Math.PI));
    }
    const normal = (sum, s, i) => sum[i * (1 + r) + 1 + s];
    for (let s = 0; s < r; s++) {
      const row = at + s * n;
      for (let i = 0; i < n; i++) {
        h[s] += normal(sums[0], s, i) * away[i];
        A[row + i] += normal(sums[0], s, i);
      }
      moved.forEach((c, j) => {
        let w = 0;
        for (let i = 0; i < n; i++)
          w +=
            normal(sums[0], s, i) * sums[j + 1][i * (1 + r)] - normal(sums[j + 1], s, i) * away[i];
        this.subtract(A, row, w / widths[j], y[c][1], frame);
      });
      for (const { i, joint, sign } of removed)
        this.subtract(A, row, sign * normal(sums[0], s, joint), y[i][1], frame);
    }
  }

  // Subtract w gᵀ J from a row of A, with a gradient g along v and ω.
  subtract(A, row, w, g, { m, rows, kind }) {
    const { n } = this;
    for (let k = 0; k < m; k++) {
      const share = w * (g[kind === "axis" ? k : rows[k]] || 0);
      if (share) for (let i = 0; i < n; i++) A[row + i] -= share * A[k * n + i];
    }
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const value = (coefficients, x) => coefficients.reduceRight((sum, c) => sum * x + c, 0);
const derivative = (coefficients) => coefficients.slice(1).map((c, i) => (i + 1) * c);

// A vector turned about a unit vector.
function turned(v, a, angle) {
  const [s, c] = [Math.sin(angle), Math.cos(angle)];
  const along = dot(a, v) * (1 - c);
  return v.map((x, i) => {
    const [j, k] = [(i + 1) % 3, (i + 2) % 3];
    return c * x + s * (a[j] * v[k] - a[k] * v[j]) + along * a[i];
  });
}
