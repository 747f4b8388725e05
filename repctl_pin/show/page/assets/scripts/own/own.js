// The visitor's own loop: take the hand at its ring, draw, let go; both arms follow, and the page says what has happened.

import { pointAt } from "../arm/arm.js";
import { download } from "../chrome/save.js";
import { byId, element, tone } from "../dom.js";
import { Chain, Law, pieces, stepped } from "../arm/law.js";
import { inMetres } from "../numbers.js";
import { computed, drawnAt, resolved } from "./run.js";
import { answer } from "./sentence.js";
import { dots, Trail } from "../arm/traces.js";

const CYCLES = 10;
const POINTS = 40; // of a loop, as it is kept
const NEAR_LIMIT = 0.002; // rad or m, before which the hand stops
const LEAST_MARGIN = 0.15; // of the leaf, below which it stops
const DRAW = [["Draw a loop and let go. Both arms follow."]];
const HOW = ["The dotted line closes the loop."];
const DOTS = 200; // of that line, at most
const RACE = 4; // times the joint speed at the start, or times the limit at the study's speed, at which it stops
const FLAT = 0.35; // part of the smallest sine between the rows of J at the start, below which it stops
const LEAST_LENGTH = 0.25; // of the arm, from which a loop counts for the best
const BUDGET = 5; // ms of steps between two pictures

export class Own {
  // `player`: {play(result), study(), plain(), clear(), show()}, which shows a result of computed(), or the study again
  constructor(data, { arms, panes, scene, clock, extent, player }) {
    Object.assign(this, {
      arms,
      panes,
      scene,
      clock,
      extent,
      player,
      chain: new Chain(data),
      state: "study",
      points: null,
      lead: null,
      keys: false,
    });
    this.laws = data.laws.map((parts) =>
      Object.assign(new Law(this.chain, parts), { start: Float64Array.from(data.start) }),
    );
    this.stride = this.chain.size / 250;
    this.calm = this.laws.map((law) => ({ speed: quickest(law, data.start), sine: law.sine() }));
    this.texts = ["title", "verdict", "notes"].map((id) => [byId(id), [...byId(id).childNodes]]);
    this.rings = panes.frames.map((frame, k) => this.ring(frame, k));
    window.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"])
      window.addEventListener(end, (event) => {
        if (this.lead && event.pointerId === this.lead.id) {
          document.activeElement.blur();
          this.letGo();
        }
      });
    byId("again").addEventListener("click", () => this.repeat());
    byId("back").addEventListener("click", () => this.leave());
    byId("loop-csv").addEventListener("click", () =>
      download(new Blob([this.csv()], { type: "text/csv" }), "loop.csv"),
    );
    for (const button of byId("loops").querySelectorAll("[data-loop]"))
      button.addEventListener("click", () => {
        byId("loops").open = false;
        this.preset(button.dataset.loop);
      });
    byId("copy").addEventListener("click", ({ currentTarget }) => {
      navigator.clipboard.writeText(location.href).then(
        () => {
          currentTarget.textContent = "Copied";
        },
        () => {},
      );
    });
    byId("best").addEventListener("click", () => {
      byId("loops").open = false;
      this.open(this.best.points);
    });
    byId("loops").hidden = false;
    clock.invite = () => {
      if (this.state === "study") for (const ring of this.rings) ring.classList.add("pulse");
    };
  }

  ring(frame, k) {
    const words = element(
      "span",
      { class: "drag-me", "aria-hidden": "true" },
      "Drag me",
      element("i", {}, ": draw a loop"),
    );
    const ring = element(
      "button",
      {
        class: "ring",
        type: "button",
        "aria-label":
          "Drag me: lead the hand by the pointer, or by the arrow keys and Enter, to draw a loop",
        title: "Drag the hand to draw a loop",
      },
      words,
    );
    if (k) ring.tabIndex = -1;
    ring.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      event.preventDefault();
      this.take(k, event.pointerId, this.at(k, event));
    });
    ring.addEventListener("keydown", (event) => this.key(k, event));
    ring.addEventListener("blur", () => {
      if (this.lead && this.lead.id === null) this.letGo();
    });
    frame.append(ring);
    return ring;
  }

  // ---- the gesture

  at(k, event) {
    const { left, top } = this.panes.frames[k].getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  // Take the hand in pane k, in the plane through it that faces the camera, or in the task's own.
  take(k, id, at) {
    const T = MeshCat.THREE;
    const { chain, arms } = this;
    const home = new T.Vector3(...chain.home);
    const missing = [0, 1, 2].filter((row) => !chain.rows.includes(row));
    this.clock.play(false);
    this.player.plain();
    const out = this.panes.sight(k, this.panes.seen(k, home)).direction;
    const normal = missing.length ? new T.Vector3().setComponent(missing[0], 1) : out;
    const seen = this.panes.seen(k, home);
    const grip = at ? { x: seen.x - at.x, y: seen.y - at.y } : { x: 0, y: 0 };
    for (const law of this.laws) law.start = Float64Array.from(chain.start);
    this.lead = {
      k,
      id,
      grip,
      plane: new T.Plane().setFromNormalAndCoplanarPoint(normal, home),
      queue: [],
      hand: chain.home.slice(),
      trail: [chain.home.slice()],
      qs: this.laws.map((law) => law.start.slice()),
      worst: this.laws.map(() => ({})),
      why: "",
    };
    arms.forEach((arm) => {
      arm.use({
        data: { ...arm.study.run.data, broken: null },
        motion: new Float64Array(2 * (arm.stride + 6)),
        frames: 2,
        perCycle: 1,
      });
      arm.notice.textContent = "";
    });
    this.player.clear();
    this.lead.shown = arms.map((arm) => {
      const group = arm.traces;
      const line = dots(
        new T.BufferGeometry().setAttribute("position", new T.Float32BufferAttribute(3 * DOTS, 3)),
        arm.data.color,
      );
      group.add(line);
      if (chain.proved) group.add(disc(home, normal, chain.proved));
      return {
        line,
        tip: new Trail(group, arm.data.color),
        elbow: new Trail(group, arm.data.color),
      };
    });
    this.state = "leading";
    document.body.classList.add("leading", "own");
    byId("own").hidden = true;
    this.scene.leading = true;
    this.write(DRAW, this.how(), "your loop");
    this.draw();
  }

  move(event) {
    const { lead } = this;
    if (!lead || event.pointerId !== lead.id) return;
    const events = event.getCoalescedEvents ? event.getCoalescedEvents() : [];
    for (const one of events.length ? events : [event]) {
      const { x, y } = this.at(lead.k, one);
      const ray = this.panes.sight(lead.k, { x: x + lead.grip.x, y: y + lead.grip.y });
      const hit = ray.intersectPlane(lead.plane, new MeshCat.THREE.Vector3());
      if (
        hit &&
        hit.distanceTo(new MeshCat.THREE.Vector3(...this.chain.home)) < 4 * this.chain.size
      )
        lead.queue.push(hit.toArray());
    }
    this.soon();
  }

  key(k, event) {
    const way = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[
      event.key
    ];
    if (
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      !(way || event.key === "Enter" || (event.key === "Escape" && this.lead))
    )
      return;
    event.preventDefault();
    event.stopPropagation();
    if (event.key === "Escape") {
      this.leave();
      return;
    }
    if (event.key === "Enter") {
      if (this.lead) this.letGo();
      else {
        this.take(k, null);
        this.write([["Draw a loop by the arrow keys; Enter lets go."]], this.how(), "your loop");
      }
      return;
    }
    if (!this.lead) this.take(k, null);
    const { hand, queue } = this.lead;
    const from = new MeshCat.THREE.Vector3(...(queue.at(-1) || hand));
    this.axes().forEach((axis, i) => from.addScaledVector(axis, way[i] * 0.015 * this.chain.size));
    queue.push(from.toArray());
    this.soon();
  }

  // Right and up on the screen, in the plane in which the hand is led.
  axes() {
    const { elements } = this.panes.viewer.camera.matrixWorld;
    const { normal } = this.lead.plane;
    return [0, 4].map((k) =>
      new MeshCat.THREE.Vector3(elements[k], -elements[k + 2], elements[k + 1])
        .projectOnPlane(normal)
        .normalize(),
    );
  }

  // Step towards the points that the hand was led to, as many as there is time for until the next picture.
  soon() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      const { lead } = this;
      if (!lead) return;
      this.catchUp(performance.now() + BUDGET);
      this.draw();
      if (lead.queue.length) this.soon();
    });
  }

  catchUp(until = Infinity) {
    const { lead } = this;
    const tips = lead.shown.map(({ tip, elbow }) => [tip, elbow]);
    while (lead.queue.length && performance.now() < until) {
      const goal = lead.queue[0];
      const away = goal.map((v, i) => v - lead.hand[i]);
      const far = Math.hypot(...away);
      const share = Math.min(1, this.stride / far);
      if (far < 1e-6) {
        lead.queue.shift();
        continue;
      }
      const next = lead.hand.map((v, i) => v + share * away[i]);
      const why = this.step(lead, next);
      lead.why = why;
      if (why) {
        lead.queue.shift();
        continue;
      }
      Object.assign(lead, { hand: next });
      lead.trail.push(next);
      this.laws.forEach((law, k) => {
        const { chain } = this;
        chain.place(lead.qs[k], chain.all);
        tips[k][0].add(new MeshCat.THREE.Vector3(...next));
        tips[k][1].add(new MeshCat.THREE.Vector3(...chain.places[chain.elbow].p));
      });
      if (share === 1) lead.queue.shift();
    }
  }

  // Step all arms of {hand, qs, worst} to the next place of the hand; or say why one of them cannot, and stay.
  step(from, next) {
    const { chain, laws } = this;
    const way = Math.hypot(...next.map((v, i) => v - from.hand[i]));
    const found = laws.map((law, k) => {
      const q = stepped(law, from.qs[k], next);
      if (!q) return { why: "That is out of reach." };
      const { joint, margin } = chain.nearest(q);
      const moved = q.map((v, i) => v - from.qs[k][i]);
      const fast = chain.hurried(moved.map((v) => (v * chain.speed) / way));
      const leaf = law.margin();
      const sine = law.sine();
      const { limit = Infinity, room = 1, sine: before = 1 } = from.worst[k];
      const why =
        margin < NEAR_LIMIT && margin < limit
          ? `${chain.names[joint]} is at its limit.`
          : fast.share > RACE
            ? `${chain.names[fast.joint]} would have to be faster than it can.`
            : Math.hypot(...moved) > RACE * this.calm[k].speed * way ||
                (sine < FLAT * this.calm[k].sine && sine < before)
              ? "The arm comes near a singularity, where its joints would race."
              : leaf < LEAST_MARGIN && leaf < room
                ? "The repeatable control is near a singularity."
                : "";
      chain.place(q);
      const off = Math.hypot(...law.chain.error(next, new Float64Array(chain.m)));
      return {
        q,
        limit: margin,
        room: leaf,
        sine,
        why: why || (off > 0.2 * this.stride + 1e-5 ? "That is out of reach." : ""),
      };
    });
    const why = found.map((one) => one.why).find(Boolean) || "";
    if (!why) Object.assign(from, { qs: found.map(({ q }) => q), worst: found });
    return why;
  }

  // Follow points in small steps, and gather where the hand has been; {why} where it cannot go on.
  walk(from, points, trail = []) {
    for (const goal of points)
      for (;;) {
        const away = goal.map((v, i) => v - from.hand[i]);
        const far = Math.hypot(...away);
        if (far < 1e-9) break;
        const next =
          far < this.stride ? goal : from.hand.map((v, i) => v + (this.stride / far) * away[i]);
        const why = this.step(from, next);
        if (why) return { why, trail };
        from.hand = next;
        trail.push(next);
      }
    return { why: "", trail };
  }

  // Draw both arms where they have been led; the ghost is the last of them.
  draw() {
    const { lead, chain, arms } = this;
    arms.forEach((arm, k) => {
      drawnAt(chain, arm, lead.qs.at(-1), arm.run, 0);
      drawnAt(chain, arm, lead.qs[k], arm.run, 1);
      const { geometry } = lead.shown[k].line;
      const count = Math.min(DOTS, Math.floor(gap(lead.hand, chain.home) / (0.018 * this.extent)));
      for (let i = 0; i < count; i++)
        geometry.attributes.position.setXYZ(
          i,
          ...lead.hand.map((v, c) => v + ((i + 0.5) / count) * (chain.home[c] - v)),
        );
      geometry.setDrawRange(0, count);
      geometry.attributes.position.needsUpdate = true;
    });
    const beyond = this.beyond(lead.trail);
    if (lead.why !== lead.said || beyond !== lead.beyond) {
      Object.assign(lead, { said: lead.why, beyond });
      this.write(
        lead.why ? [[lead.why, "bad"], [" Go another way, or let go."]] : DRAW,
        this.how(beyond),
        "your loop",
      );
    }
    this.player.show();
  }

  // Close the loop: straight home, or along the way it came where that is blocked.
  letGo() {
    const { lead, chain } = this;
    this.catchUp();
    this.put();
    const open = lead.trail;
    const from = () => ({ hand: lead.hand, qs: lead.qs.slice(), worst: lead.worst });
    const way = Math.max(...open.map((p) => Math.hypot(...p.map((v, i) => v - chain.home[i]))));
    if (way < 0.01 * chain.size) {
      this.leave([["That was no loop yet: drag the ring around, and let go."]]);
      return;
    }
    const blocked = this.walk(from(), [chain.home]).why;
    this.follow(
      kept([...open, ...(blocked ? open.slice(0, -1).reverse() : []), chain.home], chain.home),
      1,
      blocked ? "Straight home was blocked; the loop goes back along the way it came." : "",
    );
    this.keepBest();
  }

  // Put the hand down: nothing of the gesture is left.
  put() {
    if (!this.lead) return;
    this.scene.leading = false;
    cancelAnimationFrame(this.waiting);
    Object.assign(this, { lead: null, waiting: 0 });
    document.body.classList.remove("leading");
    for (const ring of this.rings) ring.classList.remove("pulse");
  }

  // ---- the loop

  // Compute the cycles of a closed loop, and show the end of this one of them.
  follow(points, cycle, also = "") {
    const { chain, laws, arms } = this;
    const way = pieces(points, chain.speed, chain.steps);
    const result = computed(laws, arms, way, CYCLES);
    const length = way.reduce((sum, { count, h }) => sum + count * h, 0) * chain.speed;
    const fine = pieces(points, chain.speed, 2 * chain.steps);
    const lost = !result.cycles
      ? "Your loop leads through a singularity, where the hand cannot go on."
      : laws.every((law, k) => law.r || resolved(law, result.motions[k], fine))
        ? ""
        : "The usual control passes close to a singularity on your loop; its drift is not a number.";
    if (lost) {
      this.leave([[lost, "bad"]]);
      return;
    }
    Object.assign(this, {
      points,
      result,
      length,
      also,
      shape: { encloses: enclosing(points) > 0, turns: windings(chain.axis, points) },
      state: "own",
    });
    document.body.classList.add("own");
    byId("own").hidden = false;
    this.player.play({ ...result, seconds: result.slower * (length / chain.speed), path: points });
    this.tell(Math.min(cycle, result.cycles));
    this.clock.seek(this.shown);
  }

  // Say what has happened after a number of cycles.
  tell(cycles) {
    const { chain, arms, result, shape, also } = this;
    const { sentence, notes, part } = answer(chain, arms, result, cycles, shape);
    this.shown = cycles;
    this.scene.part = part;
    pointAt(arms, (s) => Boolean(chain.links[s]) && chain.links[s][1] === part);
    if (result.cycles < CYCLES)
      sentence.push([` In cycle ${result.cycles + 1} an arm comes to a singularity.`, "bad"]);
    notes.push(...this.said());
    this.write(
      sentence,
      also ? [[`${also} `, "near"], ...notes.slice(1)] : notes,
      `your loop, ${inMetres(this.length)} long`,
    );
    byId("again").textContent =
      cycles < result.cycles ? `Do it ${result.cycles} times` : "Once more";
    this.player.show();
  }

  // Whether points are beyond the proved radius around the start.
  beyond(points) {
    const { proved, home } = this.chain;
    return (
      Boolean(proved) && points.some((p) => Math.hypot(...p.map((v, i) => v - home[i])) >= proved)
    );
  }

  // What is said under the sentence while the hand is led.
  how(beyond = false) {
    const { proved } = this.chain;
    if (!proved) return [HOW];
    return [
      HOW,
      beyond
        ? [` You are beyond the proved radius, ${inMetres(proved)}.`, "near"]
        : [
            ` Within the pale disc, ${inMetres(proved)} around the start, every loop of the repeatable arm closes: proved.`,
          ],
    ];
  }

  // What is said of a loop beside its motion: whether it was proved to close, and the best loop so far.
  said() {
    const {
      chain: { proved, size },
      best,
      points,
    } = this;
    const words = [];
    if (proved)
      words.push(
        this.beyond(points)
          ? [` Beyond the proved radius, ${inMetres(proved)}.`]
          : [
              ` The repeatable arm closes every loop within ${inMetres(proved)} of the start: proved.`,
              "good",
            ],
      );
    if (best)
      words.push([
        ` Can you draw one, ${inMetres(LEAST_LENGTH * size)} or longer, that does not make it drift? Your best: ${inMetres(best.off)}.`,
      ]);
    return words;
  }

  // Keep the drawn loop under which the usual control drifts least, of those that are long enough where they enclose something.
  keepBest() {
    const { result, chain, laws, points, best } = this;
    const k = laws.findIndex(({ r }) => !r);
    if (
      this.state !== "own" ||
      k < 0 ||
      result.cycles < CYCLES ||
      enclosing(points) < LEAST_LENGTH * chain.size
    )
      return;
    const off = Math.max(...result.runs[k].ends.at(-1));
    if (!best || off < best.off) this.best = { off, points };
    byId("best").hidden = false;
    byId("best").textContent = `Your best: ${inMetres(this.best.off)}`;
    this.tell(this.shown);
  }

  // From one cycle to all of them, by their ends, when only what drifts is seen to move; and again.
  repeat() {
    if (this.shown < this.result.cycles) this.clock.seek(this.shown);
    else this.clock.seek(0);
    const done = () => this.tell(this.result.cycles);
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.clock.seek(this.result.cycles);
      done();
    } else this.clock.finish(done);
  }

  // Back to the study, with something to say or with its own sentence.
  leave(words) {
    this.put();
    for (const law of this.laws) law.start = Float64Array.from(this.chain.start);
    Object.assign(this, { state: "study", points: null });
    document.body.classList.remove("own");
    byId("own").hidden = true;
    for (const [node, children] of this.texts) node.replaceChildren(...children);
    if (words) this.write(words, null, null);
    this.player.study();
  }

  // A loop of this kind through the hand, in the plane that faces the camera: the largest that the arms can follow.
  preset(kind) {
    if (this.lead) this.leave();
    this.take(0, null);
    const [right, up] = this.axes();
    const home = new MeshCat.THREE.Vector3(...this.chain.home);
    const start = { hand: this.lead.hand, qs: this.lead.qs, worst: this.lead.worst };
    for (let size = 0.16 * this.chain.size; size > 0.004 * this.chain.size; size *= 0.8)
      for (let turn = 0; turn < 8; turn++) {
        const angle = (turn * Math.PI) / 4;
        const c = Math.cos(angle);
        const s = Math.sin(angle);
        const points = FORMS[kind].map(([x, y]) =>
          home
            .clone()
            .addScaledVector(right, size * (c * x - s * y))
            .addScaledVector(up, size * (s * x + c * y))
            .toArray(),
        );
        if (this.walk({ ...start }, [...points, this.chain.home]).why) continue;
        this.put();
        this.follow(kept([this.chain.home, ...points, this.chain.home], this.chain.home), 1);
        return;
      }
    this.leave([["There is no room for such a loop here.", "bad"]]);
  }

  // The loop that the address asks for, after all its cycles; it may begin where the hand is not.
  open(points) {
    const { chain, laws } = this;
    const first =
      Math.hypot(...points[0].map((v, i) => v - chain.home[i])) < 1e-3 ? chain.home : points[0];
    if (first !== chain.home) {
      const from = {
        hand: chain.home,
        qs: laws.map(() => laws.at(-1).start),
        worst: laws.map(() => ({})),
      };
      const { why } = this.walk(from, [first]);
      if (why) {
        this.leave([[`The loop in the address cannot be reached. ${why}`, "bad"]]);
        return;
      }
      for (const law of laws) law.start = from.qs.at(-1);
    }
    this.follow(closed(points, first), CYCLES);
  }

  csv() {
    return (
      ["x,y,z", ...this.points.map((p) => p.map((v) => Number(v.toFixed(9))).join(","))].join(
        "\n",
      ) + "\n"
    );
  }

  // ---- what is written and where

  write(sentence, notes, title) {
    const parts = (words) =>
      words.map(([text, kind]) =>
        kind === undefined ? text : element("b", { class: kind }, text),
      );
    byId("verdict").replaceChildren(...parts(sentence));
    if (notes)
      byId("notes").replaceChildren(
        ...notes.map(([text, kind]) => element("span", { class: kind || "" }, text)),
      );
    if (title) byId("title").textContent = `${this.scene.title.split(":")[0]}: ${title}`;
  }

  // Give sentence and notes the room of their longest words, so that nothing moves when they change.
  reserve() {
    const [ring] = this.rings;
    ring.classList.remove("under"); // there the words are shorter
    this.wide = ring.firstChild.offsetWidth
      ? ring.offsetWidth / 2 + 4 + ring.firstChild.offsetWidth
      : this.wide;
    const long =
      "After 10 cycles of your loop the hand is back. The shoulder is not: 0.88 m off under the usual control, 0 under the repeatable one.";
    const more = `The repeatable one takes 0.8 % more joint speed (rms). Joint limits kept. Leaf margin 0.88 or more (1 is best, 0 singular). Collisions are not checked. ${this.chain.proved ? "The repeatable arm closes every loop within 1.1 cm of the start: proved. " : ""}Can you draw one, 25 cm or longer, that does not make it drift? Your best: 0.88 mm.`;
    for (const [id, text] of [
      ["verdict", long],
      ["notes", more],
    ]) {
      const node = byId(id);
      node.style.minHeight = "";
      if (document.body.classList.contains("inside") || !node.clientWidth) continue; // no words, or folded
      const sample = element(
        node.tagName,
        { id, style: "position: absolute; visibility: hidden; left: 0; top: 0" },
        text,
      );
      sample.style.width = `${node.clientWidth}px`;
      node.after(sample);
      const tall = Math.max(
        sample.offsetHeight,
        ...this.texts
          .filter(([one]) => one === node)
          .map(([, children]) => {
            const now = [...node.childNodes];
            node.replaceChildren(...children);
            const height = node.offsetHeight;
            node.replaceChildren(...now);
            return height;
          }),
      );
      sample.remove();
      node.style.minHeight = `${tall}px`;
    }
  }

  // Put the rings where the hand is; they are not there while it goes round without them.
  place() {
    const { arms, panes, clock, lead, chain } = this;
    const home = this.state === "own" ? this.points[0] : chain.home;
    const T = MeshCat.THREE;
    const hand = new T.Vector3(...(lead ? lead.hand : home));
    const part = clock.time % 1;
    this.rings.forEach((ring, k) => {
      const { x, y } = panes.seen(k, hand);
      const { width } = panes.place(k);
      const away =
        !lead &&
        part > 0 &&
        arms[k].point("tip", 0, arms[k].now.frame, arms[k].now.f).distanceTo(hand) >
          0.02 * this.extent;
      ring.style.transform = `translate(calc(${x}px - 50%), calc(${y}px - 50%))`;
      ring.classList.toggle("away", away && clock.playing);
      const { wide } = this;
      const left = x + wide > width;
      ring.classList.toggle("left", left && x > wide);
      ring.classList.toggle("under", left && x <= wide);
    });
  }
}

// The largest joint speed of a control for a hand that moves by 1 m/s along an axis, at q.
function quickest(law, q) {
  const { n, m } = law.chain;
  const axes = Math.min(m, law.chain.rows.length, 3);
  return Math.max(
    ...Array.from({ length: axes }, (_, k) => {
      law.solve(
        q,
        Array.from({ length: m }, (__, i) => Number(i === k)),
      );
      return Math.hypot(...law.x.subarray(0, n));
    }),
  );
}

// ---- shapes of loops, in a plane, from the hand on

const round = (f) =>
  Array.from({ length: POINTS - 1 }, (_, i) => f((2 * Math.PI * (i + 1)) / POINTS));
const FORMS = {
  circle: round((a) => [1 - Math.cos(a), Math.sin(a)]),
  eight: round((a) => [Math.sin(a), Math.sin(2 * a) / 2]),
  square: [
    [0, 1.6],
    [1.6, 1.6],
    [1.6, 0],
  ],
};

// A closed loop of at most POINTS points, to a tenth of a millimetre, that begins and ends at home.
function kept(points, home) {
  let few = points;
  for (let most = 5e-4; few.length > POINTS || most === 5e-4; most *= 1.3)
    few = simpler(points, most);
  return closed(few, home);
}

function closed(points, first) {
  const inside = points.slice(1).map((p) => p.map((v) => Number(v.toFixed(4))));
  const last = inside.at(-1);
  if (Math.hypot(...last.map((v, i) => v - first[i])) < 1e-3) inside.pop();
  return [Array.from(first), ...inside, Array.from(first)];
}

// Douglas and Peucker: leave out points that are this near to the line without them.
function simpler(points, most) {
  const [a, b] = [points[0], points.at(-1)];
  const d = b.map((v, i) => v - a[i]);
  const size = d.reduce((sum, v) => sum + v * v, 0);
  let worst = 0;
  let at = 0;
  points.forEach((p, k) => {
    const w = p.map((v, i) => v - a[i]);
    const t =
      size > 0 ? Math.min(1, Math.max(0, w.reduce((sum, v, i) => sum + v * d[i], 0) / size)) : 0;
    const off = Math.hypot(...w.map((v, i) => v - t * d[i]));
    if (off > worst) {
      worst = off;
      at = k;
    }
  });
  return worst > most
    ? [...simpler(points.slice(0, at + 1), most).slice(0, -1), ...simpler(points.slice(at), most)]
    : [a, b];
}

// The length of a loop without the ways that it goes there and back, m: 0 where it encloses nothing.
function enclosing(points) {
  const sizes = points.slice(1).map((p, i) => gap(p, points[i]));
  const step = sizes.reduce((sum, v) => sum + v, 0) / 80;
  const way = [points[0]];
  let left = step;
  points.slice(1).forEach((p, i) => {
    for (; left <= sizes[i] + 1e-12; left += step) {
      const at = points[i].map((v, k) => v + (left / sizes[i]) * (p[k] - v));
      if (way.length > 1 && gap(at, way.at(-2)) < 1.5 * step) way.pop();
      else if (gap(at, way.at(-1)) > 0.5 * step) way.push(at);
    }
    left -= sizes[i];
  });
  return way.length > 4 ? (way.length - 1) * step : 0;
}

const gap = (p, q) => Math.hypot(...p.map((v, i) => v - q[i]));

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

// How often a loop goes round the axis of the first joint.
function windings(about, points) {
  if (!about) return 0;
  const T = MeshCat.THREE;
  const axis = new T.Vector3(...about.axis);
  const flat = points.map((p) =>
    new T.Vector3(...p).sub(new T.Vector3(...about.origin)).projectOnPlane(axis),
  );
  const angles = flat
    .slice(1)
    .map((p, i) => Math.atan2(new T.Vector3().crossVectors(flat[i], p).dot(axis), flat[i].dot(p)));
  return Math.round(angles.reduce((sum, v) => sum + v, 0) / (2 * Math.PI));
}
