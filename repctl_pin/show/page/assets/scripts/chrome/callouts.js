// What is off, said at the arm: the part that is farthest off, and the hand.

import { tint } from "./chart.js";
import { byId, element } from "../dom.js";
import { inMetres } from "../numbers.js";

const RIM = 13; // px from the hand to the rim of its ring

export class Callouts {
  constructor(panes, scene) {
    Object.assign(this, { panes, scene });
    this.sets = panes.arms.map((arm, k) => ({
      arm,
      part: made(panes.frames[k], ""),
      hand: made(panes.frames[k], " hand"),
      gap: gapLine(panes.frames[k]),
    }));
    for (const { part } of this.sets) {
      part.value.widest = this.words(0.88e-3);
    }
  }

  words(off) {
    return `${this.scene.part}${/\d$/.test(this.scene.part) ? ":" : ""} ${inMetres(off)} off`;
  }

  // Say how far they are off, and what from; while time runs, what `read` says of an arm: how far it was off, m, and when.
  say(read = null) {
    for (const { arm, part, hand } of this.sets) {
      const grey = arm.ghostSpot() ? ", in grey" : "";
      const base =
        this.scene.leading || arm.reference ? "the repeatable arm" : "its place in cycle 1";
      const from = !arm.repeats
        ? `from ${base}${grey}`
        : this.scene.leading
          ? ""
          : "the same in every cycle";
      const [off, when] = read ? read(arm) : [arm.partOff(), from];
      const way = arm.handOff();
      write(part.note, when);
      write(part.value, this.words(off));
      part.value.className = tint(off);
      part.box.title = `${off.toPrecision(3)} m`;
      write(hand.value, `hand ${inMetres(way)} off`);
      hand.box.title = `${way.toPrecision(3)} m ${from}`;
    }
    if (!this.scene.leading) this.place(); // else the picture that follows places them
  }

  // The part's above the arm, the hand's below it; each with a line to what it speaks of.
  place() {
    const { panes } = this;
    const rim = this.scene.own ? RIM : 0;
    if (byId("panes").classList.contains("quiet")) return;
    const sizes = this.sets.map(({ part, hand }, k) =>
      [panes.frames[k].firstChild, part.box, hand.box].map(
        ({ offsetLeft: x, offsetTop: y, offsetWidth: w, offsetHeight: h }) => ({ x, y, w, h }),
      ),
    ); // all are read before any is moved
    this.sets.forEach(({ arm, part, hand, gap }, k) => {
      const { width, height } = panes.place(k);
      const [label, box, below] = sizes[k];
      const { beside } = panes;
      const at = panes.seen(k, arm.partSpot());
      const tip = panes.seen(k, arm.point("tip", 0, arm.now.frame, arm.now.f));
      const ghost = arm.ghostSpot();
      drawLine(gap, ghost && panes.seen(k, ghost), at, width, height);
      put(
        part,
        box,
        at,
        beside ? 8 : label.y + label.h + 6,
        width,
        height,
        beside ? label.x + label.w + 8 : 8,
      );
      put(
        hand,
        below,
        { x: tip.x, y: tip.y + rim },
        Math.min(tip.y + 0.09 * height, height - below.h - 34),
        width,
        height,
        8,
        at,
      );
    });
  }
}

function made(pane, kind) {
  const value = element("b");
  const note = element("small");
  const box = element("div", { class: `callout${kind}` }, value, note);
  const leader = element("i", { class: `leader${kind}` });
  if (kind) note.remove();
  pane.append(leader, box);
  return { box, leader, value, note };
}

// Text that stays is not written again: a page lays out what was written.
function write(node, words) {
  if (node.textContent !== words) node.textContent = words;
}

// `w`, `h`: size of its box; `at`: what is spoken of; `y`: the box's top; `left`: where the room for
// it begins; `free`: a point to leave free, the box stands beside it, on the side that it stood on
// before
function put(callout, { w, h }, at, y, width, height, left, free) {
  const { box, leader } = callout;
  const top = Math.min(Math.max(y, 4), height - h - 4);
  const beside = (side) =>
    Math.max(Math.min(Math.max(at.x - w / 2 + side * 0.45 * w, left), width - w - 8), 0);
  const clear = (side) =>
    !free ||
    free.y < top - 8 ||
    free.y > top + h + 8 ||
    free.x < beside(side) - 8 ||
    free.x > beside(side) + w + 8;
  callout.side = [callout.side || 0, 0, 1, -1].find(clear) || 0;
  // the line to a part slants, so that it lies on no straight link
  const x = beside(free ? callout.side : -1);
  box.style.transform = `translate(${x}px, ${top}px)`;
  const from = {
    x: free ? Math.min(Math.max(at.x, x + 6), x + w - 6) : x + w / 2,
    y: at.y > top + h ? top + h : at.y < top ? top : NaN,
  };
  drawLine(leader, from, at, width, height);
}

// Draw a line between two points of the window; none if there is no first point, or the second is beside the pane.
function drawLine(line, from, at, width, height) {
  const length = from ? Math.hypot(at.x - from.x, at.y - from.y) : NaN;
  line.hidden = !(length > 4) || at.x < 0 || at.x > width || at.y < 0 || at.y > height;
  line.style.width = line.hidden ? "0" : `${length}px`;
  if (line.hidden) return;
  line.line = [from.x, from.y, at.x, at.y]; // for a picture of it
  line.style.transform = `translate(${from.x}px, ${from.y}px) rotate(${Math.atan2(at.y - from.y, at.x - from.x)}rad)`;
}

// From where the place that is off most was, to where it is.
function gapLine(pane) {
  const line = element("i", { class: "leader gap", hidden: "" });
  pane.append(line);
  return line;
}
