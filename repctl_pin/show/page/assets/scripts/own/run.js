// A visitor's loop, followed by each arm for some cycles, in the form in which the player plays a study.

import { followed } from "../arm/law.js";

const SAMPLES = 126; // of a cycle
const TOO_FAST = 1 + 1e-9;
const RESOLVED = 0.01; // of the drift, within which the ends of cycles are with twice the steps
const CLOSED = 1e-5; // or this near, rad or m

// What the arms do on this way, see pieces(): {cycles, perCycle, runs}, a run an arm; as many cycles as all of them end.
export function computed(laws, arms, way, wanted) {
  const motions = laws.map((law) => followed(law, law.start, way, wanted));
  const cycles = Math.min(...motions.map((motion) => motion.cycles));
  const steps = motions[0].perCycle;
  const F = Math.min(SAMPLES, steps + 1);
  const rows = Array.from({ length: F }, (_, i) => Math.round((i * steps) / (F - 1)));
  const slower = Math.max(1, ...motions.map(({ V }, k) => busiest(laws[k].chain, V, steps))); // so much, that all rates of cycle 1 are allowed
  for (const { V } of motions)
    V.forEach((v, i) => {
      V[i] = v / slower;
    });
  const runs = cycles
    ? motions.map((motion, k) => runOf(laws[k], arms[k], motion, rows, cycles))
    : [];
  return { cycles, perCycle: F, runs, motions, slower };
}

// Whether an arm ends each cycle of its motion in the same place with twice the steps, on the way `fine`; where it does not, it
// passes close to a singularity, and how far it drifts is not a number.
export function resolved(law, motion, fine) {
  const { n } = law.chain;
  const again = followed(law, law.start, fine, motion.cycles);
  const end = ({ Q, perCycle }, c) => [...Q.subarray(c * perCycle * n, c * perCycle * n + n)];
  const apart = (p, q) => Math.hypot(...p.map((v, i) => v - q[i]));
  return (
    again.cycles === motion.cycles &&
    Array.from({ length: motion.cycles }, (_, c) => [end(motion, c + 1), end(again, c + 1)]).every(
      ([q, finer]) => apart(q, finer) <= Math.max(RESOLVED * apart(q, law.start), CLOSED),
    )
  );
}

// The largest share of a rate's limit in cycle 1.
function busiest(chain, V, steps) {
  let most = 0;
  for (let row = 0; row < steps; row++)
    most = Math.max(most, chain.hurried(V.subarray(row * chain.n, (row + 1) * chain.n)).share);
  return most;
}

function runOf(law, arm, { Q, V, perCycle, margin }, rows, cycles) {
  const { chain, start } = law;
  const { n } = chain;
  const F = rows.length;
  const frames = F * cycles;
  const at = (row) => Q.subarray(row * n, (row + 1) * n);
  const data = { ...arm.study.run.data, broken: firstBroken(chain, Q, V, perCycle, cycles) };
  const motion = new Float64Array(frames * (arm.stride + 6 + 3));
  const run = { data, motion, frames, perCycle: F };
  for (let c = 0, i = 0; c < cycles; c++)
    for (const row of rows) drawnAt(chain, arm, at(c * perCycle + row), run, i++);
  data.drift = Array.from({ length: cycles }, (_, c) =>
    Math.hypot(...at((c + 1) * perCycle).map((v, j) => v - start[j])),
  );
  arm.use(run);
  const ends = data.drift.map((_, c) => offAt(arm, (c + 1) * F - 1, chain)); // of each body, after each cycle
  data.off = ends.map((off, c) => [c ? Math.max(0, ...ends[c - 1]) : 0, Math.max(0, ...off)]);
  let squares = 0;
  for (let i = 0; i < perCycle * n; i++) squares += V[i] * V[i];
  const turned = ends
    .map((_, c) => at((c + 1) * perCycle))
    .map((q) =>
      chain.own(q).map((v, i) => (chain.turns[i] ? Math.abs(v - chain.own(start)[i]) : 0)),
    );
  const hand = ends.map((_, c) =>
    arm.point("tip", 0, (c + 1) * F - 1).distanceTo(arm.point("tip", 0, 0)),
  );
  const others = data.drift.map((_, c) => othersOff(chain, at(0), at((c + 1) * perCycle)));
  return Object.assign(run, {
    ends,
    others,
    turned,
    hand,
    margin,
    speed: Math.sqrt(squares / perCycle),
  });
}

// Write where an arm's bodies, its tip, its elbow, and the joint that breaks its limit are at q into frame i of a run.
export function drawnAt(chain, arm, q, { motion, frames, data }, i) {
  const { stride } = arm;
  const rides = ridesOf(chain, arm);
  const T = MeshCat.THREE;
  chain.place(q, chain.all);
  const turns = chain.places.map(({ R }) => quaternion(R));
  rides.forEach((ride, k) => {
    if (!ride) return;
    const { R, p } = chain.places[ride.joint];
    const at = i * stride + 7 * k;
    const before = at - stride;
    const way = ride.turn.clone().premultiply(turns[ride.joint]);
    const [x, y, z] = ride.point;
    for (let c = 0; c < 3; c++)
      motion[at + c] = p[c] + R[3 * c] * x + R[3 * c + 1] * y + R[3 * c + 2] * z;
    const last = i ? new T.Quaternion().fromArray(motion, before + 3) : way;
    if (last.dot(way) < 0) way.set(-way.x, -way.y, -way.z, -way.w); // a rotation has two
    way.toArray(motion, at + 3);
  });
  chain.place(q);
  const tips = frames * stride;
  motion.set(chain.p, tips + 3 * i);
  motion.set(chain.places[chain.elbow].p, tips + 3 * frames + 3 * i);
  if (data.broken)
    motion.set(chain.places[chain.first[data.broken.joint]].p, tips + 6 * frames + 3 * i);
}

// On which joint each body of an arm rides, and where on it: from the study's first frame. Null for one that stands.
function ridesOf(chain, arm) {
  if (arm.rides) return arm.rides;
  const { run, start } = arm.study;
  const T = MeshCat.THREE;
  chain.place(chain.start, chain.all);
  const moving = run.data.shapes
    .map((shape, s) => ({ shape, s }))
    .filter(({ shape }) => !shape.pose);
  arm.rides = moving.map(({ s }, k) => {
    const link = chain.links[s];
    if (!link || link[0] < 0) return null;
    const { R, p } = chain.places[link[0]];
    const at = start + 7 * k;
    const [x, y, z] = [0, 1, 2].map((c) => run.motion[at + c] - p[c]);
    const turn = new T.Quaternion()
      .fromArray(run.motion, at + 3)
      .normalize()
      .premultiply(quaternion(R).conjugate());
    return {
      joint: link[0],
      point: [0, 1, 2].map((c) => R[c] * x + R[3 + c] * y + R[6 + c] * z),
      turn,
    };
  });
  return arm.rides;
}

function quaternion(R) {
  const T = MeshCat.THREE;
  return new T.Quaternion().setFromRotationMatrix(
    new T.Matrix4().set(R[0], R[1], R[2], 0, R[3], R[4], R[5], 0, R[6], R[7], R[8], 0, 0, 0, 0, 1),
  );
}

// How far each end of another branch is at q from where it is at the start, m.
function othersOff(chain, start, q) {
  const local = chain.ends.map(({ joint, at }) => {
    chain.place(chain.start, chain.all);
    const { R, p } = chain.places[joint];
    return [0, 1, 2].map(
      (c) => R[c] * (at[0] - p[0]) + R[3 + c] * (at[1] - p[1]) + R[6 + c] * (at[2] - p[2]),
    );
  });
  const [from, to] = [start, q].map((one) => {
    chain.place(one, chain.all);
    return chain.ends.map(({ joint }, k) => {
      const { R, p } = chain.places[joint];
      const [x, y, z] = local[k];
      return [0, 1, 2].map((c) => p[c] + R[3 * c] * x + R[3 * c + 1] * y + R[3 * c + 2] * z);
    });
  });
  return from.map((p, k) => Math.hypot(...p.map((v, c) => v - to[k][c])));
}

// How far each moving body is at frame i from where it is at the start, m; 0 for what is not part of the arm.
function offAt(arm, i, chain) {
  arm.pose(i, 0);
  arm.pose(0, 0, arm.ghosts);
  return arm.moving.map(({ shape }, k) =>
    chain.links[shape] && chain.links[shape][1] ? arm.drift(k) : 0,
  );
}

// The first limit that a motion breaks, of a position or of a rate.
function firstBroken(chain, Q, V, perCycle, cycles) {
  const { n, names } = chain;
  for (let row = 0; row <= cycles * perCycle; row++) {
    const { joint, margin } = chain.nearest(Q.subarray(row * n, (row + 1) * n));
    const fast = chain.hurried(V.subarray(row * n, (row + 1) * n));
    const at = row / perCycle;
    const cycle = Math.min(Math.floor(at) + 1, cycles);
    if (margin < -1e-9)
      return { joint, at, cycle, words: `${names[joint]} past its limit`, name: names[joint] };
    if (fast.share > TOO_FAST)
      return {
        joint: fast.joint,
        at,
        cycle,
        words: `${names[fast.joint]} past its speed limit`,
        share: fast.share,
      };
  }
  return null;
}
