// The controls on an arm: J⁺ and the repeatable inverse give the smallest q̇ with A q̇ = b, for A =
// J, b = ẋ, and for A = [J; Vᵀ], b = [ẋ; 0]. Matrices are in rows.

import { CellPotentials } from "./potentials.js";
import { doubles } from "./kinematics.js";

// sine of the angle between a row and the rows before it, below which A is singular
const RANK = 1e-6;

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
    this.stand(chain.start);
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
      if (part.chart) part.add(q, this.chain.frames[0], A, h, m * n);
      else if (part.waves) series(part, q, A, h, m * n, n, r);
      else polynomials(part, q, A, h, m * n, n, r);
    }
    return h;
  }

  // Solve A x = b at q, with b's task part as given and `gap` times c − h below it; false where A
  // is singular.
  solve(q, xdot, gap = 0) {
    this.place(q);
    return this.solveHere(xdot, gap);
  }

  // The same where A was last written.
  solveHere(xdot, gap) {
    const { r, b } = this;
    const { m } = this.chain;
    b.set(xdot);
    for (let i = 0; i < r; i++) b[m + i] = gap * (this.leaf[i] - this.h[i]);
    return this.least();
  }

  // Solve for the self-motion at q that changes level k alone, at the rate 1.
  slide(q, k) {
    this.place(q);
    this.b.fill(0);
    this.b[this.chain.m + k] = 1;
    return this.least();
  }

  // Write A = [J; Vᵀ] and h at q.
  place(q) {
    this.chain.place(q);
    this.chain.jacobian(this.A);
    if (this.r) this.levels(q);
  }

  least() {
    return leastSolution(this.A, this.rows, this.chain.n, this.b, this.L, this.x) > RANK;
  }

  // Begin at q, on its leaf.
  stand(q) {
    this.start = Float64Array.from(q);
    this.place(this.start);
    this.leaf = Array.from(this.h);
  }

  // The smallest sine of the angle between a row of J and those before it, where A was last solved;
  // 0 where J loses rank.
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

  // The leaf margin σ_min(Nᵀ V̂) where A was last solved: with A = L Q, the rows of V are C and D
  // in Q's first and last rows.
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

// Make the rows of A orthonormal, A = L Q, and put the shortest x with A x = b into x; gives the
// smallest sine.
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
  if (part.chart) return new CellPotentials(part.chart);
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
    ...doubles(part, ["center", "scale"]),
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

// A loop's pieces, as rp.follow takes them: for each frame points (P, 3), the first again at the
// end, or null where it holds still; `speed` of the first that moves, m/s, `steps` per cycle.
export function pieces(paths, speed, steps) {
  const lead = paths.findIndex(Boolean);
  const edges = paths[lead]
    .slice(1)
    .map((_, i) => paths.map((path) => (path ? difference(path[i + 1], path[i]) : [0, 0, 0])))
    .filter((edge) => Math.hypot(...edge[lead]) > 1e-9);
  const length = edges.reduce((sum, edge) => sum + Math.hypot(...edge[lead]), 0);
  return edges.map((edge) => {
    const size = Math.hypot(...edge[lead]);
    const count = Math.max(1, nearestEven((size / length) * steps));
    const v = edge.map((way) => way.map((x) => (speed * x) / size));
    return { count, h: size / speed / count, v };
  });
}

const difference = (p, q) => p.map((v, k) => v - q[k]);

// Follow a loop for some cycles by Runge and Kutta's method, open loop: configurations, and q̇ at
// the start of each step; `stopped`, the number of steps, where a joint would jump. The function of
// a cell has one value per place, to which each step is corrected: along an edge, where its slope
// jumps, steps alone would leave it. Pauses after each piece.
export function* followed(law, q0, path, cycles) {
  const { chain } = law;
  const { n } = chain;
  const perCycle = path.reduce((sum, { count }) => sum + count, 0);
  const T = cycles * perCycle;
  const Q = new Float64Array((T + 1) * n);
  const V = new Float64Array((T + 1) * n);
  const q = Float64Array.from(q0);
  const xdot = new Float64Array(chain.m);
  const motion = { Q, V, perCycle, margin: 1, cycles, stopped: null };
  Q.set(q);
  const goals = law.parts.some(({ chart }) => chart) ? handsAt(chain, q) : null;
  let step = 0;
  for (let cycle = 0; cycle < cycles; cycle++)
    for (const { count, h, v } of path) {
      taskVelocity(chain, v, xdot);
      for (let k = 0; k < count; k++, step++) {
        if (!rungeKutta(law, q, xdot, h, motion, step))
          return Object.assign(motion, { cycles: cycle, stopped: step });
        if (goals) {
          goals.forEach((goal, f) => v[f].forEach((rate, i) => (goal[i] += h * rate)));
          q.set(stepped(law, q, goals) || q);
        }
        Q.set(q, (step + 1) * n);
      }
      yield;
    }
  V.copyWithin(T * n, (T - 1) * n, T * n);
  return motion;
}

// Where the hands are at q, of each.
export function handsAt(chain, q) {
  chain.place(q);
  return chain.frames.map(({ p }) => Array.from(p));
}

// ẋ (m,) of frames that move with these velocities and do not turn.
function taskVelocity(chain, v, xdot) {
  xdot.fill(0);
  chain.frames.forEach(({ kind, rows, row }, f) => {
    if (kind !== "position") xdot.set(v[f], row);
    else for (let k = 0; k < rows.length; k++) xdot[row + k] = v[f][rows[k]];
  });
}

// One step from q, in place; q̇ at its start and the leaf margin of cycle 1 go into the motion.
function rungeKutta(law, q, xdot, h, motion, step) {
  const { chain, x } = law;
  const { n } = chain;
  const at = Float64Array.from(q);
  const sum = new Float64Array(n);
  for (let stage = 0; stage < 4; stage++) {
    if (law.chain.turning) law.chain.turnWith(at, xdot);
    if (!law.solve(at, xdot)) return false;
    if (stage === 0) {
      motion.V.set(x, step * n);
      if (step < motion.perCycle) motion.margin = Math.min(motion.margin, law.margin());
    }
    const next = h * (stage < 2 ? 0.5 : 1);
    const weight = stage === 1 || stage === 2 ? h / 3 : h / 6;
    for (let i = 0; i < n; i++) {
      sum[i] += weight * x[i];
      at[i] = q[i] + next * x[i];
    }
  }
  for (let i = 0; i < n; i++) {
    if (!(Math.abs(sum[i]) < Math.max(1, chain.size))) return false;
    q[i] += sum[i];
  }
  return true;
}

// Small steps of both the hands and the leaf, with feedback, from q to where the hands are at
// `targets`; null where it is singular.
export function stepped(law, q, targets, e = new Float64Array(law.chain.m)) {
  const next = Float64Array.from(q);
  for (let round = 0; round < 2; round++) {
    law.place(next);
    if (!law.solveHere(law.chain.error(targets, e), 1)) return null;
    for (let i = 0; i < next.length; i++) next[i] += law.x[i];
  }
  return next;
}

function nearestEven(x) {
  const f = Math.floor(x);
  const d = x - f;
  return d < 0.5 ? f : d > 0.5 ? f + 1 : f + (f % 2);
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
