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
    // the frames: each has m rows of J from `row` on, and stands at R, p
    this.m = 0;
    this.frames = data.frames.map((frame) => {
      const row = this.m;
      const m = frame.kind === "axis" ? 5 : frame.rows.length;
      this.m += m;
      const at = doubles(frame, ["R", "p"]);
      return { ...frame, at, R: new Float64Array(9), p: new Float64Array(3), row, m };
    });
    // the joints between base and frames, from the base outward
    this.chain = this.all.filter((j) => this.frames.some(({ chain }) => chain.includes(j)));
    this.turn = new Float64Array(9);
    this.twist = new Float64Array(6);
    this.place(data.start);
    // where the hands start, and as they are held
    this.homes = this.frames.map(({ p }) => Array.from(p));
    for (const frame of this.frames) frame.held = Array.from(frame.R);
  }

  // Put the joints of the chains, or these, and the frames where they are at q.
  place(q, which = this.chain) {
    for (const j of which) {
      const { parent, R, p, axis, turns, S, offset } = this.joints[j];
      const here = this.places[j];
      const before = parent < 0 ? BASE : this.places[parent];
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
    for (const { chain, at, R, p } of this.frames) {
      const last = this.places[chain.at(-1)];
      placedIn(last, at.p, p);
      product(last.R, at.R, R);
    }
  }

  // Write J (m, n) into A, at the q where the chain was placed last.
  jacobian(A) {
    A.fill(0, 0, this.m * this.n);
    for (const frame of this.frames) for (const j of frame.chain) this.addJoint(A, frame, j);
  }

  // Add what joint j moves of a frame to J.
  addJoint(A, { rows, kind, R, p, row, m }, j) {
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
    for (let k = 0; k < m; k++) {
      const inFrame = kind === "axis" && k >= 3;
      const rate = inFrame ? R[k - 3] * t[3] + R[k] * t[4] + R[k + 3] * t[5] : t[rows[k]];
      for (let i = 0; i < n; i++) if (S[i]) A[(row + k) * n + i] += S[i] * rate;
    }
  }

  // Write the task error (m,) to a position of each frame, held as at the start, into e.
  error(targets, e) {
    this.frames.forEach((frame, f) => frameError(frame, targets[f], e));
    return e;
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

const BASE = { R: Float64Array.of(1, 0, 0, 0, 1, 0, 0, 0, 1), p: new Float64Array(3) };

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
