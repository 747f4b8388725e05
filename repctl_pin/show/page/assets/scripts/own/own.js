// The visitor's own loop: take a hand at its ring, draw, let go; both arms follow, and the page
// says what has happened. And the slider of the elbow, from where they then start. Here are the
// state and what happens when; each part has a file of its own.

import { Chain } from "../arm/kinematics.js";
import { Law } from "../arm/law.js";
import { openNotes } from "../chrome/controls.js";
import { Head } from "../chrome/head.js";
import { download } from "../chrome/save.js";
import { byId } from "../dom.js";
import { loopCsv } from "./csv.js";
import { ElbowSlider } from "./elbow_slider.js";
import { Gesture } from "./gesture.js";
import { HandLoops } from "./hand_loops.js";
import { LedArms } from "./led_arms.js";
import { linkParts } from "./link.js";
import { closed, enclosing, FORMS, gap, lengthOf, windings } from "./loops.js";
import { largestLoop } from "./presets.js";
import { CYCLES, Report } from "./report.js";
import { Rings } from "./rings.js";
import { PROVED } from "./proof.js";
import { computed } from "./run.js";
import { CHECKED, stated } from "./sentence.js";
import { Steps } from "./steps.js";
import { failedStrokes } from "./strokes.js";
import { Workpiece } from "./workpiece.js";

const SLICE = 25; // ms of computing between two pictures, once the hand is let go
// The longest sentence of a gesture, and the notes of a loop on which joints keep their limits.
const LEAD_WORDS = {
  verdict: ["That joint would have to be faster than it can. Go another way, or let go."],
  notes: [
    "Average joint speed on this path: 0.7 % higher under the repeatable one than under the " +
      "usual control in cycle 1.",
    "Joint limits are kept.",
    "The repeatable control stays far from where it alone fails: 0.82 (1 is best, 0 fails).",
  ],
};

export class Own {
  // `player`: {play(result), study(), plain(), clear(), show()}, which shows a result of
  // computed() after play's pauses, or the study again; `paths`: those of the study, as drawn
  constructor(data, { arms, panes, scene, clock, extent, player, paths }) {
    const chain = new Chain(data);
    const laws = data.laws.map((parts) => new Law(chain, parts));
    const piece = new Workpiece(chain.frames[0], arms, panes);
    const studied = data.path && data.path.map((k) => k !== null && piece.points(paths[k]));
    const loops = new HandLoops(chain, studied);
    const steps = new Steps(chain, laws, loops, scene.cover);
    const head = new Head(
      scene.title.split(":")[0],
      LEAD_WORDS,
      CHECKED,
      chain.proved ? PROVED : "",
    );
    const ledArms = new LedArms({
      ...{ arms, chain, clock, player, scene },
      begun: () => {
        this.state = "leading";
      },
      ended: () => this.rings.pulse(false),
    });
    const elbow = new ElbowSlider({
      ...{ arms, chain, head, laws, ledArms, player, scene, steps },
      stop: () => {
        this.work = null;
      },
      settle: () => this.settle(),
    });
    const gesture = new Gesture({
      ...{ arms, chain, elbow, extent, head, ledArms, loops, panes, piece, player, scene, steps },
      release: () => this.release(),
      leave: () => this.leave(),
      isBusy: () => Boolean(this.work),
    });
    Object.assign(this, {
      ...{ arms, chain, clock, elbow, gesture, head, laws, ledArms, loops, piece, player, scene },
      steps,
      rings: new Rings({ arms, chain, clock, extent, gesture, loops, panes, piece }),
      report: new Report({ arms, chain, elbow, head, loops, piece, player, scene, steps }),
      state: "study", // or "leading", or "own" while a loop is shown
      work: null, // what is computed in slices
    });
    this.rings.know(loops.studied);
    this.listen();
  }

  // How a hand or the slider leads both arms now; null without.
  get lead() {
    return this.ledArms.lead;
  }

  listen() {
    const { chain, loops } = this;
    window.addEventListener("pointermove", (event) => this.gesture.move(event));
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
      this.head.fold();
    });
    pressed("back", () => this.leave());
    pressed("loop-csv", () =>
      download(new Blob([loopCsv(loops)], { type: "text/csv" }), "loop.csv"),
    );
    pressed("copy", ({ currentTarget }) => {
      const done = () => {
        currentTarget.textContent = "Copied";
      };
      navigator.clipboard.writeText(location.href).then(done, () => {});
    });
    pressed("best", () => {
      byId("loops").open = false;
      this.open(this.report.best);
    });
    for (const button of byId("loops").querySelectorAll("[data-loop]"))
      button.addEventListener("click", () => {
        byId("loops").open = false;
        this.preset(button.dataset.loop);
      });
    byId("mirror").parentElement.hidden = chain.frames.length < 2;
    byId("mirror").addEventListener("change", ({ target }) => {
      loops.mirrored = target.checked;
      if (loops.points) this.follow();
    });
    byId("loops").hidden = false;
    this.clock.invite = () => {
      if (this.state === "study") this.rings.pulse(true);
    };
  }

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
      if (this.lead) this.head.write([["Computing what both arms do …"]], null, null);
      await new Promise((resolve) => {
        setTimeout(resolve);
      });
    }
    work.return();
  }

  // Close the loop that is drawn, and follow it; after a press that drew none, the loops of before.
  release() {
    return this.run(this.closing());
  }

  *closing() {
    const drawn = yield* this.gesture.close();
    if (drawn) {
      yield* this.following(drawn.points, 1, drawn.missed);
      this.report.keepBest();
      return;
    }
    const earlier = this.loops.restore();
    if (earlier) yield* this.following(earlier.points, this.report.shown, earlier.missed);
    else this.leave([["That was no loop yet: drag the ring around, and let go."]]);
  }

  // Follow the loop, or the study's path, from where the slider stands.
  settle() {
    const { elbow, loops } = this;
    if (loops.points) return this.follow();
    if (!elbow.at && elbow.level === elbow.first) return this.leave();
    return loops.studied ? this.follow() : this.preset("circle");
  }

  // Follow the loop once more, or the study's path without one.
  follow() {
    const { points, missed } = this.loops;
    return this.run(this.following(points, 1, points ? missed : []));
  }

  // Compute the cycles of a closed loop, or of the study's path without points, and show the end of
  // this one of them. An arm that comes close to a singularity goes as far as it can. `missed`:
  // the strokes of the loop that was drawn that this one leaves out.
  *following(points, cycle, missed = []) {
    const { chain, clock, loops, piece, report, scene } = this;
    Object.assign(loops, { points, missed });
    const paths = loops.paths();
    this.rings.know(paths);
    const failed = yield* failedStrokes(this.steps, points, missed);
    const [failure] = [...failed.values(), null];
    const yours = loops.keeping().length ? "your loops" : "your loop";
    const shape = {
      encloses: paths.some((path) => path && enclosing(path) > 0),
      turns: points ? windings(chain.axis, points) : 0,
      whose: failure ? "the solid line" : points ? yours : "the path",
    };
    // a way there and back in place of a loop is seen once
    const idle = Boolean(failure) && !shape.encloses;
    const result = yield* computed(this.laws, this.arms, paths, idle ? 1 : CYCLES);
    yield;
    this.ledArms.end();
    const strokes = piece.lines([...failed.keys()]);
    yield* this.player.play({ ...result, paths: piece.lines(paths), strokes });
    yield;
    Object.assign(scene, { failure: failure && failure.reasons, idle });
    const length = points ? lengthOf(points) : result.length;
    Object.assign(report, { result, length, failure, shape });
    this.state = "own";
    clock.whole = !idle && result.runs.some(({ data }) => data.lost >= 1);
    document.body.classList.add("own");
    byId("own").hidden = false;
    byId("again").hidden = idle || result.cycles < 2;
    byId("lines").hidden = !failure;
    byId("loop-csv").hidden = !points || Boolean(scene.cover);
    yield;
    report.say(Math.min(cycle, result.cycles));
    // of a way there and back, its far end
    clock.seek(idle ? failure.after / length : report.shown);
  }

  // From one cycle to all of them, by their ends, when only what drifts is seen to move; and again.
  repeat() {
    const { clock, report } = this;
    const { cycles } = report.result;
    clock.seek(report.shown < cycles ? report.shown : 0);
    const done = () => report.say(cycles);
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      clock.seek(cycles);
      done();
    } else clock.finish(done);
  }

  // Back to the study, with something to say or with its own sentence.
  leave(words) {
    this.ledArms.end();
    this.elbow.stand(0, this.elbow.first);
    this.loops.clear();
    this.rings.know(this.loops.studied);
    this.state = "study";
    Object.assign(this.scene, { failure: null, idle: false });
    this.clock.whole = true;
    document.body.classList.remove("own", "unfolded");
    for (const id of ["own", "lines"]) byId(id).hidden = true;
    this.head.restore();
    if (words) this.head.write(words, null, null);
    else this.head.fold();
    this.player.study();
  }

  // A loop of this kind through the hand, in the plane that faces the camera.
  preset(kind) {
    this.ledArms.end();
    this.gesture.grab(0, null, null, this.chain.led);
    return this.run(this.presetting(FORMS[kind]));
  }

  *presetting(form) {
    const points = yield* largestLoop(form, this.steps, this.gesture.axes());
    if (points) yield* this.following(points, 1);
    else this.leave([["There is no room for such a loop here.", "bad"]]);
  }

  // The loop that an address asks for, at a time in cycles or after all of them; it may begin where
  // the hand is not.
  open(asked, time = CYCLES) {
    const {
      points,
      missed = [],
      hand = 0,
      others = [],
      mirrored = false,
      elbow = 0,
      level,
    } = asked;
    const { chain, loops } = this;
    this.ledArms.end();
    chain.led = Math.min(hand, chain.frames.length - 1);
    loops.others = chain.homes.map((home, f) => others[f] && closed(others[f], home));
    loops.mirrored = mirrored && chain.frames.length > 1;
    byId("mirror").checked = loops.mirrored;
    this.elbow.stand(elbow, level ?? this.elbow.unnamed(elbow));
    return points ? this.run(this.opening(points, missed, time)) : this.settle();
  }

  *opening(points, missed, time) {
    const { chain, laws, steps } = this;
    const home = chain.homes[chain.led];
    const first = gap(points[0], home) < 1e-3 ? home : points[0];
    if (first !== home) {
      const from = { ...steps.from(home), qs: laws.map(() => laws.at(-1).start) };
      const { refusal } = yield* steps.walk(from, [first], true);
      if (refusal) {
        this.leave([[`The loop in the address cannot be reached. ${stated(refusal)}`, "bad"]]);
        return;
      }
      for (const law of laws) law.start = from.qs.at(-1);
    }
    const strokes = missed.map((stroke) => stroke.map((place) => steps.limited(place)));
    yield* this.following(closed(points, first), Math.max(Math.floor(time), 1), strokes);
  }

  // What the address keeps of all this.
  addressParts() {
    return this.state === "own" ? linkParts(this.loops, this.elbow) : [];
  }

  // Give the head and the words at the rings the room that they need at this size of the window.
  reserve() {
    this.rings.measure();
    this.head.reserve();
  }
}
