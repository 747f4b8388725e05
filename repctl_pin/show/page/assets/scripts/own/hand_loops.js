// The loops of the hands: that of the hand which is led, chain.led, and what the others do
// meanwhile: rest, mirror it, or keep loops of their own.

import { inStep } from "./loops.js";

export class HandLoops {
  // `studied`: the paths of the study, null for a hand that rests, as the task has them
  constructor(chain, studied) {
    Object.assign(this, { chain, studied, mirrored: false });
    chain.led = 0;
    this.clear();
  }

  // No loops: the hands follow the study's path.
  clear() {
    this.points = null; // of the hand that is led
    this.others = []; // the loops that hands led before keep, by frame, while none mirrors another
    this.missed = []; // strokes that the hand could not follow, each from where it stopped
  }

  // Hand f is led from now on; the one that was led keeps its loop, if it could follow it.
  take(f) {
    const { chain, points } = this;
    if (f !== chain.led && !this.mirrored && !this.missed.length) this.others[chain.led] = points;
    chain.led = f;
    this.points = null;
  }

  // Keep the loops for a press that draws none, and take them back: the points and the strokes of
  // the hand that was led; null without.
  remember() {
    const { points, missed, others, chain } = this;
    this.earlier = points && { points, missed, others: [...others], led: chain.led };
  }
  restore() {
    const { earlier } = this;
    if (!earlier) return null;
    this.others = earlier.others;
    this.chain.led = earlier.led;
    return earlier;
  }

  // Where all hands are when the one that is led is here: the others still, or its mirror image in
  // the plane halfway between their starts.
  hands(point) {
    const { homes, led } = this.chain;
    const home = homes[led];
    return homes.map((other, f) => {
      if (f === led) return point;
      if (!this.mirrored) return other;
      const across = other.map((v, i) => v - home[i]);
      const square = across.reduce((sum, v) => sum + v * v, 0) || 1;
      const moved = point.map((v, i) => v - home[i]);
      const share = (2 * moved.reduce((sum, v, i) => sum + v * across[i], 0)) / square;
      return other.map((v, i) => v + moved[i] - share * across[i]);
    });
  }

  // The paths of all frames, null for one that holds still.
  paths() {
    if (!this.points) return this.studied.map((path) => path || null);
    if (!this.mirrored) return inStep(this.each());
    const along = this.points.map((p) => this.hands(p));
    return this.chain.homes.map((_, f) => along.map((hands) => hands[f]));
  }

  // The loop of hand f, null for one that holds still or mirrors another; of each.
  of(f) {
    return (f === this.chain.led ? this.points : !this.mirrored && this.others[f]) || null;
  }
  each() {
    return this.chain.homes.map((_, f) => this.of(f));
  }

  // The hands that keep a loop of their own beside the one that is led.
  keeping() {
    return this.chain.frames.filter((_, f) => f !== this.chain.led && this.of(f));
  }
}
