// The visitor's own loop: take a hand at its ring, draw, let go; both arms follow, and the page
// says what has happened. And the slider of the elbow, from where they then start.

import { pointAt } from "../arm/arm.js";
import { EdgeLine } from "../arm/cover.js";
import { Chain } from "../arm/kinematics.js";
import { Law, stepped } from "../arm/law.js";
import { dots, Trail } from "../arm/traces.js";
import { openNotes } from "../chrome/controls.js";
import { download } from "../chrome/save.js";
import { byId, element, setAttribute, setText, tone } from "../dom.js";
import { formatLength } from "../numbers.js";
import { selfMotion } from "./elbow.js";
import {
  closed,
  enclosing,
  FORMS,
  gap,
  inStep,
  kept,
  lengthOf,
  nearestPiece,
  normalOf,
  planeWords,
  thinned,
  windings,
} from "./loops.js";
import { bodiesOff, computed, drawnAt, spotAt } from "./run.js";
import {
  answer,
  coverWords,
  edgeWords,
  failureWords,
  lineWords,
  shortName,
  stated,
  UNCHECKED,
} from "./sentence.js";

const CYCLES = 10;
const DRIVEN = 0.5; // of what moves most along the slider, from which a part gives it its name
const TRIED = 6; // levels, of which the slider takes the one that moves most what drifts most
const NEAR_LIMIT = 0.002; // rad or m, before which the hand stops
const LEAST_MARGIN = 0.15; // of the leaf, below which it stops
const DRAW = [["Draw a loop and let go. Both arms follow."]];
const HOW = ["The dotted line closes the loop."];
const DOTS = 200; // of that line, at most
const FARTHEST = 4; // arm lengths from its start, beyond which a hand is not led
const MAX_SPEED_RATIO = 4; // times the joint speed at the start, or the limit, at which it stops
// part of the smallest sine between the rows of J at the start, below which it stops
const MIN_SINE_RATIO = 0.35;
const LEAST_LENGTH = 0.25; // of the arm, from which a loop counts for the best
const BUDGET = 5; // ms of steps between two pictures
const HEAD_FOOT = 8; // px to leave free under the notes in the page's head
const SLICE = 25; // ms of computing between two pictures, once the hand is let go
const LEAST_STROKE = 0.01; // of the arm, from which a stroke counts
const JUMP = 0.5; // rad or m in one step, from which an arm does not follow
const OUT_OF_REACH = "the place is out of reach";
const LEAF_ENDS = "the arm comes near where the control fails";

export class Own {
  // `player`: {play(result), study(), plain(), clear(), show()}, which shows a result of
  // computed() after play's pauses, or the study again; `paths`: those of the study, as drawn
  constructor(data, { arms, panes, scene, clock, extent, player, paths }) {
    Object.assign(this, { arms, panes, scene, clock, extent, player });
    this.chain = new Chain(data);
    this.laws = data.laws.map((parts) => new Law(this.chain, parts));
    this.atStart = this.laws.map((law) => ({
      speed: maxJointSpeed(law, data.start),
      sine: law.sine(),
    }));
    this.stride = this.chain.size / 250;
    this.home = placementOf(this.chain.frames[0].base);
    const back = this.home.clone().invert();
    const points = (path) => path.map((p) => p.clone().applyMatrix4(back).toArray());
    this.studied = data.path && data.path.map((k) => k !== null && points(paths[k]));
    this.texts = ["title", "verdict", "notes"].map((id) => [byId(id), [...byId(id).childNodes]]);
    this.rings = panes.frames.map((frame, k) =>
      this.chain.frames.map((_, f) => this.ring(frame, k, f)),
    );
    // the loop: points of the hand that is led, and what the other hands do meanwhile
    Object.assign(this, { state: "study", points: null, lead: null, mirrored: false });
    this.others = []; // the loops that hands led before keep, by frame, while none mirrors another
    this.missed = []; // strokes that the hand could not follow, each from where it stopped
    this.work = null; // what is computed in slices
    this.led = 0;
    this.drifting = scene.part; // of the study
    this.listen();
    this.slider();
  }

  // ---- where a point of the task is drawn

  // On the workpiece, which stands as at the start; without one, in the root.
  onPiece(x) {
    return new MeshCat.THREE.Vector3(...x).applyMatrix4(this.home);
  }

  // The placement in pane k of what the task is relative to, as it now stands there.
  pieceIn(k) {
    const { carrier } = this.arms[k];
    if (!carrier) return this.home;
    carrier.updateMatrix();
    return carrier.matrix.clone().multiply(this.home);
  }

  seen(k, x) {
    return this.panes.seen(k, new MeshCat.THREE.Vector3(...x).applyMatrix4(this.pieceIn(k)));
  }

  // The line of sight through a place of pane k, as the task has it.
  sight(k, place) {
    return this.panes.sight(k, place).applyMatrix4(this.pieceIn(k).invert());
  }

  // ---- what a hand can touch

  listen() {
    window.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"])
      window.addEventListener(end, (event) => {
        if (!this.lead || event.pointerId !== this.lead.id) return;
        document.activeElement.blur();
        this.release();
      });
    const pressed = (id, does) => byId(id).addEventListener("click", does);
    pressed("again", () => this.repeat());
    pressed("more", () => {
      openNotes("unfolded");
      this.fold();
    });
    pressed("back", () => this.leave());
    pressed("loop-csv", () => download(new Blob([this.csv()], { type: "text/csv" }), "loop.csv"));
    pressed("copy", ({ currentTarget }) => {
      const done = () => {
        currentTarget.textContent = "Copied";
      };
      navigator.clipboard.writeText(location.href).then(done, () => {});
    });
    pressed("best", () => {
      byId("loops").open = false;
      this.open(this.best);
    });
    for (const button of byId("loops").querySelectorAll("[data-loop]"))
      button.addEventListener("click", () => {
        byId("loops").open = false;
        this.preset(button.dataset.loop);
      });
    byId("mirror").parentElement.hidden = this.chain.frames.length < 2;
    byId("mirror").addEventListener("change", ({ target }) => {
      this.mirrored = target.checked;
      if (this.points) this.follow(this.points, 1);
    });
    byId("loops").hidden = false;
    this.clock.invite = () => {
      if (this.state === "study") this.rings[0][0].classList.add("pulse");
    };
  }

  ring(frame, k, f) {
    const { hand } = this.chain.frames[f];
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
      this.grab(k, event.pointerId, this.at(k, event), f);
    });
    ring.addEventListener("keydown", (event) => this.key(k, event, f));
    ring.addEventListener("blur", () => {
      if (this.lead && this.lead.id === null) this.release();
    });
    frame.append(ring);
    return ring;
  }

  // ---- the elbow's slider

  slider() {
    const repeatable = this.laws.find(({ r }) => r);
    const input = byId("elbow");
    this.first = 0; // the level that the slider changes at first
    this.level = 0;
    this.elbowAt = 0;
    if (!repeatable || this.scene.cover) return;
    const menu = byId("level");
    const { r } = repeatable;
    const reached = Array.from({ length: r }, (_, k) => {
      const words = `motion ${k + 1} of ${r}`;
      const option = element("option", { value: k }, words);
      menu.append(option);
      if (k >= TRIED) return 0;
      this.stand(0, k);
      option.textContent = `${this.part}: ${words}`;
      return this.reached(this.scene.part);
    });
    this.first = reached.indexOf(Math.max(...reached));
    menu.parentElement.hidden = r < 2;
    menu.addEventListener("change", () => {
      this.stand(0, Number(menu.value));
      this.settle();
    });
    input.addEventListener("input", () => this.slide(Number(input.value)));
    input.addEventListener("change", () => this.settle());
    for (const begin of ["pointerenter", "focus"])
      input.addEventListener(begin, () => this.pointAhead());
    for (const end of ["pointerleave", "blur"]) input.addEventListener(end, () => this.pointBack());
    // keys move the slider alone, not the time
    input.addEventListener("keydown", (event) => {
      if (/^(Arrow|Home|End|Page)/.test(event.key)) event.stopPropagation();
    });
    this.stand(0, this.first);
    byId("elbow-box").hidden = this.selves.qs.length < 4;
  }

  // Begin from place i of the slider, along level k: all controls, and what is drawn next.
  stand(i, k = this.level) {
    const { chain, laws } = this;
    this.work = null;
    if (!laws.some(({ r }) => r) || this.scene.cover) {
      this.elbowAt = 0;
      for (const law of laws) law.stand(chain.start);
      return;
    }
    if (k !== this.level || !this.selves) {
      const free = laws.find(({ r }) => r);
      const atStart = this.atStart[laws.indexOf(free)];
      for (const law of laws) law.stand(chain.start);
      this.level = k;
      this.selves = selfMotion(free, chain.start, k, (law, q) => {
        const { margin } = chain.nearest(q);
        return (
          margin > NEAR_LIMIT &&
          law.margin() > LEAST_MARGIN &&
          law.sine() > MIN_SINE_RATIO * atStart.sine
        );
      });
      const { qs, zero } = this.selves;
      Object.assign(byId("elbow"), { min: -zero, max: qs.length - 1 - zero });
      this.nameSlider();
    }
    const { qs, zero } = this.selves;
    this.elbowAt = Math.min(Math.max(i, -zero), qs.length - 1 - zero);
    for (const law of laws) law.stand(qs[zero + this.elbowAt]);
    byId("elbow").value = this.elbowAt;
    byId("level").value = this.level;
    const off = formatLength(this.elbowOff());
    byId("elbow").setAttribute("aria-valuetext", `${this.part} ${off} from the start of the study`);
    byId("elbow-off").textContent = off === "0" ? "0 cm" : off;
  }

  // Name the slider after the part that drifts in the study, or if that hardly moves along it,
  // after the one that moves most; not after a hand, which rests, also if the workpiece on which it
  // rests moves.
  nameSlider() {
    const { chain, arms, selves } = this;
    const [one, other] = [selves.qs[0], selves.qs.at(-1)].map((q) => bodiesOff(chain, arms[0], q));
    const hands = chain.frames.map(({ hand }) => hand);
    const off = arms[0].moving.map(({ shape }, k) =>
      chain.links[shape] && hands.includes(chain.links[shape][1]) ? 0 : Math.max(one[k], other[k]),
    );
    const most = Math.max(0, ...off);
    const named = arms[0].moving.map(({ shape }) => (chain.links[shape] || [])[1]);
    const drifting = off.filter((_, k) => named[k] === this.drifting);
    const moves = Math.max(0, ...drifting) > DRIVEN * most;
    this.part = (moves ? this.drifting : named[off.indexOf(most)]) || "arm";
    byId("elbow-name").textContent = `Move ${shortName(this.part)}`;
  }

  // How far a part is from its start at the ends of the slider, m.
  reached(part) {
    const { chain, arms, selves } = this;
    const ends = [selves.qs[0], selves.qs.at(-1)];
    return Math.max(0, ...ends.flatMap((q) => bodiesOff(chain, arms[0], q, part)));
  }

  // How far that part is from where the study starts, at its farthest point, m.
  elbowOff() {
    const { chain, arms, laws, part } = this;
    return Math.max(0, ...bodiesOff(chain, arms[0], laws[0].start, part));
  }

  // Outline and name the part that the slider moves, before it is moved.
  pointAhead() {
    const { arms, scene } = this;
    if (this.lead || this.before) return;
    this.before = { part: scene.part, places: arms.map(({ part, spot }) => ({ part, spot })) };
    scene.part = this.part;
    pointAt(arms, this.isOf(this.part));
    this.player.show();
  }

  // Point at the part of before again, unless the slider was moved.
  pointBack() {
    const { arms, before, scene } = this;
    this.before = null;
    if (!before) return;
    scene.part = before.part;
    arms.forEach((arm, k) => {
      Object.assign(arm, before.places[k]);
      arm.outlinePart();
    });
    this.player.show();
  }

  isOf(part) {
    const { links } = this.chain;
    return (s) => Boolean(links[s]) && links[s][1] === part;
  }

  // Show both arms at a place of the slider, with the hands at rest; the ghost stays at the start.
  slide(i) {
    if (!this.lead || !this.lead.slides) {
      this.endGesture();
      this.beginGesture({ slides: true, hands: this.chain.homes, ghost: this.chain.start });
      // the place of the part that moves most on the way to the slider's end
      this.lead.qs = this.laws.map(() => this.selves.qs.at(i < 0 ? 0 : -1));
      this.drawArms();
      this.scene.part = this.part;
      pointAt(this.arms, this.isOf(this.part));
    }
    this.stand(i);
    this.lead.qs = this.laws.map((law) => law.start);
    this.drawArms();
    const { frames } = this.chain;
    const rest = frames.length > 1 ? "The hands stay" : "The hand stays";
    const where = frames[0].base ? "at its place on the workpiece" : "at rest";
    const text = `${rest} ${where} while the arm moves: this is what redundancy is.`;
    // words that stay are not written again: a page lays out what was written
    if (byId("verdict").textContent !== text)
      this.write([[text]], [[LET_GO]], `${this.part} moved`);
    this.player.show();
  }

  // Follow the loop, or the study's path, from where the slider stands.
  settle() {
    if (this.points) return this.follow(this.points, 1);
    if (!this.elbowAt && this.level === this.first) return this.leave();
    return this.studied ? this.follow(null, 1) : this.preset("circle");
  }

  // ---- what takes long

  // Do work in slices between pictures, until something else begins. A gesture that has ended shows
  // its arms until then.
  async run(work) {
    this.work = work;
    if (this.lead) this.lead.id = undefined; // of no pointer, and of no key
    while (this.work === work) {
      const until = performance.now() + SLICE;
      while (performance.now() < until)
        if (work.next().done) {
          if (this.work === work) this.work = null;
          return;
        }
      if (this.lead) this.write([["Computing what both arms do …"]], null, null);
      await new Promise((resolve) => {
        setTimeout(resolve);
      });
    }
    work.return();
  }

  // ---- the gesture

  at(k, event) {
    const { left, top } = this.panes.frames[k].getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  // Where all hands are when the one that is led is here: the others still, or its mirror image in
  // the plane halfway between their starts.
  hands(point) {
    const { homes } = this.chain;
    const home = homes[this.led];
    return homes.map((other, f) => {
      if (f === this.led) return point;
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
    if (!this.mirrored) return inStep(this.chain.homes.map((_, f) => this.loopOf(f)));
    const along = this.points.map((p) => this.hands(p));
    return this.chain.homes.map((_, f) => along.map((hands) => hands[f]));
  }

  // The loop of hand f, null for one that holds still.
  loopOf(f) {
    return (f === this.led ? this.points : !this.mirrored && this.others[f]) || null;
  }

  // The hands that keep a loop of their own beside the one that is led.
  keeping() {
    return this.chain.frames.filter((_, f) => f !== this.led && this.loopOf(f));
  }

  // The same paths as they are drawn.
  lines(paths) {
    return paths.filter(Boolean).map((path) => path.map((p) => this.onPiece(p).toArray()));
  }

  // Take hand f in pane k, in the plane through it that faces the camera, or in the task's own.
  grab(k, id, at, f = 0) {
    const T = MeshCat.THREE;
    const { chain } = this;
    const home = chain.homes[f];
    const { rows } = chain.frames[f];
    if (!this.lead)
      this.earlier = this.points && {
        points: this.points,
        missed: this.missed,
        led: this.led,
        others: [...this.others],
        shown: this.shown,
      };
    const missing = [0, 1, 2].filter((row) => !rows.includes(row));
    // the hand that was led keeps its loop, if it could follow it
    if (f !== this.led && !this.mirrored && !this.missed.length)
      this.others[this.led] = this.points;
    this.led = f;
    this.points = null;
    chain.led = f;
    this.stand(this.elbowAt);
    const seen = this.seen(k, home);
    const grip = at ? { x: seen.x - at.x, y: seen.y - at.y } : { x: 0, y: 0 };
    const normal = missing.length
      ? new T.Vector3().setComponent(missing[0], 1)
      : this.sight(k, seen).direction;
    const plane = new T.Plane().setFromNormalAndCoplanarPoint(normal, new T.Vector3(...home));
    this.beginGesture({
      k,
      id,
      grip,
      plane,
      queue: [],
      hand: home.slice(),
      hands: chain.homes,
      trail: [home.slice()],
      length: 0,
      seen: 0, // points of it that were looked at
      qs: this.laws.map((law) => law.start.slice()),
      worst: this.laws.map(() => ({})),
      refusal: "",
      missed: [], // strokes of the pointer that the hand could not follow
      missing: null, // the last of them, until the hand has come up
    });
    this.leaveMarks(plane);
    if (chain.frames.length > 1) {
      // the elbow of this hand is the part in words
      const rides = chain.links.find(
        (link) => link && link[1] && link[0] === chain.frames[f].elbow,
      );
      this.drawArms();
      if (rides) [, this.scene.part] = rides;
      pointAt(this.arms, this.isOf(this.scene.part));
    }
    this.write(DRAW, this.hint());
    this.draw();
  }

  // Stop time, and show both arms as they are led from now on.
  beginGesture(lead) {
    this.before = null;
    this.clock.play(false);
    this.player.plain();
    this.lead = lead;
    for (const arm of this.arms) {
      const data = { ...arm.study.run.data, broken: null, lost: Infinity };
      const motion = new Float64Array(2 * (arm.stride + 6 * arm.chains));
      const { joints } = arm.study.run;
      arm.use({ data, motion, frames: 2, perCycle: 1, joints, most: arm.mostOff() });
      // the slider shows how far the arm is from the start, in both panes
      if (lead.slides) arm.reference = null;
      arm.notice.textContent = "";
    }
    const kept = lead.slides ? [] : this.chain.homes.map((_, f) => this.loopOf(f));
    this.player.clear(this.lines(kept));
    Object.assign(this.scene, { failure: null, idle: false });
    byId("lines").hidden = true;
    this.state = "leading";
    document.body.classList.add("leading", "own");
    this.scene.leading = lead.slides ? "slides" : "leads";
  }

  // What each arm leaves behind while its hand is led: trails, the way home, the proved disc.
  leaveMarks(plane) {
    const T = MeshCat.THREE;
    const { chain } = this;
    this.lead.shown = this.arms.map((arm) => {
      const { color } = arm.data;
      const positions = new T.Float32BufferAttribute(3 * DOTS, 3);
      const line = dots(new T.BufferGeometry().setAttribute("position", positions), color);
      // a loop stays on a workpiece that moves
      const piece = arm.carrier ? arm.paths : arm.traces;
      piece.add(line);
      const normal = this.turned(plane.normal);
      if (chain.proved) piece.add(disc(this.onPiece(chain.homes[this.led]), normal, chain.proved));
      const tips = chain.frames.map(() => new Trail(piece, color));
      const trails = [new Trail(arm.traces, color), ...tips];
      const edge = this.scene.cover && new EdgeLine(piece, this.scene.cover);
      return { line, trails, edge };
    });
  }

  move(event) {
    const { lead, chain } = this;
    if (!lead || event.pointerId !== lead.id) return;
    const events = event.getCoalescedEvents ? event.getCoalescedEvents() : [];
    const home = new MeshCat.THREE.Vector3(...chain.homes[this.led]);
    for (const one of events.length ? events : [event]) {
      const { x, y } = this.at(lead.k, one);
      const sight = this.sight(lead.k, { x: x + lead.grip.x, y: y + lead.grip.y });
      // beside the plane, the direction in which it is seen
      const hit =
        sight.intersectPlane(lead.plane, new MeshCat.THREE.Vector3()) ||
        lead.plane.projectPoint(sight.at(1e3 * chain.size, home.clone()), home.clone());
      lead.queue.push(this.limited(hit.toArray()));
    }
    this.scheduleStep();
  }

  // A place to which the hand is led, or the one in this direction at the farthest.
  limited(place) {
    const { homes, size } = this.chain;
    const home = new MeshCat.THREE.Vector3(...homes[this.led]);
    const off = new MeshCat.THREE.Vector3(...place).sub(home);
    return off
      .clampLength(0, FARTHEST * size)
      .add(home)
      .toArray();
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
    if (key === "Escape") this.leave();
    else if (this.work) return;
    else if (key === "Enter" && this.lead) this.release();
    else {
      if (!this.lead) this.grab(k, null, null, f);
      if (direction) this.nudge(direction);
      else this.write([["Draw a loop by the arrow keys; Enter lets go."]], this.hint());
    }
  }

  // Lead the hand a little right or up on the screen.
  nudge(direction) {
    const { hand, queue } = this.lead;
    const goal = new MeshCat.THREE.Vector3(...(queue.at(-1) || hand));
    const step = 0.015 * this.chain.size;
    this.axes().forEach((axis, i) => goal.addScaledVector(axis, direction[i] * step));
    queue.push(goal.toArray());
    this.scheduleStep();
  }

  // Right and up on the screen, in the plane in which the hand is led.
  axes() {
    const { elements } = this.panes.viewer.camera.matrixWorld;
    const { k, plane } = this.lead;
    const { normal } = plane;
    const back = this.pieceIn(k).invert();
    return [0, 4].map((i) =>
      new MeshCat.THREE.Vector3(elements[i], -elements[i + 2], elements[i + 1])
        .transformDirection(back)
        .projectOnPlane(normal)
        .normalize(),
    );
  }

  // Step towards the points that the hand was led to, as many as there is time for until the next
  // picture.
  scheduleStep() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      if (!this.lead) return;
      this.processQueue(performance.now() + BUDGET);
      this.draw();
      if (this.lead.queue.length) this.scheduleStep();
    });
  }

  processQueue(until = Infinity) {
    const { lead } = this;
    while (lead.queue.length && performance.now() < until) {
      const goal = lead.queue[0];
      const far = gap(goal, lead.hand);
      if (far < 1e-6) {
        lead.queue.shift();
        continue;
      }
      const share = Math.min(1, this.stride / far);
      const next = lead.hand.map((v, i) => v + share * (goal[i] - v));
      lead.refusal = this.step(lead, next);
      if (!lead.refusal) {
        lead.length += gap(next, lead.hand);
        lead.hand = next;
        lead.hands = this.hands(next);
        lead.trail.push(next);
        this.extendTrails();
      }
      if (!lead.refusal && share < 1) continue;
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

  extendTrails() {
    const { chain, lead } = this;
    this.arms.forEach((arm, k) => {
      const [behind, ...tips] = lead.shown[k].trails;
      tips.forEach((tip, f) => tip.add(this.onPiece(lead.hands[f])));
      if (arm.spot) behind.add(new MeshCat.THREE.Vector3(...spotAt(chain, arm, lead.qs[k])));
    });
  }

  // Step all arms of {hand, qs, worst} to the next place of the hand; or say why none of them can,
  // and stay. An arm that alone cannot goes on as it can, or waits; `together`: all stay. So they
  // do on the page of a cell, whose function holds the hand.
  step(from, next, together = this.scene.cover) {
    const targets = this.hands(next);
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
    const { chain } = this;
    const law = this.laws[k];
    const q = stepped(law, from.qs[k], targets);
    if (!q) return { refusal: OUT_OF_REACH };
    if (this.scene.cover) return this.coveredStep(law, q, targets);
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
      for (;;) {
        const far = gap(goal, from.hand);
        if (far < 1e-9) break;
        const share = this.stride / far;
        const next = share > 1 ? goal : from.hand.map((v, i) => v + share * (goal[i] - v));
        const refusal = this.step(from, next, together);
        if (refusal) return { refusal, trail };
        from.hand = next;
        trail.push(next);
        yield;
      }
    return { refusal: "", trail };
  }

  // Draw both arms where they have been led, and say what holds them.
  draw() {
    const { lead } = this;
    const home = this.chain.homes[this.led];
    this.drawArms();
    for (const { line, edge } of lead.shown) {
      if (edge) edge.show(this.onPiece(lead.hand));
      const { geometry } = line;
      const { position } = geometry.attributes;
      const count = Math.min(DOTS, Math.floor(gap(lead.hand, home) / (0.018 * this.extent)));
      for (let i = 0; i < count; i++) {
        const share = (i + 0.5) / count;
        const dot = lead.hand.map((v, c) => v + share * (home[c] - v));
        position.setXYZ(i, ...this.onPiece(dot).toArray());
      }
      geometry.setDrawRange(0, count);
      position.needsUpdate = true;
    }
    // what has been beyond stays so
    const beyond = lead.beyond || this.beyond(lead.trail.slice(lead.seen));
    lead.seen = lead.trail.length;
    const warning = this.warning();
    if (warning !== lead.warning || beyond !== lead.beyond) {
      Object.assign(lead, { warning, beyond });
      const further = lead.refusal ? " Go another way, or let go." : " Draw on, or let go.";
      const sentence = warning ? [[warning, lead.refusal ? "bad" : "near"], [further]] : DRAW;
      this.write(sentence, this.hint(beyond));
    }
    const far = lead.length ? `, ${formatLength(lead.length)} so far` : "";
    this.entitle(`your loop${far}, ${planeWords(this.turned(lead.plane.normal))}`);
    this.player.show();
  }

  // What holds the hand, or the one arm that cannot follow it; empty while both can.
  warning() {
    const { refusal, refusals = [] } = this.lead;
    if (refusal) return stated(refusal);
    const k = refusals.findIndex(Boolean);
    return k < 0 ? "" : stated(`${refusals[k]} under ${this.arms[k].data.under}`);
  }

  // Put both arms where they have been led; the ghost is the last of them, or as `lead` says.
  drawArms() {
    const { lead } = this;
    this.arms.forEach((arm, k) => {
      // a ghost that stays is drawn once
      if (!lead.ghostDrawn) drawnAt(this.chain, arm, lead.ghost || lead.qs.at(-1), arm.run, 0);
      drawnAt(this.chain, arm, lead.qs[k], arm.run, 1);
    });
    lead.ghostDrawn = Boolean(lead.ghost);
  }

  // Close the loop: straight home, or along the way it came where that is blocked.
  release() {
    return this.run(this.closing());
  }

  *closing() {
    const { lead, chain } = this;
    while (lead.queue.length) {
      this.processQueue(performance.now() + BUDGET);
      yield;
    }
    const home = chain.homes[this.led];
    const open = lead.trail;
    if (Math.max(...open.map((p) => gap(p, home))) < LEAST_STROKE * chain.size) {
      if (this.earlier) yield* this.again();
      else this.leave([["That was no loop yet: drag the ring around, and let go."]]);
      return;
    }
    const from = { hand: lead.hand, qs: lead.qs.slice(), worst: lead.worst };
    const { refusal } = yield* this.walk(from, [home]);
    const back = refusal ? open.slice(0, -1).reverse() : [];
    if (refusal) lead.missed.push([from.hand, home]);
    const missed = lead.missed
      .filter(([stop, ...on]) => on.some((p) => gap(p, stop) > LEAST_STROKE * chain.size))
      .map(thinned);
    yield* this.following(kept([...open, ...back, home], home), 1, missed);
    this.keepBest();
  }

  // Follow the loops of before a press that drew none.
  *again() {
    const { points, missed, led, others, shown } = this.earlier;
    Object.assign(this, { led, others });
    this.chain.led = led;
    yield* this.following(points, shown, missed);
  }

  // Put the hand down: nothing of the gesture is left.
  endGesture() {
    if (!this.lead) return;
    this.scene.leading = "";
    cancelAnimationFrame(this.waiting);
    Object.assign(this, { lead: null, waiting: 0 });
    document.body.classList.remove("leading");
    for (const ring of this.rings.flat()) ring.classList.remove("pulse");
  }

  // ---- the loop

  // Compute the cycles of a closed loop, or of the study's path without points, and show the end of
  // this one of them. An arm that comes close to a singularity goes as far as it can. `missed`:
  // the strokes of the loop that was drawn that this one leaves out.
  follow(points, cycle) {
    return this.run(this.following(points, cycle, points ? this.missed : []));
  }

  *following(points, cycle, missed = []) {
    Object.assign(this, { points, missed });
    const paths = this.paths();
    const failed = yield* this.failed(points, missed);
    const [failure] = [...failed.values(), null];
    const shape = {
      encloses: paths.some((path) => path && enclosing(path) > 0),
      turns: points ? windings(this.chain.axis, points) : 0,
      whose: failure ? "the solid line" : points ? this.yours() : "the path",
    };
    // a way there and back in place of a loop is seen once
    const idle = Boolean(failure) && !shape.encloses;
    const result = yield* computed(this.laws, this.arms, paths, idle ? 1 : CYCLES);
    yield;
    this.endGesture();
    const strokes = this.lines([...failed.keys()]);
    yield* this.player.play({ ...result, paths: this.lines(paths), strokes });
    yield;
    Object.assign(this.scene, { failure: failure && failure.reasons, idle });
    const length = points ? lengthOf(points) : result.length;
    Object.assign(this, { result, length, failure, shape, state: "own" });
    this.clock.whole = !idle && result.runs.some(({ data }) => data.lost >= 1);
    document.body.classList.add("own");
    byId("own").hidden = false;
    byId("again").hidden = idle || result.cycles < 2;
    byId("lines").hidden = !failure;
    byId("loop-csv").hidden = !points || Boolean(this.scene.cover);
    yield;
    this.report(Math.min(cycle, result.cycles));
    // of a way there and back, its far end
    this.clock.seek(idle ? failure.after / length : this.shown);
  }

  // Where on a loop the hand cannot follow each of these strokes, without those that it can: an
  // address may have such, and so may another place of the slider.
  *failed(loop, strokes) {
    const found = new Map();
    for (const stroke of strokes) {
      const stop = yield* this.stopOf(loop, stroke);
      if (stop.reasons.length) found.set(stroke, stop);
    }
    return found;
  }

  // Where on a loop the hand cannot follow a stroke, and why: {after, m of the loop, reasons}, one
  // for each arm that cannot; where F ends, its `edge`, and how far the stroke `goes` beyond.
  *stopOf(loop, stroke) {
    const from = {
      hand: loop[0],
      qs: this.laws.map((law) => law.start.slice()),
      worst: this.laws.map(() => ({})),
    };
    const till = loop.slice(1, nearestPiece(loop, stroke[0]) + 1);
    const { refusal, trail } = yield* this.walk(from, [...till, ...stroke]);
    const reasons = refusal ? from.refusals : [];
    const edge = (refusal && from.edge) || null;
    return { after: lengthOf([loop[0], ...trail]), reasons, edge, goes: this.goesTo(edge, stroke) };
  }

  // How far a stroke goes in the coordinate of an edge of F, and the range of F there; null if that
  // is no position.
  goesTo(edge, stroke) {
    const chart = edge && edge.i < 3 && this.laws.at(-1).parts[0];
    return chart ? chart.farthest(edge.i, stroke, edge.at > edge.high) : null;
  }

  // Say what has happened after a number of cycles.
  report(cycles) {
    this.before = null;
    const { chain, arms, result, shape, failure, points } = this;
    const { sentence, notes, part } = answer(chain, arms, result, cycles, shape);
    this.shown = cycles;
    this.scene.part = part;
    pointAt(arms, this.isOf(part));
    notes.push(...this.loopNotes(cycles));
    const far = this.elbowOff();
    const moved = far > 1e-4 ? `, ${this.part} moved by ${formatLength(far)}` : "";
    const title = points ? `${shape.whose}${this.sizeWords()}${moved}` : `the study’s path${moved}`;
    if (failure) {
      notes.unshift([sentence.map(([text]) => text).join("")]);
      // its ball is not drawn: the one that is seen is where the loop stops
      for (const note of notes)
        note[0] = note[0]
          .replaceAll(", at the red ball", "")
          .replace("the red ball on", "there on");
      const atEdge = this.scene.cover && failure.reasons.at(-1);
      const words = atEdge ? edgeWords(failure) : failureWords(chain, arms, failure);
      sentence.splice(0, Infinity, ...words, lineWords(this.length, shape));
    }
    sentence.push([UNCHECKED]);
    this.write(sentence, notes, title);
    byId("again").textContent =
      cycles < result.cycles ? `Do it ${result.cycles} times` : "Once more";
    this.player.show();
  }

  // What a visitor calls what the hands follow.
  yours() {
    return this.keeping().length ? "your loops" : "your loop";
  }

  // The plane and the length of a loop that was drawn, or of each.
  sizeWords() {
    const each = this.chain.frames.flatMap(({ hand }, f) => {
      const loop = this.loopOf(f);
      if (!loop) return [];
      const whose = this.keeping().length ? ` of the ${hand}` : "";
      const plane = planeWords(this.turned(normalOf(loop)));
      return [`${whose}, ${formatLength(lengthOf(loop))} long, ${plane}`];
    });
    return each.join(";");
  }

  // A direction of the task as the scene has it.
  turned(direction) {
    return direction.clone().transformDirection(this.home);
  }

  // Whether points are beyond the proved radius around the start of the study.
  beyond(points) {
    const { proved, homes } = this.chain;
    return Boolean(proved) && points.some((p) => gap(p, homes[this.led]) >= proved);
  }

  // What is said under the sentence while the hand is led.
  hint(beyond = false) {
    const { proved } = this.chain;
    const kept = this.keeping().map(({ hand }) => [` The ${hand} keeps its loop.`]);
    if (!proved || this.elbowAt) return [HOW, ...kept];
    const far = formatLength(proved);
    return [
      HOW,
      ...kept,
      beyond
        ? [` You are more than ${far} from the start: there, closing is not proved.`, "near"]
        : [` Within the pale disc, ${far} around the start, the repeatable arm closes: proved.`],
    ];
  }

  // What is said of a loop beside its motion: whether it was proved to close; and after all cycles,
  // how far the usual arm has drifted, and after those of the best loop.
  loopNotes(cycles) {
    const { best, points, result } = this;
    const { proved, size } = this.chain;
    const far = formatLength(proved || 0);
    const limits = result.runs.some(({ data }) => data.broken);
    const aside = limits ? " The proof does not consider limits." : "";
    const words = [];
    if (proved && points && !this.elbowAt && !this.keeping().length)
      words.push(
        this.beyond(points)
          ? [
              ` Proved: after every loop that stays within ${far} of the start, the repeatable ` +
                `arm is back exactly.${aside} This loop goes farther, so it was computed, step ` +
                "by step.",
            ]
          : [` Proved: after this loop, the repeatable arm is back exactly.${aside}`, "good"],
      );
    if (best && points && cycles === this.result.cycles) {
      const long = formatLength(LEAST_LENGTH * size);
      const off = this.usualOff();
      const other = off !== null && Math.abs(off - best.off) > 1e-6; // another loop or start
      const whose = other ? `This loop: ${formatLength(off)}; your best` : "This loop, your best";
      words.push([
        ` Can you draw a loop, ${long} or longer, after ${CYCLES} cycles of which the usual arm ` +
          `is nearest to its start? ${whose} so far: ${formatLength(best.off)}.`,
      ]);
    }
    return words;
  }

  // How far the usual arm is from its start after all cycles, m; null if it has not completed them.
  usualOff() {
    const { result, laws } = this;
    const usual = result.runs[laws.findIndex(({ r }) => !r)];
    const complete = usual && result.cycles === CYCLES && usual.data.lost === Infinity;
    return complete ? Math.max(...usual.ends.at(-1)) : null;
  }

  // Keep the drawn loop under which the usual control drifts least, of those that are long enough
  // where they enclose something, and on which all controls keep the limits.
  keepBest() {
    const { chain, points, best, missed, result } = this;
    if (this.state !== "own" || !points || missed.length || this.keeping().length) return;
    const off = this.usualOff();
    const withinLimits = result.runs.every(({ data }) => !data.broken);
    if (off === null || !withinLimits || enclosing(points) < LEAST_LENGTH * chain.size) return;
    const { led, mirrored, elbowAt, level } = this;
    if (!best || off < best.off)
      this.best = { off, points, hand: led, mirrored, elbow: elbowAt, level };
    byId("best").hidden = false;
    const least = formatLength(this.best.off);
    byId("best").textContent =
      `Your best loop: ${least} under the usual control after ${CYCLES} cycles`;
    this.report(this.shown);
  }

  // From one cycle to all of them, by their ends, when only what drifts is seen to move; and again.
  repeat() {
    this.clock.seek(this.shown < this.result.cycles ? this.shown : 0);
    const done = () => this.report(this.result.cycles);
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.clock.seek(this.result.cycles);
      done();
    } else this.clock.finish(done);
  }

  // Back to the study, with something to say or with its own sentence.
  leave(words) {
    this.before = null;
    this.endGesture();
    this.stand(0, this.first);
    Object.assign(this, { state: "study", points: null, others: [], missed: [] });
    Object.assign(this.scene, { failure: null, idle: false });
    this.clock.whole = true;
    document.body.classList.remove("own", "unfolded");
    for (const id of ["own", "lines"]) byId(id).hidden = true;
    for (const [node, children] of this.texts) node.replaceChildren(...children);
    byId("title").removeAttribute("title");
    if (words) this.write(words, null, null);
    else this.fold();
    this.player.study();
  }

  // A loop of this kind through the hand, in the plane that faces the camera: the largest that the
  // arms can follow.
  preset(kind) {
    this.endGesture();
    this.grab(0, null, null, this.led);
    return this.run(this.largest(kind));
  }

  *largest(kind) {
    const { size } = this.chain;
    const home = this.chain.homes[this.led];
    const start = { hand: this.lead.hand, qs: this.lead.qs, worst: this.lead.worst };
    for (let wide = 0.16 * size; wide > 0.004 * size; wide *= 0.8)
      for (let turn = 0; turn < 8; turn++) {
        const points = this.placed(FORMS[kind], wide, (turn * Math.PI) / 4);
        if ((yield* this.walk({ ...start }, [...points, home], true)).refusal) continue;
        yield* this.following(kept([home, ...points, home], home), 1);
        return;
      }
    this.leave([["There is no room for such a loop here.", "bad"]]);
  }

  // Points of a form, turned and this wide, from the hand on in the plane in which it is led.
  placed(form, wide, angle) {
    const [right, up] = this.axes();
    const home = new MeshCat.THREE.Vector3(...this.chain.homes[this.led]);
    const c = wide * Math.cos(angle);
    const s = wide * Math.sin(angle);
    return form.map(([x, y]) =>
      home
        .clone()
        .addScaledVector(right, c * x - s * y)
        .addScaledVector(up, s * x + c * y)
        .toArray(),
    );
  }

  // The loop that an address asks for, after all its cycles; it may begin where the hand is not.
  open({ points, missed = [], hand = 0, others = [], mirrored = false, elbow = 0, level }) {
    const { chain } = this;
    this.endGesture();
    this.led = Math.min(hand, chain.frames.length - 1);
    this.others = chain.homes.map((home, f) => others[f] && closed(others[f], home));
    this.mirrored = mirrored && chain.frames.length > 1;
    chain.led = this.led;
    byId("mirror").checked = this.mirrored;
    this.stand(elbow, level ?? this.unnamed(elbow));
    return points ? this.run(this.opening(points, missed)) : this.settle();
  }

  *opening(points, missed) {
    const { chain, laws } = this;
    const home = chain.homes[this.led];
    const first = gap(points[0], home) < 1e-3 ? home : points[0];
    if (first !== home) {
      const qs = laws.map(() => laws.at(-1).start);
      const from = { hand: home, qs, worst: laws.map(() => ({})) };
      const { refusal } = yield* this.walk(from, [first], true);
      if (refusal) {
        this.leave([[`The loop in the address cannot be reached. ${stated(refusal)}`, "bad"]]);
        return;
      }
      for (const law of laws) law.start = from.qs.at(-1);
    }
    const strokes = missed.map((stroke) => stroke.map((place) => this.limited(place)));
    yield* this.following(closed(points, first), CYCLES, strokes);
  }

  // What the address keeps of all this.
  addressParts() {
    const { points, missed, led, mirrored, elbowAt, level } = this;
    if (this.state !== "own") return [];
    const number = (v) => Number(v.toFixed(4));
    const others = this.chain.homes.map((_, f) => (f === led ? null : this.loopOf(f)) || []);
    const written = (line) => line.map((p) => p.map(number).join(",")).join(";");
    return [
      points && `loop=${written(points)}`,
      points && missed.length && `missed=${missed.map(written).join("|")}`,
      points && led && `hand=${led + 1}`,
      points && this.keeping().length && `others=${others.map(written).join("|")}`,
      points && mirrored && "mirror=1",
      elbowAt && `elbow=${elbowAt}`,
      level !== this.unnamed(elbowAt) && `level=${level + 1}`,
    ].filter(Boolean);
  }

  // The level of the slider in an address without one: the first if the slider is moved.
  unnamed(elbow) {
    return elbow ? 0 : this.first;
  }

  // The loop as a file of waypoints: columns x,y,z, or those of each frame that moves.
  csv() {
    const { frames } = this.chain;
    const moving = this.paths()
      .map((path, f) => ({ path, name: frames.length > 1 ? `${frames[f].frame}.` : "" }))
      .filter(({ path }) => path);
    const head = moving.flatMap(({ name }) => ["x", "y", "z"].map((axis) => name + axis));
    const rows = moving[0].path.map((_, i) =>
      moving.flatMap(({ path }) => Array.from(path[i], (v) => Number(v.toFixed(9)))),
    );
    return `${[head, ...rows].map((row) => row.join(",")).join("\n")}\n`;
  }

  // ---- what is written and where

  write(sentence, notes, title) {
    const part = ([text, kind]) =>
      kind === undefined ? text : element("b", { class: kind }, text);
    byId("verdict").replaceChildren(...sentence.map(part));
    const note = ([text, kind]) => element("span", { class: kind || "" }, text);
    if (notes) byId("notes").replaceChildren(...notes.map(note));
    if (title) this.entitle(title);
    this.fold();
  }

  entitle(words) {
    const title = `${this.scene.title.split(":")[0]}: ${words}`;
    setText(byId("title"), title);
    setAttribute(byId("title"), "title", title);
  }

  // Show as many lines of a loop's notes as there is room for under its sentence, and a button for
  // all of them, which then stand beside the views.
  fold() {
    const { classList } = document.body;
    const [notes, more, verdict] = ["notes", "more", "verdict"].map(byId);
    const [header] = document.getElementsByTagName("header");
    // what is said of a loop has the room of the head, whatever its sentence takes of it
    notes.style.minHeight = this.state === "study" ? this.notesHeight : "0";
    notes.style.maxHeight = "";
    // a sentence that is longer than any of a study or a gesture
    classList.toggle("tall", this.head && verdict.offsetTop + verdict.offsetHeight > this.head + 1);
    const open = classList.contains("unfolded");
    const clear = () => notes.offsetTop + notes.scrollHeight <= this.head - HEAD_FOOT;
    header.classList.remove("cut");
    const room = notes.offsetHeight && !classList.contains("noted");
    const folded = this.state !== "study" && this.head && room && !clear();
    header.classList.toggle("cut", Boolean(folded));
    more.textContent = open ? "Fewer notes" : "All notes";
    more.setAttribute("aria-expanded", String(open));
    if (!folded || open) return;
    const line = parseFloat(getComputedStyle(notes).lineHeight);
    const lines = Math.floor((this.head - HEAD_FOOT - notes.offsetTop) / line + 0.01);
    notes.style.maxHeight = `${Math.max(lines, 0) * line}px`;
  }

  // Give sentence and notes the room of the longest words of a gesture, so that nothing moves when
  // they change; what is said of a loop takes the same room.
  reserve() {
    const [[ring]] = this.rings;
    // the words "Drag me", and fewer of them
    const sizes = [false, true].map((short) => {
      ring.classList.toggle("short", short);
      return { w: ring.firstChild.offsetWidth, h: ring.firstChild.offsetHeight };
    });
    if (sizes[0].w) {
      this.inviting = sizes;
      this.reach = ring.offsetWidth / 2 + 2; // px from the hand to the words
    }
    this.reserveHead();
    this.fold();
  }

  // The height of the page's head with the study's words and with those of a gesture.
  reserveHead() {
    const { body } = document;
    const [header] = document.getElementsByTagName("header");
    this.head = 0;
    if (!header.clientWidth) return;
    const nodes = this.texts.map(([node]) => node);
    const now = nodes.map((node) => [...node.childNodes]);
    const classes = body.className;
    body.classList.remove("own", "leading", "unfolded");
    header.classList.remove("cut");
    for (const node of nodes) Object.assign(node.style, { minHeight: "", maxHeight: "" });
    for (const [node, children] of this.texts) node.replaceChildren(...children);
    for (const [id, words] of Object.entries(LEAD_WORDS)) {
      const node = byId(id);
      const children = [...node.childNodes];
      const before = node.clientHeight;
      node.replaceChildren(...words.map((text) => element("span", {}, text)));
      let height = Math.max(before, node.clientHeight);
      if (id === "verdict") {
        // the sentence of a loop is that of a study, with a word on collisions
        node.replaceChildren(...children, UNCHECKED);
        height = Math.max(height, node.clientHeight);
      }
      node.replaceChildren(...children);
      if (height) node.style.minHeight = `${height}px`;
    }
    const [[title]] = this.texts;
    body.style.setProperty("--title", `${title.offsetWidth}px`);
    title.style.minHeight = `${title.offsetHeight}px`;
    this.notesHeight = byId("notes").style.minHeight;
    this.head = header.getBoundingClientRect().height;
    body.style.setProperty("--head", `${this.head}px`);
    nodes.forEach((node, k) => node.replaceChildren(...now[k]));
    body.className = classes;
  }

  // Where the hands' rings are, in the pixels of each pane.
  spots() {
    const { chain, lead } = this;
    this.rest = lead ? lead.hands : this.points ? this.hands(this.points[0]) : chain.homes;
    return this.rings.map((_, k) => this.rest.map((hand) => this.seen(k, hand)));
  }

  // Put the rings where the hands are, and their words where `rooms` has room; they are not there
  // while the hands go round without them.
  place(rooms = [], spots = this.spots()) {
    this.rings.forEach((row, k) =>
      row.forEach((ring, f) => {
        const { x, y } = spots[k][f];
        ring.style.transform = `translate(calc(${x}px - 50%), calc(${y}px - 50%))`;
        ring.classList.toggle("away", this.clock.playing && this.isAway(k, f));
        if (rooms[k] && !k && this.inviting) this.invite(ring, f, spots[k][f], rooms[k]);
      }),
    );
  }

  // Put the words "Drag me" at a ring where they cover least, fewer if there is no room for more;
  // those of another hand only where they cover nothing.
  invite(ring, f, { x, y }, room) {
    const out = this.reach; // reading it here would lay out the page at each picture
    const places = this.inviting.flatMap(({ w, h }, short) =>
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
      place.h * beside(place.x, place.w, room.width) +
      place.w * beside(place.y, place.h, room.height);
    ring.side = room.best(places, cost, ring.side);
    const place = places[ring.side];
    for (const side of ["left", "under", "above"]) ring.classList.toggle(side, place.side === side);
    ring.classList.toggle("short", Boolean(place.short));
    ring.classList.toggle("mute", f > 0 && cost(place) > 0);
    if (!ring.matches(".mute, .away")) room.box(place);
  }

  isAway(k, f) {
    const { now } = this.arms[k];
    if (this.lead || this.clock.time % 1 === 0) return false;
    const tip = this.arms[k].point("tip", f, now.frame, now.f);
    const rest = new MeshCat.THREE.Vector3(...this.rest[f]).applyMatrix4(this.pieceIn(k));
    return tip.distanceTo(rest) > 0.02 * this.extent;
  }
}

// The longest sentence of a gesture, and the notes of a loop on which joints keep their limits.
const LEAD_WORDS = {
  verdict: ["That joint would have to be faster than it can. Go another way, or let go."],
  notes: [
    "Average joint speed on this path: 0.7 % higher under the repeatable one than under the " +
      "usual control in cycle 1.",
    "Joint limits are kept.",
    "The repeatable control stays far from where it fails: 0.82 (1 is best, 0 fails).",
  ],
};
const LET_GO =
  "Let go: both arms follow the path from here, and the repeatable one comes back here.";
// The placement of a base as a matrix of the scene; of none, the unit matrix.
function placementOf(base) {
  const M = new MeshCat.THREE.Matrix4();
  if (!base) return M;
  const { R, p } = base;
  return M.set(...[0, 1, 2].flatMap((i) => [...R.subarray(3 * i, 3 * i + 3), p[i]]), 0, 0, 0, 1);
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

// A pale disc around the start, within which a proof holds.
function disc(home, normal, radius) {
  const T = MeshCat.THREE;
  const pale = new T.Group();
  const material = (opacity) =>
    new T.MeshBasicMaterial({
      color: tone("--good"),
      transparent: true,
      opacity,
      side: T.DoubleSide,
      depthWrite: false,
    });
  const edge = new T.Mesh(
    new T.RingGeometry(0.94 * radius, radius, 72),
    Object.assign(material(0.8), { depthTest: false }),
  ); // seen through the arm
  edge.renderOrder = 7;
  pale.add(new T.Mesh(new T.RingGeometry(0, radius, 72), material(0.12)), edge);
  pale.quaternion.setFromUnitVectors(new T.Vector3(0, 0, 1), normal.clone().normalize());
  pale.position.copy(home);
  return pale;
}
