// What is off, said at the arm: the part that is farthest off, and the hand.

import { tint } from "./chart.js";
import { byId, element } from "../dom.js";
import { formatLength } from "../numbers.js";

const PHONE = "(max-width: 640px)"; // where what a number is measured from has fewer words
const RIM = 13; // px from the hand to the rim of its ring

export class Callouts {
  constructor(panes, scene) {
    Object.assign(this, { panes, scene, narrow: window.matchMedia(PHONE) });
    this.sets = panes.arms.map((arm, k) => ({
      arm,
      part: makeCallout(panes.frames[k], ""),
      hands: scene.hands.map(() => makeCallout(panes.frames[k], " hand")),
      gap: gapLine(panes.frames[k]),
    }));
    for (const { part } of this.sets) {
      part.value.widest = this.words(0.88e-3);
    }
  }

  words(off) {
    return `${this.scene.part}${/\d$/.test(this.scene.part) ? ":" : ""} ${formatLength(off)}`;
  }

  // Say how far they are off, and what from; while time runs, what `read` says of an arm: how far
  // it was off, m, and when.
  say(read = null) {
    const { leading, hands: names } = this.scene;
    for (const { arm, part, hands } of this.sets) {
      const from = this.measuredFrom(arm);
      const [off, when] = read ? read(arm) : [arm.partOff(), from];
      const lost = Boolean(arm.lost) && !leading;
      part.box.style.visibility = lost ? "hidden" : "";
      setText(part.note, when);
      setText(part.value, this.words(off || 0));
      part.value.className = tint(off || 0);
      part.box.title = `${(off || 0).toPrecision(3)} m`;
      hands.forEach((hand, f) => {
        const away = arm.handOff(f);
        hand.box.style.visibility = lost ? "hidden" : "";
        const of = arm.repeats ? "from cycle 1" : "from the grey one";
        setText(hand.value, `${names[f]} ${formatLength(away)} ${of}`);
        hand.box.title = `${away.toPrecision(3)} m ${from}`;
      });
    }
    if (!this.scene.leading) this.place(); // else the picture that follows places them
  }

  // What the number of an arm is measured from.
  measuredFrom(arm) {
    const { leading } = this.scene;
    const grey = arm.ghostSpot() ? ", in grey" : "";
    if (leading === "slides") return `from the start${grey}`;
    if (leading && arm.repeats) return "the other is measured from here";
    if (this.narrow.matches) return arm.repeats ? "from cycle 1" : "from the grey arm";
    if (arm.repeats) return "from its place in cycle 1";
    const base = leading || arm.reference ? "the repeatable arm" : "its place in cycle 1";
    return `from ${base}${grey}`;
  }

  // The part's above the arm, the hand's below it; each with a line to what it speaks of.
  place() {
    const { panes } = this;
    const rim = this.scene.own ? RIM : 0;
    if (byId("panes").classList.contains("quiet")) return;
    const size = ({ offsetLeft: x, offsetTop: y, offsetWidth: w, offsetHeight: h }) => ({
      x,
      y,
      w,
      h,
    });
    // all are read before any is moved
    const sizes = this.sets.map(({ part, hands }, k) => ({
      label: size(panes.frames[k].firstChild),
      box: size(part.box),
      below: hands.map(({ box }) => size(box)),
    }));
    this.sets.forEach(({ arm, part, hands, gap }, k) => {
      const { width, height } = panes.place(k);
      const { label, box, below } = sizes[k];
      const { beside } = panes;
      const at = arm.lost ? null : panes.seen(k, arm.partSpot());
      const ghost = at && arm.ghostSpot();
      const from = ghost && panes.seen(k, ghost);
      drawLine(gap, from, at, width, height);
      const top = beside ? 8 : label.y + label.h + 6;
      const left = beside ? label.x + label.w + 8 : 8;
      placeCallout(part, box, at, top, width, height, left);
      hands.forEach((hand, f) => {
        const tip = at && panes.seen(k, arm.point("tip", f, arm.now.frame, arm.now.f));
        const low = at && Math.min(tip.y + 0.09 * height, height - below[f].h - 34);
        placeCallout(
          hand,
          below[f],
          tip && { x: tip.x, y: tip.y + rim },
          low,
          width,
          height,
          8,
          at && along(from || at, at),
        );
      });
    });
  }
}

function makeCallout(pane, kind) {
  const value = element("b");
  const note = element("small");
  const box = element("div", { class: `callout${kind}` }, value, note);
  const leader = element("i", { class: `leader${kind}` });
  if (kind) note.remove();
  pane.append(leader, box);
  return { box, leader, value, note };
}

// Text that stays is not written again: a page lays out what was written.
function setText(node, words) {
  if (node.textContent !== words) node.textContent = words;
}

// `w`, `h`: size of its box; `at`: what is spoken of; `y`: the box's top; `left`: where the room
// for it begins; `free`: points to leave free, the box stands beside them, on the side that it
// stood on before, or below them
function placeCallout(callout, { w, h }, at, y, width, height, left, free) {
  const { box, leader } = callout;
  if (!at) {
    drawLine(leader, null, null);
    return;
  }
  const within = (v) => Math.min(Math.max(v, 4), height - h - 4);
  const beside = (side) =>
    Math.max(Math.min(Math.max(at.x - w / 2 + side * 0.45 * w, left), width - w - 8), 0);
  const isClear = ([side, top]) =>
    !free ||
    free.every(
      (p) =>
        p.y < top - 8 || p.y > top + h + 8 || p.x < beside(side) - 8 || p.x > beside(side) + w + 8,
    );
  const rows = [within(y), within(Math.max(y, ...(free || []).map((p) => p.y + 9)))];
  const places = rows.flatMap((row) => [callout.side || 0, 0, 1, -1].map((side) => [side, row]));
  const [side, top] = places.find(isClear) || places[1];
  callout.side = side;
  // the line to a part slants, so that it lies on no straight link
  const x = beside(free ? side : -1);
  box.style.transform = `translate(${x}px, ${top}px)`;
  const from = {
    x: free ? Math.min(Math.max(at.x, x + 6), x + w - 6) : x + w / 2,
    y: at.y > top + h ? top + h : at.y < top ? top : NaN,
  };
  drawLine(leader, from, at, width, height);
}

// Points of a line, its ends among them.
function along(p, q) {
  return [0, 0.25, 0.5, 0.75, 1].map((t) => ({
    x: p.x + t * (q.x - p.x),
    y: p.y + t * (q.y - p.y),
  }));
}

// Draw a line between two points of the window; none if there is no first point, or the second is
// beside the pane.
function drawLine(line, from, at, width, height) {
  const length = from && at ? Math.hypot(at.x - from.x, at.y - from.y) : NaN;
  const inside = at && at.x >= 0 && at.x <= width && at.y >= 0 && at.y <= height;
  line.hidden = !(length > 4) || !inside;
  line.style.width = line.hidden ? "0" : `${length}px`;
  if (line.hidden) return;
  line.line = [from.x, from.y, at.x, at.y]; // for a picture of it
  const angle = Math.atan2(at.y - from.y, at.x - from.x);
  line.style.transform = `translate(${from.x}px, ${from.y}px) rotate(${angle}rad)`;
}

// From where the most displaced place was, to where it is.
function gapLine(pane) {
  const line = element("i", { class: "leader gap", hidden: "" });
  pane.append(line);
  return line;
}
