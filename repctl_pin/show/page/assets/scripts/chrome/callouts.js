// What is off, said at the arm: the part that is farthest off, and the hand.

import { wordColour } from "./chart.js";
import { byId, element, setAttribute, setColor, setText } from "../dom.js";
import { formatLength } from "../numbers.js";
import { LOW } from "./panes.js";
import { Room } from "./room.js";

// where what a number is measured from has fewer words
const PHONE = "(max-width: 640px), (max-height: 480px)";
const SHORT = 420; // px, width of a pane below which these have fewer words, too
const NOW = "now, from the grey arm";
const RIM = 13; // px from the hand to the rim of its ring
const BALL = 26; // px from the middle of a red ball to its rim, at most
const PRESSED = 5; // how much worse it is to cover what is pressed
const FOOT_ROW = 34; // px, of what stands at the foot of a pane

export class Callouts {
  constructor(panes, scene) {
    Object.assign(this, { panes, scene, narrow: window.matchMedia(PHONE), rooms: [] });
    this.sets = panes.arms.map((arm, k) => ({
      arm,
      part: makeCallout(panes.frames[k], ""),
      hands: scene.hands.map(() => makeCallout(panes.frames[k], " hand")),
      mark: makeCallout(panes.frames[k], " mark"),
      gap: gapLine(panes.frames[k]),
    }));
    for (const { part } of this.sets) {
      part.value.widest = this.words(0.88e-3);
    }
  }

  words(off) {
    return `${this.scene.part}${/\d$/.test(this.scene.part) ? ":" : ""} ${formatLength(off)}`;
  }

  // Say how far they are from their starts after the cycles that are finished, as `times` says:
  // of a shown cycle, at its beginning or end. Within a cycle, and without these, how far they are
  // off now.
  say(atEnd, times = "", [cycle, end] = []) {
    const { failure, leading, hands: names } = this.scene;
    this.sets.forEach(({ arm, part, hands, mark }, k) => {
      const reason = isStopped(this, k) && failure[k];
      const edge = Boolean(this.scene.cover) && k === this.sets.length - 1;
      if (reason) sayWhatStops(mark, edge ? "F ends here" : "cannot follow", reason);
      else sayWhatBreaks(mark, arm, leading, this.isNarrow(k));
      const short = this.isNarrow(k);
      const off = times && atEnd ? arm.ends[cycle][end] : arm.partOff();
      const finished = times && !short ? times : this.measuredFrom(arm);
      const when = times && !atEnd ? NOW : finished;
      const lost = (Boolean(arm.lost) && !leading) || Boolean(failure);
      part.box.style.visibility = lost ? "hidden" : "";
      setText(part.note, when);
      setText(part.value, this.words(off));
      setColor(part.value, wordColour(arm.data.color));
      setAttribute(part.box, "title", `${off.toPrecision(3)} m`);
      hands.forEach((hand, f) => {
        const name = short ? names[f].split(",")[0] : names[f];
        const away = arm.handOff(f);
        // within a cycle, a hand is on its way
        hand.box.style.visibility = lost || !atEnd ? "hidden" : "";
        setText(hand.value, `${name} ${formatLength(away)} from its start`);
        setAttribute(hand.box, "title", `${away.toPrecision(3)} m`);
      });
    });
  }

  // What the number of an arm is measured from: its start, but while a hand leads both arms.
  measuredFrom(arm) {
    if (this.scene.leading !== "leads") return "from its start";
    if (arm.repeats) return "the other is measured from here";
    // on the page of a cell, as its pane is named
    const [name] = this.sets.at(-1).arm.data.title.split(",");
    return this.scene.cover ? `from the arm of ${name}` : "from the repeatable arm";
  }

  isNarrow(k) {
    return this.narrow.matches || this.panes.place(k).width < SHORT;
  }

  // The part's above the arm, those of the hands around them; each with a line to what it speaks
  // of. They keep clear of the pane's label, of the rings at `spots`, and of one another.
  place(spots = this.spots) {
    const { panes } = this;
    this.spots = spots;
    this.rooms = [];
    if (byId("panes").classList.contains("quiet")) return;
    // all are read before any is moved
    const size = (node) => panes.sizeOf(node);
    const sizes = this.sets.map(({ part, hands, mark }, k) => ({
      label: size(panes.frames[k].firstChild),
      box: size(part.box),
      boxes: hands.map(({ box }) => size(box)),
      marked: size(mark.box),
    }));
    const [foot, ...pressed] = ["below", "elbow-box", "own"].map((id) => size(byId(id)));
    this.rooms = this.sets.map(({ arm, part, hands, mark, gap }, k) => {
      const { left: beside, top: above, width, height } = panes.place(k);
      const { label, box, boxes, marked } = sizes[k];
      const room = new Room(width, height);
      const at = arm.lost || this.scene.failure ? null : panes.seen(k, arm.partSpot());
      const ghost = at && arm.ghostSpot();
      const from = ghost && panes.seen(k, ghost);
      const tips = at && hands.map((_, f) => this.tip(arm, k, f));
      // what stands where it is
      drawLine(gap, from, at, width, height);
      room.box(label);
      for (const one of pressed) {
        const [x, y] = [foot.x + one.x - beside, foot.y + one.y - above];
        room.box({ ...one, x, y }, false, PRESSED);
      }
      if (from) room.line(from, at);
      for (const spot of (spots && spots[k]) || tips || []) room.ring(spot, spots ? RIM : 3);
      // what is said finds its place: the part's has its row, so those of the hands come first
      const row = panes.beside ? 8 : label.y + label.h + 6;
      const left = panes.beside ? label.x + label.w + 8 : 8;
      const put = (hand, f) => {
        const tip = at && hand.box.style.visibility !== "hidden" ? tips[f] : null;
        const places = tip && aroundHand(boxes[f], tip, room);
        putCallout(hand, boxes[f], tip, spots ? RIM : 0, room, places);
      };
      const stopped = isStopped(this, k);
      const ball = mark.on ? panes.seen(k, markedSpot(arm, stopped)) : null;
      // what stops a loop has many words: in a corner they cover neither arm nor ball; the part has
      // none then
      if (ball && stopped) room.ring(ball, BALL);
      if (stopped) putCallout(mark, marked, ball, 3, room, inCorners(marked, label, room));
      room.reserved({ x: left, y: row, w: width - left, h: box.h }, () => {
        if (!stopped)
          putCallout(mark, marked, ball, 3, room, ball && aroundHand(marked, ball, room));
        hands.forEach(put);
      });
      const corner = { ...box, x: width - box.w - 8, y: 8, start: 0.5 };
      const over = at && aboveArm(box, at, left, row, width);
      // a low pane has no row above the arm
      const places = at && (height < LOW ? [corner, ...over] : [...over, corner]);
      putCallout(part, box, at, 0, room, places);
      return room;
    });
  }

  tip(arm, k, f) {
    return this.panes.seen(k, arm.point("tip", f, arm.now.frame, arm.now.f));
  }
}

function makeCallout(pane, kind) {
  const value = element("b");
  const note = element("small");
  const box = element("div", { class: `callout${kind}` }, value, note);
  const leader = element("i", { class: `leader${kind}` });
  if (kind === " hand") note.remove();
  pane.append(leader, box);
  return { box, leader, value, note };
}

// Whether arm k could not follow a visitor's loop, and has not failed on the way that it
// took instead: on a cell's page, the last alone is held, by its function.
function isStopped({ scene: { failure }, sets }, k) {
  const { past } = sets[k].arm;
  return Boolean(failure && failure[k] && !(past && past.node.visible));
}

// Say at the red ball why a visitor's loop could not be followed.
function sayWhatStops(mark, what, reason) {
  mark.on = true;
  mark.box.style.visibility = "";
  setText(mark.value, what);
  setText(mark.note, reason);
}

// Where the red ball is that is spoken of; one on a workpiece moves with it.
function markedSpot({ carrier, past, stop }, stopped) {
  if (!stopped) return past.node.position;
  const spot = stop.node.position.clone();
  return carrier ? spot.applyMatrix4(carrier.matrix) : spot;
}

// Say at the red ball what happens there, where it is seen.
function sayWhatBreaks(mark, arm, leading, short) {
  mark.on = Boolean(arm.past && arm.past.node.visible && !leading);
  mark.box.style.visibility = mark.on ? "" : "hidden";
  if (!mark.on) return;
  const { broken, title, lost } = arm.data;
  const when = `in cycle ${broken.cycle}`;
  const ends = lost < Infinity;
  setText(mark.value, ends ? (short ? "fails here" : `${title} fails here`) : broken.words);
  setText(mark.note, ends ? `close to a singularity, ${when}` : when);
}

// Where the part's callout may stand, and its line begin, the best first: the line slants, so that
// it lies on no straight link.
function aboveArm({ w, h }, at, left, y, width) {
  const x = (share) =>
    Math.max(Math.min(Math.max(at.x - w / 2 + share * w, left), width - w - 8), 0);
  return [0.5, 0.1, 0.9].flatMap((start) =>
    [-0.45, 0, 0.45].map((share) => ({ x: x(share), y, w, h, start })),
  );
}

// Corners of a pane: the upper right one, in the row of its label or below it, the left one below
// the label, and the lower right one, in or above the row at its foot.
function inCorners({ w, h }, label, { width, height }) {
  const beside = label.x + label.w + w + 16 <= width;
  const below = label.y + label.h + 4;
  const right = Math.max(width - w - 8, 0);
  return [
    { x: right, y: beside ? 8 : below, w, h },
    { x: 8, y: below, w, h },
    { x: right, y: height - h - FOOT_ROW, w, h },
    { x: right, y: height - h - 2 * FOOT_ROW, w, h },
  ];
}

// Where a hand's callout may stand, the best first: below the hand, above it, beside it.
function aroundHand({ w, h }, { x, y }, { width, height }) {
  const far = 0.09 * height;
  const lower = [y + far, y + far + h + 10, y + far + 2 * (h + 10)];
  const upper = [y - far - h, y - far / 2 - h, y - far - 2 * h - 10];
  const rows = [...lower.slice(0, 2), ...upper, lower[2]];
  const sides = [0, 0.45, -0.45];
  const places = [
    ...rows.flatMap((top) => sides.map((side) => [x - w / 2 + side * w, top])),
    ...[0, -1.2 * h, 1.2 * h].flatMap((down) => [
      [x + 2 * RIM, y - h / 2 + down],
      [x - 2 * RIM - w, y - h / 2 + down],
    ]),
  ];
  const within = (v, low, high) => Math.max(Math.min(v, high), low);
  return places.map(([left, top]) => ({
    x: within(left, 8, width - w - 8),
    y: within(top, 4, height - h - FOOT_ROW),
    w,
    h,
  }));
}

// Put a callout of a size where it covers least; `at`: what is spoken of, and its ring's radius;
// `places`: where it may stand.
function putCallout(callout, { w }, at, radius, room, places) {
  const { box, leader } = callout;
  if (!at || !w) {
    drawLine(leader, null, null);
    return;
  }
  const rule = (place) => {
    const from = nearest(place, at);
    const far = Math.hypot(at.x - from.x, at.y - from.y) || 1;
    const cut = Math.max(1 - radius / far, 0);
    return [from, { x: from.x + cut * (at.x - from.x), y: from.y + cut * (at.y - from.y) }];
  };
  const cost = (place, most) => {
    const covered = room.covers(place);
    return covered < most ? covered + room.crosses(...rule(place)) : covered;
  };
  callout.side = room.best(places, cost, callout.side);
  const place = places[callout.side];
  const [from, to] = rule(place);
  box.style.transform = `translate(${place.x}px, ${place.y}px)`;
  drawLine(leader, from, to, room.width, room.height);
  room.box(place);
  if (!leader.hidden) room.line(from, to);
}

// The point of a box's edge from which the line to `at` begins: the nearest, or at a share of it.
function nearest({ x, y, w, h, start }, at) {
  const within = start ? x + start * w : Math.min(Math.max(at.x, x + 6), x + w - 6);
  if (at.y > y + h) return { x: within, y: y + h };
  if (at.y < y) return { x: within, y };
  return { x: at.x < x ? x : x + w, y: y + h / 2 };
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
