// A visitor's loop, followed by each arm for some cycles, in the form in which the player plays a
// study.

import { followed, handsAt, pieces } from "../arm/law.js";

const SAMPLES = 126; // of a cycle
const TOO_FAST = 1 + 1e-9;
const RESOLVED = 0.01; // of the drift, within which the ends of cycles are with twice the steps
const CLOSED = 1e-5; // or this near, rad or m
const OFF_PATH = 0.01; // of the arm, from which a hand has left its path
const LOST = 1e-3; // of the arm, from which a hand is not back: the steps were too long

// What the arms do on these paths, see pieces(): {cycles, perCycle, seconds, length, runs,
// motions}, a run per arm. An arm that comes close to a singularity stands still from there on; its
// run says so by data.lost, in cycles. Pauses often; nothing that is shown changes before the last
// pause.
export function* computed(laws, arms, paths, wanted) {
  const { chain } = laws[0];
  const path = pieces(paths, chain.speed, chain.steps);
  const fine = pieces(paths, chain.speed, 2 * chain.steps);
  const motions = [];
  for (const law of laws) {
    const motion = yield* followed(law, law.start, path, wanted);
    motion.last = yield* criticalRow(law, motion, path, fine);
    if (motion.last !== null) stopMotion(motion, chain.n, wanted);
    motions.push(motion);
  }
  const { perCycle } = motions[0];
  // as many cycles as one arm completes
  const done = ({ last }) => (last === null ? wanted : Math.ceil((last + 1) / perCycle));
  const cycles = Math.max(...motions.map(done));
  // so much slower that all rates of cycle 1 are allowed
  const kept = motions.filter(({ last }) => last === null || last >= perCycle);
  const slower = Math.max(1, ...kept.map(({ V }) => maxRateShare(chain, V, perCycle)));
  for (const { V } of motions) for (let i = 0; i < V.length; i++) V[i] /= slower;
  const F = Math.min(SAMPLES, perCycle + 1);
  const rows = evenly(F, perCycle);
  const length = path.reduce((sum, { count, h }) => sum + count * h, 0) * chain.speed;
  const runs = [];
  for (const [k, motion] of motions.entries())
    runs.push(yield* runOf(laws[k], arms[k], motion, rows, cycles));
  yield;
  // all at once: an arm that was measured shows another run
  runs.forEach((run, k) => measure(run, laws[k], arms[k], motions[k], cycles));
  return { cycles, perCycle: F, seconds: (slower * length) / chain.speed, length, runs, motions };
}

const evenly = (count, last) =>
  Array.from({ length: count }, (_, i) => Math.round((i * last) / (count - 1)));

// The row of a motion from which on it cannot be computed: where a joint would jump, or if twice
// the steps lead elsewhere, where the joints are fastest, near a singularity, as long as the hands
// are on their path. Null without.
function* criticalRow(law, motion, path, fine) {
  const { stopped, perCycle } = motion;
  const inCycle = stopped === null ? null : Math.floor(stopped / perCycle) + 1;
  const cycle = inCycle || (yield* unresolvedCycle(law, motion, fine));
  if (cycle === null) return null;
  const { n } = law.chain;
  const speed = (row) => Math.hypot(...motion.V.subarray(row * n, (row + 1) * n));
  let critical = (cycle - 1) * perCycle;
  const till = critical + rowsOnPath(law.chain, motion, cycle, path);
  if (inCycle && till >= stopped) return stopped;
  for (let row = critical; row < till; row++) if (speed(row) > speed(critical)) critical = row;
  return critical;
}

// How many rows of a cycle the hands are on their path, at least one.
function rowsOnPath(chain, { Q, perCycle }, cycle, path) {
  const { n, frames, size } = chain;
  const first = (cycle - 1) * perCycle * n;
  const goals = handsAt(chain, Q.subarray(first, first + n));
  let row = 0;
  for (const { count, h, v } of path)
    for (let k = 0; k < count; k++) {
      goals.forEach((goal, f) => v[f].forEach((rate, i) => (goal[i] += h * rate)));
      row++;
      chain.place(Q.subarray(first + row * n, first + (row + 1) * n));
      const off = ({ p, rows }, f) => rows.map((i) => (i < 3 ? p[i] - goals[f][i] : 0));
      if (frames.some((frame, f) => Math.hypot(...off(frame, f)) > OFF_PATH * size)) return row;
    }
  return perCycle;
}

// The first cycle at whose end a hand is not back, or an arm elsewhere with twice the steps; null
// without. If an arm is back after cycle 1, all cycles are alike.
function* unresolvedCycle(law, motion, fine) {
  const { n } = law.chain;
  const back = gapAt(law, motion, 1) < CLOSED;
  const again = yield* followed(law, law.start, fine, back ? 1 : motion.cycles);
  const end = ({ Q, perCycle }, c) => Q.subarray(c * perCycle * n, (c * perCycle + 1) * n);
  const apart = (p, q) => Math.hypot(...p.map((v, i) => v - q[i]));
  for (let c = 1; c <= (back ? 1 : motion.cycles); c++) {
    const q = end(motion, c);
    if (handOff(law.chain, motion.Q, q) > LOST * law.chain.size) return c;
    const off = c > again.cycles ? Infinity : apart(q, end(again, c));
    if (off > Math.max(RESOLVED * gapAt(law, motion, c), CLOSED)) return c;
  }
  return null;
}

// How far the joints are from the start at the end of a cycle.
function gapAt({ chain, start }, { Q, perCycle }, c) {
  const at = c * perCycle * chain.n;
  return Math.hypot(...start.map((v, i) => Q[at + i] - v));
}

// How far a hand is at q from where it is at the start of a motion, m.
function handOff(chain, Q, q) {
  const [from, to] = [Q.subarray(0, chain.n), q].map((one) => handsAt(chain, one));
  return Math.max(...from.map((p, f) => Math.hypot(...p.map((v, c) => v - to[f][c]))));
}

// Leave a motion where it is from its last row on.
function stopMotion({ Q, V, perCycle, last }, n, cycles) {
  for (let row = last + 1; row <= cycles * perCycle; row++)
    Q.copyWithin(row * n, last * n, (last + 1) * n);
  V.fill(0, last * n);
}

// The largest share of a rate's limit in cycle 1.
function maxRateShare(chain, V, steps) {
  let most = 0;
  for (let row = 0; row < steps; row++)
    most = Math.max(most, chain.fastestJoint(V.subarray(row * chain.n, (row + 1) * chain.n)).share);
  return most;
}

// The frames of a run: how the arm stands at these rows of each cycle.
function* runOf(law, arm, { Q, V, perCycle, last }, rows, cycles) {
  const { chain } = law;
  const { n } = chain;
  const F = rows.length;
  const frames = F * cycles;
  const at = (row) => Q.subarray(row * n, (row + 1) * n);
  // the bodies, the hands, the elbows and the mark at each sample
  const broken =
    last === null
      ? yield* firstViolation(chain, Q, V, perCycle, cycles)
      : lostAt(chain, at(last), last, perCycle);
  const lost = last === null ? Infinity : last / perCycle;
  const data = { ...arm.study.run.data, broken, lost };
  const motion = new Float64Array(frames * (arm.stride + 6 * arm.chains + 3));
  const run = { data, motion, frames, perCycle: F };
  for (let c = 0, i = 0; c < cycles; c++) {
    for (const row of rows) drawnAt(chain, arm, at(c * perCycle + row), run, i++);
    yield;
  }
  run.joints = jointRows(arm, at, perCycle, cycles);
  return run;
}

// Measure a run at the ends of its cycles; its arm shows it from then on.
function measure(run, { chain, start }, arm, { Q, V, perCycle, margin }, cycles) {
  const { n } = chain;
  const { data, perCycle: F } = run;
  const ends = Array.from({ length: cycles }, (_, c) =>
    Q.subarray((c + 1) * perCycle * n, ((c + 1) * perCycle + 1) * n),
  );
  // how far each body is off after each cycle
  data.drift = ends.map((q) => Math.hypot(...q.map((v, j) => v - start[j])));
  arm.use(run);
  const off = ends.map((_, c) => offAt(arm, (c + 1) * F - 1, chain));
  const most = off.map((each, c) => (c + 1 > data.lost ? null : Math.max(0, ...each)));
  data.off = most.map((v, c) => [c ? most[c - 1] : 0, v]);
  // root mean squares from the first cycle to the end of each
  let squares = 0;
  const speeds = ends.map((_, c) => {
    for (let i = c * perCycle * n; i < (c + 1) * perCycle * n; i++) squares += V[i] * V[i];
    return Math.sqrt(squares / ((c + 1) * perCycle));
  });
  const turned = ends.map((q) =>
    Array.from(q, (v, i) => (chain.turns[i] ? Math.abs(v - start[i]) : 0)),
  );
  const others = ends.map((q) => othersOff(chain, Q.subarray(0, n), q));
  Object.assign(run, { ends: off, others, turned, margin, speeds });
}

// The joints at the samples of the study's plot of them.
function jointRows(arm, at, perCycle, cycles) {
  const { count, n } = arm.study.run.joints;
  const index = evenly(count, perCycle);
  const values = new Float64Array(cycles * count * n);
  for (let c = 0, i = 0; c < cycles; c++)
    for (const row of index) values.set(at(c * perCycle + row), n * i++);
  return { at: index.map((row) => row / perCycle), count, n, values };
}

// What is marked where a motion ends close to a singularity.
function lostAt(chain, q, row, perCycle) {
  chain.place(q);
  return {
    at: row / perCycle,
    cycle: Math.floor(row / perCycle) + 1,
    words: "fails close to a singularity",
    place: chain.tip(chain.led || 0),
  };
}

// Write where an arm's bodies, its hands, its elbows, and what breaks a limit are at q into frame i
// of a run.
export function drawnAt(chain, arm, q, { motion, frames, data }, i) {
  const { stride } = arm;
  const rides = ridesOf(chain, arm);
  chain.place(q, chain.all);
  const turns = chain.places.map(({ R }) => quaternion(R));
  rides.forEach((ride, k) => {
    if (ride) drawBody(motion, i * stride + 7 * k, i ? stride : 0, ride, chain, turns);
  });
  let at = frames * stride;
  const write = (points, from = at + 3 * points.length * i) => {
    points.forEach((p, k) => motion.set(p, from + 3 * k));
    at += 3 * points.length * frames;
  };
  write(chain.frames.map((_, f) => chain.tip(f)));
  write(chain.frames.map(({ elbow }) => chain.places[elbow].p));
  const { broken } = data;
  if (broken) write([broken.place || chain.places[chain.first[broken.joint]].p]);
}

// Write the pose of a body that rides on a joint; `back` numbers before is that of the last frame.
function drawBody(motion, at, back, ride, chain, turns) {
  const T = MeshCat.THREE;
  const { R, p } = chain.places[ride.joint];
  const turn = ride.turn.clone().premultiply(turns[ride.joint]);
  const [x, y, z] = ride.point;
  for (let c = 0; c < 3; c++)
    motion[at + c] = p[c] + R[3 * c] * x + R[3 * c + 1] * y + R[3 * c + 2] * z;
  // a rotation has two quaternions: the one nearer to the last
  const last = back ? new T.Quaternion().fromArray(motion, at - back + 3) : turn;
  if (last.dot(turn) < 0) turn.set(-turn.x, -turn.y, -turn.z, -turn.w);
  turn.toArray(motion, at + 3);
}

// On which joint each body of an arm rides, and where on it: from the study's first frame; last, a
// workpiece with what is drawn on it. Null for one that stands.
function ridesOf(chain, arm) {
  if (arm.rides) return arm.rides;
  const { run, start } = arm.study;
  const T = MeshCat.THREE;
  chain.place(chain.start, chain.all);
  const moving = run.data.shapes.flatMap((shape, s) => (shape.pose ? [] : [chain.links[s]]));
  const joints = moving.map((link) => (link ? link[0] : -1));
  if (run.data.carried) joints.push(chain.frames[0].base.chain.at(-1));
  arm.rides = joints.map((joint, k) => {
    if (joint < 0) return null;
    const { R, p } = chain.places[joint];
    const at = start + 7 * k;
    const [x, y, z] = [0, 1, 2].map((c) => run.motion[at + c] - p[c]);
    const turn = new T.Quaternion()
      .fromArray(run.motion, at + 3)
      .normalize()
      .premultiply(quaternion(R).conjugate());
    return {
      joint,
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

// How far each body of this part of an arm, or of all its parts, is at q from where it is at the
// start, m.
export function bodiesOff(chain, arm, q, part) {
  const bodies = cornersAtStart(chain, arm);
  chain.place(q, chain.all);
  return bodies.map(({ name, joint, local, start }) => {
    if (!name || (part && name !== part)) return 0;
    const at = pointsOn(chain.places[joint], local);
    let most = 0;
    for (let i = 0; i < at.length; i += 3)
      most = Math.max(
        most,
        Math.hypot(at[i] - start[i], at[i + 1] - start[i + 1], at[i + 2] - start[i + 2]),
      );
    return most;
  });
}

// Where the place that is pointed at on an arm is, at q.
export function spotAt(chain, arm, q) {
  const { k, point: place } = arm.spot;
  const { joint, point, turn } = ridesOf(chain, arm)[arm.rows.indexOf(arm.moving[k])];
  const { x, y, z } = place.clone().applyQuaternion(turn);
  chain.place(q, chain.all);
  return pointsOn(chain.places[joint], [x + point[0], y + point[1], z + point[2]]);
}

// The corners of each body of an arm: its part, the joint that it rides on, and where they are, in
// that joint and at the start of the study.
function cornersAtStart(chain, arm) {
  if (arm.cornersAtStart) return arm.cornersAtStart;
  const rides = ridesOf(chain, arm);
  chain.place(chain.start, chain.all);
  arm.cornersAtStart = arm.moving.map((place, k) => {
    const ride = rides[arm.rows.indexOf(place)];
    const [, name] = chain.links[place.shape] || [];
    if (!ride || !name) return {};
    const { joint, point, turn } = ride;
    const local = arm.corners[k].flatMap((corner) => {
      const { x, y, z } = corner.clone().applyQuaternion(turn);
      return [x + point[0], y + point[1], z + point[2]];
    });
    return { name, joint, local, start: pointsOn(chain.places[joint], local) };
  });
  return arm.cornersAtStart;
}

// Points, three numbers each, carried by a joint.
function pointsOn({ R, p }, points) {
  const at = new Float64Array(points.length);
  for (let i = 0; i < at.length; i += 3)
    for (let c = 0; c < 3; c++)
      at[i + c] =
        p[c] + R[3 * c] * points[i] + R[3 * c + 1] * points[i + 1] + R[3 * c + 2] * points[i + 2];
  return at;
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

// How far each moving body is at frame i from where it is at the start, m; 0 for what is not part
// of the arm.
function offAt(arm, i, chain) {
  arm.pose(i, 0);
  arm.pose(0, 0, arm.ghosts);
  return arm.moving.map(({ shape }, k) =>
    chain.links[shape] && chain.links[shape][1] ? arm.drift(k) : 0,
  );
}

// The first limit that a motion breaks, of a position or of a rate.
function* firstViolation(chain, Q, V, perCycle, cycles) {
  const { n, names } = chain;
  for (let row = 0; row <= cycles * perCycle; row++) {
    if (row % 250 === 0) yield;
    const { joint, margin } = chain.nearest(Q.subarray(row * n, (row + 1) * n));
    const fast = chain.fastestJoint(V.subarray(row * n, (row + 1) * n));
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
