// The report of a loop: the sentence, the notes and the title that say what its motion has shown;
// and the best loop so far, under which the usual arm drifts least.

import { pointAt } from "../arm/arm.js";
import { byId } from "../dom.js";
import { formatLength } from "../numbers.js";
import { enclosing, lengthOf, normalOf, planeWords } from "./loops.js";
import { isFarBeyond, proofClause, proofNote } from "./proof.js";
import {
  answer,
  CHECKED,
  edgeWords,
  failureWords,
  lineFlaws,
  lineWords,
  railNotes,
} from "./sentence.js";

export const CYCLES = 10;
const LEAST_LENGTH = 0.25; // of the arm, from which a loop counts for the best

export class Report {
  // `parts`: {arms, chain, elbow, head, loops, piece, player, scene, steps}. Later also what the
  // arms do, as computed() gives it: {result}; {length} of the path, m; its {shape}, see answer();
  // and where a drawn loop cannot be followed, {failure}, or null
  constructor(parts) {
    Object.assign(this, parts, { best: null });
  }

  // Say what has happened after a number of cycles.
  say(cycles) {
    const { arms, chain, elbow, failure, loops, result, scene, shape } = this;
    const { sentence, notes, part } = answer(chain, arms, result, cycles, shape);
    this.shown = cycles;
    elbow.before = null;
    scene.part = part;
    pointAt(arms, chain.isOf(part));
    notes.push(...this.notes(cycles));
    const clause = this.isProvable() && proofClause(chain, loops.points);
    const far = elbow.off();
    const moved = far > 1e-4 ? `, ${elbow.part} moved by ${formatLength(far)}` : "";
    const path = loops.points ? `${shape.whose}${this.sizeWords()}` : "the study’s path";
    if (failure) {
      // limits that the solid line breaks stay red, what else it does is a note
      const [red, plain] = [true, false].map((bad) =>
        sentence.filter(([, kind]) => (kind === "bad") === bad).map(([text]) => text),
      );
      if (shape.encloses) notes.unshift([plain.join("").trimStart()]);
      notes.unshift(...red.map((text) => [`${text} `, "bad"]));
      // its ball is not drawn: the one that is seen is where the loop stops
      for (const note of notes)
        note[0] = note[0]
          .replaceAll(", at the red ball", "")
          .replace("the red ball on", "there on");
      const atEdge = scene.cover && failure.reasons.at(-1);
      const words = atEdge ? edgeWords(failure) : failureWords(chain, arms, failure);
      const flaws = lineFlaws(result.runs, cycles);
      sentence.splice(0, Infinity, ...words, ...lineWords(this.length, shape, atEdge, flaws));
    }
    sentence.push([CHECKED, "aside"]);
    if (clause && !failure && !this.isBroken()) sentence.push([clause, "aside proof"]);
    this.head.write(sentence, notes, path + moved);
    byId("again").textContent =
      cycles < result.cycles ? `Do it ${result.cycles} times` : "Once more";
    this.player.show();
  }

  // The length of a loop that was drawn, and its plane; of several, the length of each.
  sizeWords() {
    const { chain, loops, piece } = this;
    const several = loops.keeping().length > 0;
    const each = chain.frames.flatMap(({ hand }, f) => {
      const loop = loops.of(f);
      if (!loop) return [];
      const long = `${several ? `${hand} ` : ""}${formatLength(lengthOf(loop))} long`;
      return [several ? long : `${long}, ${planeWords(piece.direction(normalOf(loop)))}`];
    });
    return `, ${each.join(", ")}`;
  }

  // What is said of a loop beside its motion: whether it was proved to close; and after all cycles,
  // how far the usual arm has drifted, and after those of the best loop.
  notes(cycles) {
    const { best, chain, loops, result } = this;
    const { points } = loops;
    const words = railNotes(chain, result.motions);
    if (this.isProvable()) words.push(proofNote(chain, points, this.isBroken()));
    if (best && points && cycles === result.cycles) {
      const long = formatLength(LEAST_LENGTH * chain.size);
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

  // Whether a proof speaks of this loop, which is not far larger than it; whether the loop breaks a
  // limit.
  isProvable() {
    const { chain, elbow, loops } = this;
    const { points } = loops;
    if (!chain.proved || !points || elbow.at || loops.keeping().length) return false;
    return !isFarBeyond(chain, points);
  }
  isBroken() {
    return this.result.runs.some(({ data }) => data.broken);
  }

  // How far the usual arm is from its start after all cycles, m; null if it has not completed them.
  usualOff() {
    const { result, steps } = this;
    const usual = result.runs[steps.laws.findIndex(({ r }) => !r)];
    const complete = usual && result.cycles === CYCLES && usual.data.lost === Infinity;
    return complete ? Math.max(...usual.ends.at(-1)) : null;
  }

  // Keep the drawn loop under which the usual control drifts least, of those that are long enough
  // where they enclose something, and on which all controls keep the limits.
  keepBest() {
    const { best, chain, elbow, loops } = this;
    const { points, mirrored } = loops;
    if (!points || loops.missed.length || loops.keeping().length) return;
    const off = this.usualOff();
    if (off === null || this.isBroken() || enclosing(points) < LEAST_LENGTH * chain.size) return;
    const { at, level } = elbow;
    if (!best || off < best.off)
      this.best = { off, points, hand: chain.led, mirrored, elbow: at, level };
    byId("best").hidden = false;
    const least = formatLength(this.best.off);
    byId("best").textContent =
      `Your best loop: ${least} under the usual control after ${CYCLES} cycles`;
    this.say(this.shown);
  }
}
