// What is proved of loops near the start of the study, in words.

import { formatLength } from "../numbers.js";
import { gap } from "./loops.js";

const FAR_BEYOND = 4; // proved radii, beyond which nothing of a proof stands beside a loop

// Whether points of the hand that is led are beyond this number of proved radii around its start.
export function isBeyond({ proved, homes, led }, points, radii = 1) {
  return Boolean(proved) && points.some((p) => gap(p, homes[led]) >= radii * proved);
}
export const isFarBeyond = (chain, points) => isBeyond(chain, points, FAR_BEYOND);

// What is said while the hand is led.
export function proofHint({ proved }, beyond) {
  const far = formatLength(proved);
  return beyond
    ? [
        ` Beyond ${far} from the start, the repeatable arm’s return is computed, not proved.`,
        "near",
      ]
    : [` Within the pale disc, ${far} around the start, the repeatable arm’s return is proved.`];
}

// What is said of a loop in few words: all that can be said of one that is proved.
export const PROVED = " The repeatable arm’s return is proved.";
export function proofClause(chain, points) {
  const far = formatLength(chain.proved);
  return isBeyond(chain, points)
    ? ` The repeatable arm’s return is proved within ${far} of the start; this loop goes farther.`
    : PROVED;
}

// The same as a note; `broken`: it does not keep all limits.
export function proofNote(chain, points, broken) {
  const far = formatLength(chain.proved);
  const aside = broken ? " The proof does not consider limits." : "";
  return isBeyond(chain, points)
    ? [
        ` Proved: after every loop that stays within ${far} of the start, the repeatable ` +
          `arm is back exactly.${aside} This loop goes farther, so it was computed, step ` +
          "by step.",
      ]
    : [` Proved: after this loop, the repeatable arm is back exactly.${aside}`, "good"];
}
