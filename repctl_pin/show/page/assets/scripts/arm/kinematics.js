// The arm's kinematics, from the numbers that own_loop.py writes. Matrices are in rows.

export class Chain {
  constructor(data) {
    Object.assign(this, data);
    this.n = data.start.length;
    this.joints = data.joints.map((joint) => ({
      ...joint,
      ...doubles(joint, ["R", "p", "axis", "S"]),
    }));
    this.all = data.joints.map((joint, j) => j);
    this.places = data.joints.map(() => ({
      R: new Float64Array(9),
      p: new Float64Array(3),
      z: new Float64Array(3),
    }));
    // the frames: each has m rows of J from `row` on, and stands at R, p, relative to its base, the
    // workpiece, if it has one
    this.m = 0;
    this.frames = data.frames.map((frame) => {
      const row = this.m;
      const m = frame.kind === "axis" ? 5 : frame.rows.length;
      this.m += m;
      return { ...frame, ...carried(frame), base: frame.base && carried(frame.base), row, m };
    });
    // the joints that carry frames and bases, from the root outward
    const carriers = this.frames.flatMap(({ chain, base }) => [chain, base ? base.chain : []]);
    this.chain = this.all.filter((j) => carriers.some((chain) => chain.includes(j)));
    this.turn = new Float64Array(9);
    this.twist = new Float64Array(6);
    this.place(data.start);
    // where the hands start, and as they are held
    this.homes = this.frames.map(({ p }) => Array.from(p));
    for (const frame of this.frames) frame.held = Array.from(frame.R);
    if (this.turning) this.turning = { ...this.turning, before: this.frames[0].held.slice() };
  }

  // Put the joints of the chains, or these, and the frames where they are at q.
  place(q, which = this.chain) {
    for (const j of which) {
      const { parent, R, p, axis, turns, S, offset } = this.joints[j];
      const here = this.places[j];
      const before = parent < 0 ? ROOT : this.places[parent];
      let theta = offset;
      for (let i = 0; i < S.length; i++) theta += S[i] * q[i];
      placedIn(before, p, here.p);
      product(before.R, R, here.R);
      applied(here.R, axis, here.z);
      if (turns) {
        rotation(axis, theta, this.turn);
        product(here.R, this.turn, here.R);
      } else for (let i = 0; i < 3; i++) here.p[i] += theta * here.z[i];
    }
    for (const frame of this.frames) {
      this.stand(frame);
      if (!frame.base) continue;
      this.stand(frame.base);
      relative(frame.base, frame);
    }
  }

  // Put a frame, or a base, where its joints carry it.
  stand({ chain, at, R, p }) {
    const last = chain.length ? this.places[chain.at(-1)] : ROOT;
    placedIn(last, at.p, p);
    product(last.R, at.R, R);
  }

  // Whether a body is of this part, by its number.
  isOf(part) {
    return (body) => Boolean(this.links[body]) && this.links[body][1] === part;
  }

  // Where frame f was placed last, relative to the root.
  tip(f) {
    const { base, p } = this.frames[f];
    const q = new Float64Array(3);
    placedIn(base || ROOT, p, q);
    return Array.from(q);
  }

  // Write J (m, n) into A, at the q where the chain was placed last.
  jacobian(A) {
    A.fill(0, 0, this.m * this.n);
    this.frames.forEach((frame, f) => {
      const { chain, base } = frame;
      const p = base ? this.tip(f) : frame.p;
      const behind = base ? base.chain : [];
      // a joint that carries both the frame and its base moves neither relative to the other
      for (const j of chain) if (!behind.includes(j)) this.addJoint(A, frame, p, j, 1);
      for (const j of behind) if (!chain.includes(j)) this.addJoint(A, frame, p, j, -1);
    });
  }

  // Add what joint j moves of a frame, at p in the root, to J; with sign −1 it moves the base.
  addJoint(A, { rows, kind, R, row, m, base }, p, j, sign) {
    const { n, twist: t } = this;
    const { z, p: o } = this.places[j];
    const { turns, S } = this.joints[j];
    // its twist per unit of θ: v = z × (p − o), ω = z; or v = z of a prismatic one
    t.set(z);
    t.fill(0, 3);
    if (turns) {
      const x = p[0] - o[0];
      const y = p[1] - o[1];
      const w = p[2] - o[2];
      t.set(z, 3);
      t[0] = z[1] * w - z[2] * y;
      t[1] = z[2] * x - z[0] * w;
      t[2] = z[0] * y - z[1] * x;
    }
    if (base) for (const i of [0, 3]) turnedBack(base.R, t, i);
    for (let k = 0; k < m; k++) {
      const inFrame = kind === "axis" && k >= 3;
      const rate = inFrame ? R[k - 3] * t[3] + R[k] * t[4] + R[k + 3] * t[5] : t[rows[k]];
      for (let i = 0; i < n; i++) if (S[i]) A[(row + k) * n + i] += sign * S[i] * rate;
    }
  }

  // Write the task error (m,) to a position of each frame, held as at the start, into e.
  error(targets, e) {
    if (this.turning) this.turnHeld(targets[0]);
    this.frames.forEach((frame, f) => frameError(frame, targets[f], e));
    return e;
  }

  // In a sector without spin the tool turns with the angle: as it is held at a position, and ω of
  // a hand that moves from q by v.
  turnHeld(target) {
    const { origin, direction, before } = this.turning;
    const [x, y] = [this.homes[0], target].map((p) => {
      const away = p.map((v, i) => v - origin[i]);
      const along = away.reduce((sum, v, i) => sum + v * direction[i], 0);
      return away.map((v, i) => v - along * direction[i]);
    });
    const sine = direction.reduce((sum, v, i) => {
      const [j, k] = [(i + 1) % 3, (i + 2) % 3];
      return sum + v * (x[j] * y[k] - x[k] * y[j]);
    }, 0);
    const cosine = x.reduce((sum, v, i) => sum + v * y[i], 0);
    rotation(direction, Math.atan2(sine, cosine), this.turn);
    product(this.turn, before, this.frames[0].held);
  }
  turnWith(q, xdot) {
    const { origin, direction: a } = this.turning;
    this.place(q);
    const away = this.frames[0].p.map((v, i) => v - origin[i]);
    const around = a.map((v, i) => {
      const [j, k] = [(i + 1) % 3, (i + 2) % 3];
      return a[j] * away[k] - a[k] * away[j];
    });
    const square = around.reduce((sum, v) => sum + v * v, 0);
    const rate = around.reduce((sum, v, i) => sum + v * xdot[i], 0) / square;
    for (let i = 0; i < 3; i++) xdot[3 + i] = rate * a[i];
  }

  // The joint that is nearest to its limit, and how far it is from there; below 0 beyond it.
  nearest(q) {
    const margins = Array.from(q, (v, i) =>
      Math.min(v - (this.lower[i] ?? -Infinity), (this.upper[i] ?? Infinity) - v),
    );
    const joint = margins.reduce((best, v, i) => (v < margins[best] ? i : best), 0);
    return { joint, margin: margins[joint] };
  }

  // The joint whose rate is the largest share of its limit, and that share.
  fastestJoint(qdot) {
    const shares = Array.from(qdot, (v, i) => Math.abs(v) / (this.fastest[i] ?? Infinity));
    const joint = shares.reduce((best, v, i) => (v > shares[best] ? i : best), 0);
    return { joint, share: shares[joint] };
  }
}

// Write the error of one frame to a position into its rows of e.
function frameError({ rows, kind, p, R, held, row, m }, target, e) {
  if (kind === "position") {
    for (let k = 0; k < m; k++) e[row + k] = target[rows[k]] - p[rows[k]];
    return;
  }
  for (let i = 0; i < 3; i++) e[row + i] = target[i] - p[i];
  // D = held Rᵀ
  const D = (a, b) =>
    held[3 * a] * R[3 * b] + held[3 * a + 1] * R[3 * b + 1] + held[3 * a + 2] * R[3 * b + 2];
  if (kind === "pose") {
    const v = [D(2, 1) - D(1, 2), D(0, 2) - D(2, 0), D(1, 0) - D(0, 1)].map((x) => x / 2);
    const sine = Math.hypot(...v);
    const angle = Math.atan2(sine, (D(0, 0) + D(1, 1) + D(2, 2) - 1) / 2);
    const ratio = sine > 1e-9 ? angle / sine : 1;
    for (let i = 0; i < 3; i++) e[row + 3 + i] = ratio * v[i];
    return;
  }
  // the held axis in the frame
  const [x, y, z] = [0, 1, 2].map((c) => R[c] * held[2] + R[3 + c] * held[5] + R[6 + c] * held[8]);
  const sine = Math.hypot(x, y);
  const ratio = sine > 0 ? Math.atan2(sine, z) / sine : 0;
  e[row + 3] = -y * ratio;
  e[row + 4] = x * ratio;
}

const ROOT = { R: Float64Array.of(1, 0, 0, 0, 1, 0, 0, 0, 1), p: new Float64Array(3) };

// A frame or a base on its chain of joints: `at` on the last one, R and p in the root.
function carried({ chain, ...numbers }) {
  return {
    chain,
    at: doubles(numbers, ["R", "p"]),
    R: new Float64Array(9),
    p: new Float64Array(3),
  };
}

// Write the three numbers of t from i on in the axes of R.
function turnedBack(R, t, i) {
  const x = t[i];
  const y = t[i + 1];
  const z = t[i + 2];
  for (let c = 0; c < 3; c++) t[i + c] = R[c] * x + R[3 + c] * y + R[6 + c] * z;
}

// The placement of a frame relative to a base, in its place.
function relative(base, { R, p }) {
  for (let i = 0; i < 3; i++) p[i] -= base.p[i];
  turnedBack(base.R, p, 0);
  const columns = Float64Array.from(R, (_, i) => R[3 * (i % 3) + Math.floor(i / 3)]);
  for (let c = 0; c < 3; c++) {
    turnedBack(base.R, columns, 3 * c);
    for (let i = 0; i < 3; i++) R[3 * i + c] = columns[3 * c + i];
  }
}

// The same numbers, as rows of doubles, with which a browser computes faster.
export function doubles(data, names) {
  return Object.fromEntries(names.map((name) => [name, Float64Array.from(data[name])]));
}

function applied(R, x, y) {
  for (let i = 0; i < 3; i++) y[i] = R[3 * i] * x[0] + R[3 * i + 1] * x[1] + R[3 * i + 2] * x[2];
}

function placedIn({ R, p }, x, y) {
  for (let i = 0; i < 3; i++)
    y[i] = p[i] + R[3 * i] * x[0] + R[3 * i + 1] * x[1] + R[3 * i + 2] * x[2];
}

// C = A B; C may be A.
function product(A, B, C) {
  for (let i = 0; i < 3; i++) {
    const x = A[3 * i];
    const y = A[3 * i + 1];
    const z = A[3 * i + 2];
    for (let j = 0; j < 3; j++) C[3 * i + j] = x * B[j] + y * B[3 + j] + z * B[6 + j];
  }
}

// About the unit vector a by an angle: Rodrigues.
function rotation(a, angle, E) {
  const x = a[0];
  const y = a[1];
  const z = a[2];
  const s = Math.sin(angle);
  const c = Math.cos(angle);
  const d = 1 - c;
  E[0] = c + d * x * x;
  E[1] = d * x * y - s * z;
  E[2] = d * x * z + s * y;
  E[3] = d * y * x + s * z;
  E[4] = c + d * y * y;
  E[5] = d * y * z - s * x;
  E[6] = d * z * x - s * y;
  E[7] = d * z * y + s * x;
  E[8] = c + d * z * z;
}
