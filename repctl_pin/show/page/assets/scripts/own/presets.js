// Loops of a given form, in place of one that is drawn.

import { kept, vector } from "./loops.js";

// The largest loop of this form, from the hand on, that the arms can follow: its points; null if
// there is no room. `axes`: right and up in its plane. Pauses often.
export function* largestLoop(form, steps, axes) {
  const { homes, led, size } = steps.chain;
  const home = homes[led];
  for (let wide = 0.16 * size; wide > 0.004 * size; wide *= 0.8)
    for (let turn = 0; turn < 8; turn++) {
      const points = placedForm(form, home, axes, wide, (turn * Math.PI) / 4);
      const { refusal } = yield* steps.walk(steps.from(home), [...points, home], true);
      if (!refusal) return kept([home, ...points, home], home);
    }
  return null;
}

// Points of a form, turned and this wide, from the hand on.
function placedForm(form, home, [right, up], wide, angle) {
  const c = wide * Math.cos(angle);
  const s = wide * Math.sin(angle);
  return form.map(([x, y]) =>
    vector(home)
      .addScaledVector(right, c * x - s * y)
      .addScaledVector(up, s * x + c * y)
      .toArray(),
  );
}
