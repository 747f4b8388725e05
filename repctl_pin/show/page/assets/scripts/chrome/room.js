// The room that is left in a pane: what stands in it, and where something more fits best.

const CLEAR = 4; // px to leave free around what stands

export class Room {
  constructor(width, height) {
    Object.assign(this, { width, height, taken: [] });
  }

  // Take the room of a box, of a ring around a point, of a line; of a box only while others are
  // put by `does`. What is covered of a box counts `weight` times.
  box({ x, y, w, h }, thin = false, weight = 1) {
    if (!w || !h) return;
    const [wide, high] = [w + 2 * CLEAR, h + 2 * CLEAR];
    this.taken.push({ x: x - CLEAR, y: y - CLEAR, w: wide, h: high, thin, weight });
  }
  ring({ x, y }, radius, thin = false) {
    this.box({ x: x - radius, y: y - radius, w: 2 * radius, h: 2 * radius }, thin);
  }
  reserved(box, does) {
    this.box(box);
    const row = this.taken.at(-1);
    does();
    this.taken = this.taken.filter((one) => one !== row);
  }
  line(from, to) {
    for (const at of along(from, to)) this.ring(at, 3, true);
  }

  // What a box would cover of what stands here, px² times weight.
  covers({ x, y, w, h }) {
    return this.taken.reduce(
      (sum, one) =>
        sum +
        one.weight *
          Math.max(Math.min(x + w, one.x + one.w) - Math.max(x, one.x), 0) *
          Math.max(Math.min(y + h, one.y + one.h) - Math.max(y, one.y), 0),
      0,
    );
  }

  // How far a line passes over boxes and rings other than the one it ends at, in the same measure.
  crosses(from, to) {
    const over = (one, { x, y }) =>
      x > one.x && x < one.x + one.w && y > one.y && y < one.y + one.h;
    const others = this.taken.filter((one) => !one.thin && !over(one, to));
    const points = along(from, to).filter((at) => others.some((one) => over(one, at)));
    return (6 * Math.hypot(to.x - from.x, to.y - from.y) * points.length) / STEPS;
  }

  // The index of the cheapest place, by `cost`; of equal ones the first, or the one of last time.
  // A cost need not be computed further once it is no less than its second argument.
  best(places, cost, last) {
    let best = 0;
    let least = Infinity;
    places.forEach((place, k) => {
      const more = 3 * k - (k === last ? 2 : 0);
      const all = cost(place, least - more) + more;
      if (all < least) [best, least] = [k, all];
    });
    return best;
  }
}

const STEPS = 16;

// Points of a line, its ends among them.
function along(p, q) {
  return Array.from({ length: STEPS + 1 }, (_, k) => ({
    x: p.x + (k / STEPS) * (q.x - p.x),
    y: p.y + (k / STEPS) * (q.y - p.y),
  }));
}
