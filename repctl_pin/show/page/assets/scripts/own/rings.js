// The rings at the hands, by which a hand is led, and their words "Drag me".

import { element } from "../dom.js";
import { gap, vector } from "./loops.js";

const CUT = 1000; // how much worse it is to be cut than to cover something
const CROWDED = 400; // px² that these words cover at most, at the first hand

export class Rings {
  // `parts`: {arms, chain, clock, extent, gesture, loops, panes, piece}
  constructor(parts) {
    Object.assign(this, parts);
    this.rows = this.panes.frames.map((frame, k) =>
      this.chain.frames.map((_, f) => this.ring(frame, k, f)),
    );
  }

  ring(frame, k, f) {
    const { chain, gesture } = this;
    const { hand } = chain.frames[f];
    const more = element("i", {}, ": draw a loop");
    const words = element("span", { class: "drag-me", "aria-hidden": "true" }, "Drag me", more);
    const ring = element(
      "button",
      {
        class: f ? "ring other" : "ring",
        type: "button",
        "aria-label": `Drag me: lead the ${hand} by the pointer, or by the arrow keys and Enter`,
        title: `Drag the ${hand} to draw a loop`,
      },
      words,
    );
    if (k) ring.tabIndex = -1;
    ring.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      event.preventDefault();
      gesture.grab(k, event.pointerId, gesture.at(k, event), f);
    });
    ring.addEventListener("keydown", (event) => gesture.key(k, event, f));
    ring.addEventListener("blur", () => {
      if (gesture.lead && gesture.lead.id === null) gesture.release();
    });
    frame.append(ring);
    return ring;
  }

  // Know how far the loop of each hand goes from its start, m; null for one that holds still.
  know(paths) {
    this.far = (paths || []).map((path) => path && Math.max(...path.map((p) => gap(p, path[0]))));
  }

  // Invite to draw a loop, or do so no more.
  pulse(on) {
    this.rows[0][0].classList.toggle("pulse", on);
  }

  // Measure the words "Drag me", and fewer of them.
  measure() {
    const [[ring]] = this.rows;
    const sizes = [false, true].map((short) => {
      ring.classList.toggle("short", short);
      return { w: ring.firstChild.offsetWidth, h: ring.firstChild.offsetHeight };
    });
    if (!sizes[0].w) return;
    this.sizes = sizes;
    this.reach = ring.offsetWidth / 2 + 2; // px from the hand to the words
  }

  // Where the rings are, in the pixels of each pane.
  spots() {
    const { chain, loops, piece } = this;
    const { lead } = this.gesture;
    this.rest = lead ? lead.hands : loops.points ? loops.hands(loops.points[0]) : chain.homes;
    return this.rows.map((_, k) => this.rest.map((hand) => piece.seen(k, hand)));
  }

  // Put the rings where the hands are, and their words where `rooms` has room; they are not there
  // while the hands go round without them.
  place(rooms = [], spots = this.spots()) {
    const small = spots[0].map((spot, f) => this.isSmall(f, spot));
    this.rows.forEach((row, k) =>
      row.forEach((ring, f) => {
        const { x, y } = spots[k][f];
        ring.classList.toggle("small", small[f]);
        ring.style.transform = `translate(calc(${x}px - 50%), calc(${y}px - 50%))`;
        ring.classList.toggle("away", this.clock.playing && this.isAway(k, f));
        if (rooms[k] && !k && this.sizes) this.placeWords(ring, f, spots[k][f], rooms[k]);
      }),
    );
  }

  // Put the words "Drag me" at a ring where they cover least, fewer if there is no room for more;
  // those of another hand only where they cover nothing.
  placeWords(ring, f, { x, y }, room) {
    const out = this.reach; // reading it here would lay out the page at each picture
    const places = this.sizes.flatMap(({ w, h }, short) =>
      [
        ["right", x + out, y - h / 2],
        ["left", x - out - w, y - h / 2],
        ["under", x - w / 2, y + out],
        ["above", x - w / 2, y - out - h],
      ].map(([side, left, top]) => ({ side, short, x: left, y: top, w, h })),
    );
    const beside = (v, size, all) => Math.max(-v, v + size - all, 0);
    const cost = (place) =>
      room.covers(place) +
      CUT * place.h * beside(place.x, place.w, room.width) +
      CUT * place.w * beside(place.y, place.h, room.height);
    ring.side = room.best(places, cost, ring.side);
    const place = places[ring.side];
    for (const side of ["left", "under", "above"]) ring.classList.toggle(side, place.side === side);
    ring.classList.toggle("short", Boolean(place.short));
    ring.classList.toggle("mute", cost(place) > (f ? 0 : CROWDED));
    if (!ring.matches(".mute, .away")) room.box(place);
  }

  // Whether the loop of a hand, which is seen at this spot, goes no farther than a ring is wide.
  isSmall(f, { x, y }) {
    if (!this.far[f] || this.gesture.lead || !this.reach) return false;
    const { elements } = this.panes.viewer.camera.matrixWorld;
    const right = vector([elements[0], -elements[2], elements[1]]);
    const beside = this.piece.now(0, this.rest[f]).addScaledVector(right, this.far[f]);
    const side = this.panes.seen(0, beside);
    return Math.hypot(side.x - x, side.y - y) < 2 * this.reach;
  }

  isAway(k, f) {
    const { now } = this.arms[k];
    if (this.gesture.lead || this.clock.time % 1 === 0) return false;
    const tip = this.arms[k].point("tip", f, now.frame, now.f);
    return tip.distanceTo(this.piece.now(k, this.rest[f])) > 0.02 * this.extent;
  }
}
