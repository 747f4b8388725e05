// What is proved of loops near the start of the study, in words.

import { formatLength } from "../numbers.js";
import { gap } from "./loops.js";

// Whether points of the hand that is led are beyond the proved radius around its start.
export function isBeyond({ proved, homes, led }, points) {
  return Boolean(proved) && points.some((p) => gap(p, homes[led]) >= proved);
}

// What is said while the hand is led.
export function proofHint({ proved }, beyond) {
  const far = formatLength(proved);
  return beyond
    ? [` You are more than ${far} from the start: there, closing is not proved.`, "near"]
    : [` Within the pale disc, ${far} around the start, the repeatable arm closes: proved.`];
}

// The same in few words.
export function proofClause(chain, points) {
  const beyond = isBeyond(chain, points);
  return beyond
    ? ` Closing is proved within ${formatLength(chain.proved)}.`
    : " Closing is proved.";
}

// What is said of a loop; `broken`: it does not keep all limits.
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
