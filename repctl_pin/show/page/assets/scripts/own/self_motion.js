// The self-motion of the arm: what the elbow's slider goes through, with the hands at rest.

const APART = 0.02; // of the joints between two places of the slider, rad or m
const PLACES = 160; // steps to either side

// Configurations along the self-motion that changes level k alone, from q0 to both sides as far as
// `allowed(q)`: {qs, zero}, with q0 = qs[zero].
export function selfMotion(law, q0, k, allowed) {
  const [back, on] = [-1, 1].map((sign) => oneDirection(law, q0, k, sign, allowed));
  return { qs: [...back.reverse(), Float64Array.from(q0), ...on], zero: back.length };
}

function oneDirection(law, q0, k, sign, allowed) {
  const { chain } = law;
  const rest = new Float64Array(chain.m);
  const found = [];
  let q = Float64Array.from(q0);
  let before = null;
  while (found.length < PLACES && law.slide(q, k)) {
    // a step along the self-motion, the way it went before
    const size = Math.hypot(...law.x);
    const onward = before && before.reduce((sum, v, i) => sum + v * law.x[i], 0) < 0 ? -1 : 1;
    const direction = law.x.map((v) => (onward * v) / size);
    const next = q.map((v, i) => v + sign * APART * direction[i]);
    // the hands back to where they were
    for (let round = 0; round < 2; round++) {
      chain.place(next);
      if (!law.solve(next, chain.error(chain.homes, rest))) return found;
      for (let i = 0; i < next.length; i++) next[i] += law.x[i];
    }
    if (!allowed(law, next)) return found;
    found.push(next);
    before = direction;
    q = next;
  }
  return found;
}
