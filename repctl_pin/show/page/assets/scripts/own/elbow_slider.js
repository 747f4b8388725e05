// The elbow's slider: it moves the arms with the hands at rest, along the self-motion that changes
// one level of the repeatable control; a loop is followed from where it stands.

import { pointAt } from "../arm/arm.js";
import { byId, element } from "../dom.js";
import { formatLength } from "../numbers.js";
import { bodiesOff } from "./run.js";
import { selfMotion } from "./self_motion.js";
import { shortName } from "./sentence.js";

const DRIVEN = 0.5; // of what moves most along the slider, from which a part gives it its name
const TRIED = 6; // levels, of which the slider takes the one that moves most what drifts most
const LET_GO =
  "Let go: both arms follow the path from here, and the repeatable one comes back here.";

export class ElbowSlider {
  // `parts`: {arms, chain, head, laws, ledArms, player, scene, steps}, and {stop(), settle()}: end
  // what is computed, and follow the loop from where the slider stands
  constructor(parts) {
    Object.assign(this, parts);
    this.free = this.laws.find(({ r }) => r);
    this.fixed = !this.free || this.scene.cover;
    this.first = 0; // the level that the slider changes at first
    this.level = 0;
    this.at = 0; // its place, from the start of the study on
    this.drifting = this.scene.part; // of the study
    this.before = null; // what was pointed at before the slider's part
    if (this.fixed) return;
    this.choose();
    this.listen();
    this.stand(0, this.first);
    byId("elbow-box").hidden = this.selves.qs.length < 4;
  }

  // Offer all levels, and take the one that moves most what drifts most in the study.
  choose() {
    const { r } = this.free;
    const menu = byId("level");
    const reached = Array.from({ length: r }, (_, k) => {
      const words = `motion ${k + 1} of ${r}`;
      const option = element("option", { value: k }, words);
      menu.append(option);
      if (k >= TRIED) return 0;
      this.stand(0, k);
      option.textContent = `${this.part}: ${words}`;
      return this.reached(this.drifting);
    });
    this.first = reached.indexOf(Math.max(...reached));
    menu.parentElement.hidden = r < 2;
  }

  listen() {
    const input = byId("elbow");
    byId("level").addEventListener("change", ({ target }) => {
      this.stand(0, Number(target.value));
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
  }

  // Begin from place i of the slider, along level k: all controls, and what is drawn next.
  stand(i, k = this.level) {
    const { chain, laws } = this;
    this.stop();
    this.before = null;
    if (this.fixed) {
      this.at = 0;
      for (const law of laws) law.stand(chain.start);
      return;
    }
    if (k !== this.level || !this.selves) {
      for (const law of laws) law.stand(chain.start);
      this.level = k;
      const allowed = (law, q) => this.steps.allows(law, q);
      this.selves = selfMotion(this.free, chain.start, k, allowed);
      const { qs, zero } = this.selves;
      Object.assign(byId("elbow"), { min: -zero, max: qs.length - 1 - zero });
      this.nameSlider();
    }
    const { qs, zero } = this.selves;
    this.at = Math.min(Math.max(i, -zero), qs.length - 1 - zero);
    for (const law of laws) law.stand(qs[zero + this.at]);
    byId("elbow").value = this.at;
    byId("level").value = this.level;
    const off = formatLength(this.off());
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

  // How far the slider's part is from where the study starts, at its farthest point, m.
  off() {
    const { chain, arms, laws, part } = this;
    return Math.max(0, ...bodiesOff(chain, arms[0], laws[0].start, part));
  }

  // The level of the slider in an address without one: the first if the slider is moved.
  unnamed(place) {
    return place ? 0 : this.first;
  }

  // Outline and name the part that the slider moves, before it is moved.
  pointAhead() {
    const { arms, scene } = this;
    if (this.ledArms.lead || this.before) return;
    this.before = { part: scene.part, places: arms.map(({ part, spot }) => ({ part, spot })) };
    this.pointHere();
    this.player.show();
  }

  pointHere() {
    this.scene.part = this.part;
    pointAt(this.arms, this.chain.isOf(this.part));
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

  // Show both arms at a place of the slider, with the hands at rest; the ghost stays at the start.
  slide(i) {
    const { chain, head, laws, ledArms } = this;
    if (!ledArms.lead || !ledArms.lead.slides) {
      ledArms.end();
      // first, the place of the part that moves most on the way to the slider's end
      const qs = laws.map(() => this.selves.qs.at(i < 0 ? 0 : -1));
      ledArms.begin({ slides: true, hands: chain.homes, ghost: chain.start, qs }, []);
      ledArms.draw();
      this.pointHere();
    }
    this.stand(i);
    ledArms.lead.qs = laws.map((law) => law.start);
    ledArms.draw();
    const { frames } = chain;
    const rest = frames.length > 1 ? "The hands stay" : "The hand stays";
    const where = frames[0].base ? "at its place on the workpiece" : "at rest";
    const text = `${rest} ${where} while the arm moves: this is what redundancy is.`;
    // words that stay are not written again: a page lays out what was written
    if (byId("verdict").textContent !== text)
      head.write([[text]], [[LET_GO]], `${this.part} moved`);
    this.player.show();
  }
}
