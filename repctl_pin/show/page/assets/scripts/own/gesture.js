// The gesture: a hand is taken at its ring, and led by the pointer or by keys, until it is let go;
// both arms follow, and the hand draws a loop.

import { pointAt } from "../arm/arm.js";
import { formatLength } from "../numbers.js";
import { HandMarks } from "./hand_marks.js";
import { gap, kept, planeWords, thinned, vector } from "./loops.js";
import { isBeyond, proofHint } from "./proof.js";
import { stated } from "./sentence.js";

const DRAW = [["Draw a loop and let go. Both arms follow."]];
const HOW = [" The dotted line closes the loop."];
const DOTTED = 30; // px, from which this line is seen beside the ring
const BUDGET = 5; // ms of steps between two pictures
const LEAST_STROKE = 0.01; // of the arm, from which a stroke counts

export class Gesture {
  // `parts`: {arms, chain, elbow, extent, head, ledArms, loops, panes, piece, player, scene,
  // steps}, and {release(), leave(), isBusy()}: what the keys Enter and Escape do, and whether
  // something is computed, so that other keys do nothing
  constructor(parts) {
    Object.assign(this, parts);
  }

  get lead() {
    return this.ledArms.lead;
  }

  // Where an event is in pane k.
  at(k, event) {
    const { left, top } = this.panes.frames[k].getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  // Take hand f in pane k, in the plane through it that faces the camera, or in the task's own.
  grab(k, id, at, f = 0) {
    const T = MeshCat.THREE;
    const { arms, chain, elbow, ledArms, loops, piece, scene, steps } = this;
    const home = chain.homes[f];
    const { rows } = chain.frames[f];
    if (!this.lead) loops.remember();
    loops.take(f);
    elbow.stand(elbow.at);
    const missing = [0, 1, 2].filter((row) => !rows.includes(row));
    const seen = piece.seen(k, home);
    const grip = at ? { x: seen.x - at.x, y: seen.y - at.y } : { x: 0, y: 0 };
    const normal = missing.length
      ? new T.Vector3().setComponent(missing[0], 1)
      : piece.sight(k, seen).direction;
    const plane = new T.Plane().setFromNormalAndCoplanarPoint(normal, vector(home));
    const lead = {
      ...steps.from(home.slice()),
      k,
      id,
      grip,
      plane,
      queue: [],
      hands: chain.homes,
      trail: [home.slice()],
      length: 0,
      seen: 0, // points of it that were looked at
      refusal: "",
      missed: [], // strokes of the pointer that the hand could not follow
      missing: null, // the last of them, until the hand has come up
    };
    ledArms.begin(lead, piece.lines(loops.each()));
    const { cover } = scene;
    lead.marks = new HandMarks({ arms, chain, cover, piece }, plane.normal, 0.018 * this.extent);
    if (chain.frames.length > 1) {
      // the elbow of this hand is the part in words
      const rides = chain.links.find(
        (link) => link && link[1] && link[0] === chain.frames[f].elbow,
      );
      ledArms.draw();
      if (rides) [, scene.part] = rides;
      pointAt(arms, chain.isOf(scene.part));
    }
    this.head.write(DRAW, this.hint());
    this.draw();
  }

  move(event) {
    const { chain, lead, steps } = this;
    if (!lead || event.pointerId !== lead.id) return;
    const events = event.getCoalescedEvents ? event.getCoalescedEvents() : [];
    const home = vector(chain.homes[chain.led]);
    for (const one of events.length ? events : [event]) {
      const { x, y } = this.at(lead.k, one);
      const sight = this.piece.sight(lead.k, { x: x + lead.grip.x, y: y + lead.grip.y });
      // beside the plane, the direction in which it is seen
      const hit =
        sight.intersectPlane(lead.plane, new MeshCat.THREE.Vector3()) ||
        lead.plane.projectPoint(sight.at(1e3 * chain.size, home.clone()), home.clone());
      lead.queue.push(steps.limited(hit.toArray()));
    }
    this.scheduleStep();
  }

  key(k, event, f) {
    const { key, ctrlKey, metaKey, altKey } = event;
    const directions = {
      ArrowRight: [1, 0],
      ArrowLeft: [-1, 0],
      ArrowUp: [0, 1],
      ArrowDown: [0, -1],
    };
    const direction = directions[key];
    const known = direction || key === "Enter" || (key === "Escape" && this.lead);
    if (ctrlKey || metaKey || altKey || !known) return;
    event.preventDefault();
    event.stopPropagation();
    const draws = this.lead && !this.lead.slides;
    if (key === "Escape") this.leave();
    else if (this.isBusy()) return;
    else if (key === "Enter" && draws) this.release();
    else {
      if (!draws) this.grab(k, null, null, f);
      if (direction) this.nudge(direction);
      else this.head.write([["Draw a loop by the arrow keys; Enter lets go."]], this.hint());
    }
  }

  // Lead the hand a little right or up on the screen.
  nudge(direction) {
    const { hand, queue } = this.lead;
    const goal = vector(queue.at(-1) || hand);
    const step = 0.015 * this.chain.size;
    this.axes().forEach((axis, i) => goal.addScaledVector(axis, direction[i] * step));
    queue.push(goal.toArray());
    this.scheduleStep();
  }

  // Right and up on the screen, in the plane in which the hand is led.
  axes() {
    const { elements } = this.panes.viewer.camera.matrixWorld;
    const { k, plane } = this.lead;
    const back = this.piece.placement(k).invert();
    return [0, 4].map((i) =>
      vector([elements[i], -elements[i + 2], elements[i + 1]])
        .transformDirection(back)
        .projectOnPlane(plane.normal)
        .normalize(),
    );
  }

  // Step towards the points that the hand was led to, as many as there is time for until the next
  // picture.
  scheduleStep() {
    const { lead } = this;
    if (lead.waiting) return;
    lead.waiting = requestAnimationFrame(() => {
      lead.waiting = 0;
      if (lead !== this.lead) return;
      this.processQueue(performance.now() + BUDGET);
      this.draw();
      if (lead.queue.length) this.scheduleStep();
    });
  }

  processQueue(until = Infinity) {
    const { lead, steps } = this;
    while (lead.queue.length && performance.now() < until) {
      const [goal] = lead.queue;
      if (gap(goal, lead.hand) < 1e-6) {
        lead.queue.shift();
        continue;
      }
      const next = steps.next(lead.hand, goal);
      lead.refusal = steps.step(lead, next);
      if (!lead.refusal) {
        lead.length += gap(next, lead.hand);
        lead.hand = next;
        lead.hands = this.loops.hands(next);
        lead.trail.push(next);
        lead.marks.extend(lead);
      }
      if (!lead.refusal && next !== goal) continue;
      if (lead.id !== null) this.miss(goal);
      lead.queue.shift();
    }
  }

  // Keep what the hand cannot follow of a stroke: from where it stops until it has come up again.
  miss(goal) {
    const { lead } = this;
    if (lead.refusal && !lead.missing) {
      lead.missing = [lead.hand];
      lead.missed.push(lead.missing);
    }
    if (lead.missing) lead.missing.push(goal);
    if (!lead.refusal) lead.missing = null;
  }

  // Draw both arms where they have been led, and say what holds them.
  draw() {
    const { chain, head, lead } = this;
    this.ledArms.draw();
    lead.marks.show(lead.hand);
    // what has been beyond stays so
    const beyond = lead.beyond || isBeyond(chain, lead.trail.slice(lead.seen));
    lead.seen = lead.trail.length;
    const warning = this.warning();
    const dotted = this.isDotted();
    if (warning !== lead.warning || beyond !== lead.beyond || dotted !== lead.dotted) {
      Object.assign(lead, { warning, beyond, dotted });
      const further = lead.refusal ? " Go another way, or let go." : " Draw on, or let go.";
      const sentence = warning ? [[warning, lead.refusal ? "bad" : "near"], [further]] : DRAW;
      head.write(sentence, this.hint(beyond));
    }
    const far = lead.length ? `, ${formatLength(lead.length)} long so far` : "";
    head.entitle(`your loop${far}, ${planeWords(this.piece.direction(lead.plane.normal))}`);
    this.player.show();
  }

  // What holds the hand, or the one arm that cannot follow it; empty while both can.
  warning() {
    const { refusal, refusals = [] } = this.lead;
    if (refusal) return stated(refusal);
    const k = refusals.findIndex(Boolean);
    return k < 0 ? "" : stated(`${refusals[k]} under ${this.arms[k].data.under}`);
  }

  // Whether the line that closes the loop is long enough to be seen.
  isDotted() {
    const { hand, k, trail } = this.lead;
    const [a, b] = [hand, trail[0]].map((p) => this.piece.seen(k, p));
    return Math.hypot(a.x - b.x, a.y - b.y) > DOTTED;
  }

  // What is said under the sentence while the hand is led.
  hint(beyond = false) {
    const { chain } = this;
    const words = this.loops.keeping().map(({ hand }) => [` The ${hand} keeps its loop.`]);
    if (chain.proved && !this.elbow.at) words.push(proofHint(chain, beyond));
    return this.lead.dotted ? [...words, HOW] : words;
  }

  // Close the loop: straight home, or along the way it came where that is blocked. Gives its
  // points, and the strokes that the hand could not follow; null without a stroke. Pauses often.
  *close() {
    const { chain, lead, steps } = this;
    while (lead.queue.length) {
      this.processQueue(performance.now() + BUDGET);
      yield;
    }
    const home = chain.homes[chain.led];
    const open = lead.trail;
    const least = LEAST_STROKE * chain.size;
    if (Math.max(...open.map((p) => gap(p, home))) < least) return null;
    const from = { ...lead };
    const { refusal } = yield* steps.walk(from, [home]);
    const back = refusal ? open.slice(0, -1).reverse() : [];
    if (refusal) lead.missed.push([from.hand, home]);
    const missed = lead.missed
      .filter(([stop, ...on]) => on.some((p) => gap(p, stop) > least))
      .map(thinned);
    return { points: kept([...open, ...back, home], home), missed };
  }
}
