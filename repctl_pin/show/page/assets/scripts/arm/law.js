// The arm's kinematics and its controls, from the numbers that own_loop.py writes: J⁺ and the repeatable inverse are the
// least q̇ with A q̇ = b, for A = J, b = ẋ, and for A = [J; Vᵀ], b = [ẋ; 0]. Matrices are in rows.

const RANK = 1e-6; // sine of the angle between a row and the rows before it, below which A is singular

export class Chain {
  constructor(data) {
    Object.assign(this, data, { frame: numbers(data.frame, ["R", "p"]) });
    this.n = data.start.length;
    this.m = data.kind === "axis" ? 5 : data.rows.length;
    this.joints = data.joints.map((joint) => ({
      ...joint,
      ...numbers(joint, ["R", "p", "axis", "S"]),
    }));
    this.all = data.joints.map((joint, j) => j);
    this.places = data.joints.map(() => ({
      R: new Float64Array(9),
      p: new Float64Array(3),
      z: new Float64Array(3),
    }));
    Object.assign(this, {
      R: new Float64Array(9),
      p: new Float64Array(3),
      turn: new Float64Array(9),
      twist: new Float64Array(6),
    });
    this.place(data.start);
    Object.assign(this, { home: Array.from(this.p), held: Array.from(this.R) }); // where the hand starts, and as it is held
  }

  // Put the chain's joints, or these, and the frame where they are at q.
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
    const last = this.places[this.chain.at(-1)];
    placedIn(last, this.frame.p, this.p);
    product(last.R, this.frame.R, this.R);
  }

  // Write J (m, n) into A, at the q where the chain was placed last.
  jacobian(A) {
    const { n, m, rows, kind, R, p, twist: t } = this;
    A.fill(0, 0, m * n);
    for (const j of this.chain) {
      const { z, p: o } = this.places[j];
      const { turns, S } = this.joints[j];
      const x = p[0] - o[0];
      const y = p[1] - o[1];
      const w = p[2] - o[2];
      for (let i = 0; i < 3; i++) {
        t[i] = z[i];
        t[3 + i] = turns ? z[i] : 0;
      }
      if (turns) {
        t[0] = z[1] * w - z[2] * y;
        t[1] = z[2] * x - z[0] * w;
        t[2] = z[0] * y - z[1] * x;
      }
      for (let i = 0; i < n; i++)
        if (S[i])
          for (let k = 0; k < m; k++)
            A[k * n + i] +=
              S[i] *
              (kind !== "axis" || k < 3
                ? t[rows[k]]
                : R[k - 3] * t[3] + R[k] * t[4] + R[k + 3] * t[5]);
    }
  }

  // Write the task error (m,) to a position, with the hand held as at the start, of the chain as it is placed.
  error(target, e) {
    const { rows, kind, p, R, held } = this;
    if (kind === "position") {
      rows.forEach((row, k) => {
        e[k] = target[row] - p[row];
      });
      return e;
    }
    for (let i = 0; i < 3; i++) e[i] = target[i] - p[i];
    const D = (a, b) =>
      held[3 * a] * R[3 * b] + held[3 * a + 1] * R[3 * b + 1] + held[3 * a + 2] * R[3 * b + 2]; // of held Rᵀ
    if (kind === "pose") {
      const v = [D(2, 1) - D(1, 2), D(0, 2) - D(2, 0), D(1, 0) - D(0, 1)].map((x) => x / 2);
      const sine = Math.hypot(...v);
      const ratio =
        sine > 1e-9 ? Math.atan2(sine, (D(0, 0) + D(1, 1) + D(2, 2) - 1) / 2) / sine : 1;
      v.forEach((x, i) => {
        e[3 + i] = ratio * x;
      });
    } else {
      const [x, y, z] = [0, 1, 2].map(
        (c) => R[c] * held[2] + R[3 + c] * held[5] + R[6 + c] * held[8],
      );
      const sine = Math.hypot(x, y);
      const ratio = sine > 1e-12 ? Math.atan2(sine, z) / sine : 0;
      e[3] = -y * ratio;
      e[4] = x * ratio;
    }
    return e;
  }

  // Positions, or rates, of the robot's own joints: q = T ψ.
  own(q) {
    return this.T
      ? this.T.map((row) => row.reduce((sum, t, i) => sum + t * q[i], 0))
      : Array.from(q);
  }

  // The joint that is nearest to its limit, and how far it is from there; below 0 beyond it.
  nearest(q) {
    const margins = this.own(q).map((v, i) =>
      Math.min(v - (this.lower[i] ?? -Infinity), (this.upper[i] ?? Infinity) - v),
    );
    const joint = margins.reduce((best, v, i) => (v < margins[best] ? i : best), 0);
    return { joint, margin: margins[joint] };
  }

  // The joint whose rate is the largest share of its limit, and that share.
  hurried(qdot) {
    const shares = this.own(qdot).map((v, i) => Math.abs(v) / (this.fastest[i] ?? Infinity));
    const joint = shares.reduce((best, v, i) => (v > shares[best] ? i : best), 0);
    return { joint, share: shares[joint] };
  }
}

// One control on a chain: J⁺, or with potentials the inverse that keeps them.
export class Law {
  constructor(chain, parts) {
    const { n, m } = chain;
    const r = parts.length ? n - m : 0;
    Object.assign(this, {
      chain,
      parts: parts.map(prepared),
      r,
      rows: m + r,
      A: new Float64Array((m + r) * n),
      L: new Float64Array((m + r) ** 2),
      b: new Float64Array(m + r),
      h: new Float64Array(r),
      x: new Float64Array(n),
    });
    this.leaf = Array.from(this.levels(chain.start));
  }

  // h(q); writes Vᵀ below J.
  levels(q) {
    const {
      chain: { n, m },
      A,
      h,
      r,
      parts,
    } = this;
    A.fill(0, m * n);
    h.fill(0);
    for (const part of parts) {
      if (part.waves) series(part, q, A, h, m * n, n, r);
      else polynomials(part, q, A, h, m * n, n, r);
    }
    return h;
  }

  // Solve A x = b at q, with b's task part as given and `gap` times c − h below it; false where A is singular.
  solve(q, xdot, gap = 0) {
    const { chain, rows, r, A, L, b, x } = this;
    const { n, m } = chain;
    chain.place(q);
    chain.jacobian(A);
    if (r) this.levels(q);
    for (let i = 0; i < rows; i++)
      b[i] = i < m ? xdot[i] : gap * (this.leaf[i - m] - this.h[i - m]);
    return leastSolution(A, rows, n, b, L, x) > RANK;
  }

  // The smallest sine of the angle between a row of J and those before it, where A was last solved; 0 where J loses rank.
  sine() {
    const {
      rows,
      L,
      chain: { m },
    } = this;
    let least = 1;
    for (let i = 0; i < m; i++)
      least = Math.min(
        least,
        L[i * rows + i] / Math.hypot(...L.subarray(i * rows, i * rows + i + 1)),
      );
    return least;
  }

  // The leaf margin σ_min(Nᵀ V̂) where A was last solved: with A = L Q, the rows of V are C and D in Q's first and last rows.
  margin() {
    const {
      r,
      rows,
      L,
      chain: { m },
    } = this;
    if (!r) return 1;
    const dot = (i, j, from) => {
      let sum = 0;
      for (let k = from; k < rows; k++) sum += L[(m + i) * rows + k] * L[(m + j) * rows + k];
      return sum;
    };
    const sized = (from) =>
      Array.from({ length: r }, (_, i) =>
        Array.from(
          { length: r },
          (__, j) => dot(i, j, from) / Math.sqrt(dot(i, i, 0) * dot(j, j, 0)),
        ),
      );
    return Math.sqrt(Math.max(0, 1 / largestEigenvalue(solved(sized(m), sized(0)))));
  }
}

// Make the rows of A orthonormal, A = L Q, and put the shortest x with A x = b into x; gives the smallest sine.
function leastSolution(A, rows, n, b, L, x) {
  let least = 1;
  for (let i = 0; i < rows; i++) {
    const row = i * n;
    let size = 0;
    let left = 0;
    for (let k = 0; k < n; k++) size += A[row + k] * A[row + k];
    for (let j = 0; j < rows; j++) L[i * rows + j] = 0;
    for (let pass = 0; pass < 2; pass++)
      // twice is enough
      for (let j = 0; j < i; j++) {
        const other = j * n;
        let along = 0;
        for (let k = 0; k < n; k++) along += A[row + k] * A[other + k];
        for (let k = 0; k < n; k++) A[row + k] -= along * A[other + k];
        L[i * rows + j] += along;
      }
    for (let k = 0; k < n; k++) left += A[row + k] * A[row + k];
    L[i * rows + i] = left = Math.sqrt(left);
    least = Math.min(least, left / Math.sqrt(size));
    for (let k = 0; k < n; k++) A[i * n + k] /= left;
  }
  x.fill(0);
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < i; j++) b[i] -= L[i * rows + j] * b[j];
    b[i] /= L[i * rows + i];
    for (let k = 0; k < n; k++) x[k] += b[i] * A[i * n + k];
  }
  return Number.isFinite(least) ? least : 0;
}

// The numbers of potentials in rows of their own; a polynomial's term is a product of factors u_i.
function prepared(part) {
  if (part.waves)
    return {
      waves: part.waves.map((row) => Float64Array.from(row)),
      sines: part.sines,
      cosines: part.cosines,
    };
  const ends = [0];
  for (const [factors] of part.terms) ends.push(ends.at(-1) + factors.length);
  return {
    joints: Int32Array.from(part.joints),
    ...numbers(part, ["center", "scale"]),
    u: new Float64Array(part.joints.length),
    ends: Int32Array.from(ends),
    factors: Int32Array.from(part.terms.flatMap(([factors]) => factors)),
    weights: Float64Array.from(part.terms.flatMap(([, weights]) => weights)),
  };
}

// Add r polynomials of u = (q − center) / scale, and their gradients.
function polynomials({ joints, center, scale, u, ends, factors, weights }, q, A, h, at, n, r) {
  for (let i = 0; i < u.length; i++) u[i] = (q[joints[i]] - center[i]) / scale[i];
  for (let t = 0; t < ends.length - 1; t++) {
    let whole = 1;
    for (let a = ends[t]; a < ends[t + 1]; a++) {
      const i = factors[a];
      let slope = 1 / scale[i];
      for (let b = ends[t]; b < ends[t + 1]; b++) if (b !== a) slope *= u[factors[b]];
      for (let s = 0; s < r; s++) A[at + s * n + joints[i]] += weights[t * r + s] * slope;
      whole *= u[i];
    }
    for (let s = 0; s < r; s++) h[s] += weights[t * r + s] * whole;
  }
}

// Add r Fourier series, and their gradients.
function series({ waves, sines, cosines }, q, A, h, at, n, r) {
  waves.forEach((wave, w) => {
    let phase = 0;
    for (let i = 0; i < n; i++) phase += wave[i] * q[i];
    const sine = Math.sin(phase);
    const cosine = Math.cos(phase);
    for (let s = 0; s < r; s++) {
      const slope = cosine * sines[w][s] - sine * cosines[w][s];
      h[s] += sine * sines[w][s] + cosine * cosines[w][s];
      for (let i = 0; i < n; i++) A[at + s * n + i] += slope * wave[i];
    }
  });
}

// A loop's pieces, as rp.follow takes them: points (P, 3), the first again at the end; `speed` in m/s, `steps` a cycle.
export function pieces(points, speed, steps) {
  const edges = points
    .slice(1)
    .map((p, i) => p.map((v, k) => v - points[i][k]))
    .filter((edge) => Math.hypot(...edge) > 1e-9);
  const length = edges.reduce((sum, edge) => sum + Math.hypot(...edge), 0);
  return edges.map((edge) => {
    const size = Math.hypot(...edge);
    const count = Math.max(1, nearestEven((size / length) * steps));
    return { count, h: size / speed / count, v: edge.map((x) => (speed * x) / size) };
  });
}

// Follow a loop for some cycles by Runge and Kutta's method, open loop: configurations, and q̇ at the start of each step;
// fewer cycles, with `stopped`, where a joint would jump.
export function followed(law, q0, way, cycles) {
  const { chain, x } = law;
  const { n, m, kind, rows } = chain;
  const perCycle = way.reduce((sum, { count }) => sum + count, 0);
  const T = cycles * perCycle;
  const Q = new Float64Array((T + 1) * n);
  const V = new Float64Array((T + 1) * n);
  const q = Float64Array.from(q0);
  const at = new Float64Array(n);
  const sum = new Float64Array(n);
  const xdot = new Float64Array(m);
  Q.set(q);
  let step = 0;
  let margin = 1;
  for (let cycle = 0; cycle < cycles; cycle++)
    for (const { count, h, v } of way) {
      if (kind === "position")
        rows.forEach((row, k) => {
          xdot[k] = v[row];
        });
      else xdot.set(v); // the hand does not turn
      for (let k = 0; k < count; k++, step++) {
        at.set(q);
        sum.fill(0);
        for (let stage = 0; stage < 4; stage++) {
          if (!law.solve(at, xdot)) return { Q, V, perCycle, margin, cycles: cycle, stopped: true };
          if (stage === 0) V.set(x, step * n);
          if (stage === 0 && cycle === 0) margin = Math.min(margin, law.margin());
          const next = h * (stage < 2 ? 0.5 : 1);
          const weight = stage === 1 || stage === 2 ? h / 3 : h / 6;
          for (let i = 0; i < n; i++) {
            sum[i] += weight * x[i];
            at[i] = q[i] + next * x[i];
          }
        }
        for (let i = 0; i < n; i++) {
          if (!(Math.abs(sum[i]) < Math.max(1, chain.size)))
            return { Q, V, perCycle, margin, cycles: cycle, stopped: true };
          q[i] += sum[i];
        }
        Q.set(q, (step + 1) * n);
      }
    }
  V.copyWithin(T * n, (T - 1) * n, T * n);
  return { Q, V, perCycle, margin, cycles, stopped: false };
}

// Small steps of both the hand and the leaf, with feedback, from q to where the hand is at `target`; null where it is singular.
export function stepped(law, q, target, e = new Float64Array(law.chain.m)) {
  const next = Float64Array.from(q);
  for (let round = 0; round < 2; round++) {
    law.chain.place(next);
    if (!law.solve(next, law.chain.error(target, e), 1)) return null;
    for (let i = 0; i < next.length; i++) next[i] += law.x[i];
  }
  return next;
}

const BASE = { R: Float64Array.of(1, 0, 0, 0, 1, 0, 0, 0, 1), p: new Float64Array(3) };

// The same numbers, as rows of doubles, with which a browser computes faster.
function numbers(data, names) {
  return Object.fromEntries(names.map((name) => [name, Float64Array.from(data[name])]));
}

function nearestEven(x) {
  const f = Math.floor(x);
  const d = x - f;
  return d < 0.5 ? f : d > 0.5 ? f + 1 : f + (f % 2);
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

// S⁻¹ B of a small positive definite S, by elimination.
function solved(S, B) {
  const M = S.map((row, i) => [...row, ...B[i]]);
  const r = S.length;
  for (let j = 0; j < r; j++)
    for (let i = 0; i < r; i++) {
      if (i === j) continue;
      const f = M[i][j] / M[j][j];
      for (let k = j; k < 2 * r; k++) M[i][k] -= f * M[j][k];
    }
  return M.map((row, i) => row.slice(r).map((v) => v / row[i]));
}

// The largest eigenvalue of a small matrix with positive ones, by squaring it.
function largestEigenvalue(M) {
  let scale = 0;
  let P = M;
  for (let round = 1; round <= 20; round++) {
    const trace = P.reduce((sum, row, i) => sum + row[i], 0);
    const N = P.map((row) => row.map((v) => v / trace));
    scale += Math.log(trace) / 2 ** (round - 1);
    P = N.map((row) => N.map((_, j) => row.reduce((sum, v, k) => sum + v * N[k][j], 0)));
  }
  return Math.exp(scale + Math.log(P.reduce((sum, row, i) => sum + row[i], 0)) / 2 ** 20);
}
