// Steps of the arms to a place of the hand, and why an arm refuses one: the place is out of its
// reach, a joint is at its limit or too fast, a singularity is near, or the control fails.

import { stepped } from "../arm/law.js";
import { gap, vector } from "./loops.js";
import { coverWords } from "./sentence.js";

const NEAR_LIMIT = 0.002; // rad or m, before which the hand stops
const LEAST_MARGIN = 0.15; // of the leaf, below which it stops
const MAX_SPEED_RATIO = 4; // times the joint speed at the start, or the limit, at which it stops
// part of the smallest sine between the rows of J at the start, below which it stops
const MIN_SINE_RATIO = 0.35;
const FARTHEST = 4; // arm lengths from its start, beyond which a hand is not led
const JUMP = 0.5; // rad or m in one step, from which an arm does not follow
const OUT_OF_REACH = "the place is out of reach";
const LEAF_ENDS = "the arm comes near where the control fails";

export class Steps {
  // `cover`: of the page of a cell, whose function alone holds the hand; `loops`: what the other
  // hands do
  constructor(chain, laws, loops, cover) {
    Object.assign(this, { chain, laws, loops, cover, stride: chain.size / 250 });
    this.atStart = laws.map((law) => ({
      speed: maxJointSpeed(law, chain.start),
      sine: law.sine(),
    }));
  }

  // Where steps begin: {hand, qs, worst}, the joints of each arm, and the worst that it came
  // through.
  from(hand) {
    return {
      hand,
      qs: this.laws.map((law) => law.start.slice()),
      worst: this.laws.map(() => ({})),
    };
  }

  // Whether the self-motion of a law may lead to q.
  allows(law, q) {
    const { sine } = this.atStart[this.laws.indexOf(law)];
    return (
      this.chain.nearest(q).margin > NEAR_LIMIT &&
      law.margin() > LEAST_MARGIN &&
      law.sine() > MIN_SINE_RATIO * sine
    );
  }

  // A place to which the hand is led, or the one in this direction at the farthest.
  limited(place) {
    const { homes, size, led } = this.chain;
    const home = vector(homes[led]);
    const off = vector(place).sub(home);
    return off
      .clampLength(0, FARTHEST * size)
      .add(home)
      .toArray();
  }

  // The next place of a hand on the way to a goal: this far at most.
  next(hand, goal) {
    const share = this.stride / gap(goal, hand);
    return share < 1 ? hand.map((v, i) => v + share * (goal[i] - v)) : goal;
  }

  // Step all arms of {hand, qs, worst} to the next place of the hand; or say why none of them can,
  // and stay. An arm that alone cannot goes on as it can, or waits; `together`: all stay. So they
  // do on the page of a cell, whose function holds the hand.
  step(from, next, together = this.cover) {
    const targets = this.loops.hands(next);
    const length = gap(next, from.hand);
    const found = this.laws.map((_, k) => this.stepArm(k, from, targets, length));
    const refusals = found.map(({ refusal }) => refusal || "");
    from.refusals = refusals;
    from.edge = found.at(-1).edge || null;
    if (together ? refusals.some(Boolean) : refusals.every(Boolean)) return refusals.find(Boolean);
    from.qs = found.map(({ q }, k) => q || from.qs[k]);
    from.worst = found.map((state, k) => (state.q ? state : from.worst[k]));
    return "";
  }

  // Arm k after a step of this length to the targets: {q, limit, leaf, sine}, with a refusal where
  // it should not go there, without q where it cannot.
  stepArm(k, from, targets, length) {
    const law = this.laws[k];
    const q = stepped(law, from.qs[k], targets);
    if (!q) return { refusal: OUT_OF_REACH };
    if (this.cover) return this.coveredStep(law, q, targets);
    const state = this.judged(k, from, q, length);
    if (!this.isOff(q, targets) && gap(q, from.qs[k]) < JUMP) return state;
    return { refusal: state.refusal || OUT_OF_REACH };
  }

  // A configuration of arm k after such a step: {q, limit, leaf, sine}, and a refusal where it
  // comes near a limit or a singularity.
  judged(k, from, q, length) {
    const { chain } = this;
    const law = this.laws[k];
    const leaf = law.margin();
    const sine = law.sine();
    const { joint, margin } = chain.nearest(q);
    const moved = q.map((v, i) => v - from.qs[k][i]);
    const state = { q, limit: margin, leaf, sine };
    const refused = (refusal) => ({ ...state, refusal });
    // what already was near may come away again
    const { limit = Infinity, leaf: leafBefore = 1, sine: sineBefore = 1 } = from.worst[k];
    if (margin < NEAR_LIMIT && margin < limit)
      return refused(`${chain.names[joint]} is at its limit`);
    const fast = chain.fastestJoint(moved.map((v) => (v * chain.speed) / length));
    if (fast.share > MAX_SPEED_RATIO)
      return refused(`${chain.names[fast.joint]} would have to be faster than it can`);
    const races = Math.hypot(...moved) > MAX_SPEED_RATIO * this.atStart[k].speed * length;
    if (races || (sine < MIN_SINE_RATIO * this.atStart[k].sine && sine < sineBefore))
      return refused("the arm comes near a singularity");
    return leaf < LEAST_MARGIN && leaf < leafBefore ? refused(LEAF_ENDS) : state;
  }

  // Whether the hands of this configuration are too far from their targets.
  isOff(q, targets) {
    const { chain } = this;
    chain.place(q);
    const off = Math.hypot(...chain.error(targets, new Float64Array(chain.m)));
    return off > 0.2 * this.stride + 1e-5;
  }

  // The same on the page of a cell, whose function alone holds the hand, where it has no value.
  coveredStep(law, q, targets) {
    const { chain } = this;
    if (this.isOff(q, targets)) return { refusal: OUT_OF_REACH };
    const { joint, margin } = chain.nearest(q);
    const [chart] = law.parts;
    const edge = chart && chart.beyond(chain.frames[0]);
    if (edge) return { refusal: coverWords(edge), edge };
    if (chart && margin < 0) return { refusal: `${chain.names[joint]} is at its limit` };
    return { q, limit: margin, leaf: 1, sine: 1 };
  }

  // Follow points in small steps, and gather where the hand has been; {refusal} where it cannot go
  // on, or with `together` where one arm cannot. Pauses after each step.
  *walk(from, points, together) {
    const trail = [];
    for (const goal of points)
      while (gap(goal, from.hand) >= 1e-9) {
        const next = this.next(from.hand, goal);
        const refusal = this.step(from, next, together);
        if (refusal) return { refusal, trail };
        from.hand = next;
        trail.push(next);
        yield;
      }
    return { refusal: "", trail };
  }
}

// The largest joint speed of a control for a hand that moves by 1 m/s along an axis, at q.
function maxJointSpeed(law, q) {
  const { n, m, frames } = law.chain;
  const rates = frames.flatMap(({ rows, row }) =>
    rows.slice(0, 3).map((_, axis) => {
      const xdot = new Float64Array(m);
      xdot[row + axis] = 1;
      law.solve(q, xdot);
      return Math.hypot(...law.x.subarray(0, n));
    }),
  );
  return Math.max(...rates);
}
