// What is said of a visitor's loop: as show/text/headline.py says it of a study.

import { inMetres, inWords } from "../numbers.js";

const SMALL = 0.01; // m, below which a part has hardly drifted
const BACK = 1e-4; // m, below which it is back
const TURNED = 0.1; // rad, from which a joint is named although no part is off

// {sentence, notes, part} after a number of cycles, in pieces [words, tone]; whether the loop encloses anything, and how often it
// turns around the first joint.
export function answer(chain, arms, result, cycles, { encloses, turns }) {
  const { runs } = result;
  const k = cycles - 1;
  const times = cycles === 1 ? "one cycle" : `${cycles} cycles`;
  const worst = runs.map(({ ends }, i) => mostOff(chain, arms[i], ends[k]));
  const most = worst.reduce((a, b) => (b.off > a.off ? b : a));
  const joints = runs.map(({ turned }) => Math.max(...turned[k]));
  const joint =
    chain.names[
      runs
        .flatMap(({ turned }) => [turned[k]])
        .reduce((a, b) => (Math.max(...b) > Math.max(...a) ? b : a))
        .reduce((b, v, i, all) => (v > all[b] ? i : b), 0)
    ];
  const under = (i) => (runs.length > 1 ? ` under ${arms[i].data.under}` : "");
  const listed = (say) => runs.flatMap((run, i) => [[i ? ", " : ""], say(i), [under(i)]]);
  const back = worst.every(({ off }, i) => off < BACK && joints[i] < TURNED);
  const said = [];
  if (turns && !back)
    said.push([
      `Your loop winds around the axis of ${chain.axis.name}, so it need not close under any control. `,
    ]);
  const lost = runs.flatMap(({ hand }, i) =>
    hand[k] > 1e-3 * chain.size
      ? [
          [`Under ${arms[i].data.under} the hand is not back after ${times} of your loop: `],
          [`${inMetres(hand[k])} off`, "bad"],
          [". "],
        ]
      : [],
  );
  said.push(...(lost.length ? lost : [[`After ${times} of your loop the hand is back. `]]));
  const name = !/\d/.test(most.part)
    ? `the ${most.part}`
    : most.part.startsWith("arm ")
      ? most.part
      : `${most.part} of the arm`;
  const value = (i, unit) => {
    const { off, part } = worst[i];
    const zero = off < BACK;
    return [
      `${inMetres(off)}${zero && i ? "" : unit}${zero || part === most.part ? "" : ` (${part})`}`.replaceAll(
        " ",
        "\u00a0",
      ),
      toneOf(off),
    ];
  };
  if (back && !encloses)
    said.push(
      ["A way there and back encloses nothing: "],
      ["0", "good"],
      [runs.length === 2 ? " off under both." : " off."],
    );
  else if (back) said.push(["So is every part of the arm: "], ["0", "good"], [" off."]);
  else if (most.off >= SMALL)
    said.push([`${capital(name)} is not: `], ...listed((i) => value(i, " off")), ["."]);
  else if (Math.max(...joints) >= TURNED)
    said.push(
      [`The joint ${joint} is not: `],
      ...listed((i) => [
        joints[i] < 1e-5 ? "0" : `${inWords(Number(joints[i].toPrecision(2)))}\u00a0rad`,
        joints[i] >= TURNED ? "bad" : "good",
      ]),
      ["."],
    );
  else said.push([`${capital(name)} has hardly drifted: `], ...listed((i) => value(i, "")), ["."]);
  said.push(...othersOf(chain, arms, runs, k));
  return { sentence: said, notes: notesOf(arms, runs, cycles), part: most.part };
}

// Which ends of other branches are not back, hands first.
function othersOf({ ends }, arms, runs, k) {
  const most = (i) => Math.max(...runs.map(({ others }) => others[k][i]));
  const last = ({ name }) => Number(name !== "other hand");
  const away = ends
    .map((end, i) => ({ ...end, off: most(i) }))
    .filter(({ off }) => off >= SMALL)
    .sort((a, b) => last(a) - last(b) || b.off - a.off);
  if (!away.length) return [];
  const moved = arms.filter((_, j) => Math.max(...runs[j].others[k]) >= SMALL);
  const one = moved.length === 1 && runs.length > 1;
  return [
    [one ? ` Under ${moved[0].data.under} ` : " "],
    ...away.flatMap(({ name, link, off }, i) => [
      [
        `${i ? ", " : ""}${one || i ? "the" : "The"} ${name !== "other end" && away.filter((end) => end.name === name).length === 1 ? name : `${name} ${link}`} ${i ? "" : "is "}${moved.length > 1 ? "up to " : ""}`,
      ],
      [`${inMetres(off)}${i ? "" : " off"}`.replaceAll(" ", "\u00a0"), "bad"],
    ]),
    ["."],
  ];
}

const toneOf = (off) => (off < BACK ? "good" : off >= SMALL ? "bad" : "");
const capital = (words) => words[0].toUpperCase() + words.slice(1);

// The part of an arm that is off most, and how far.
function mostOff(chain, arm, off) {
  const k = off.reduce((best, v, i) => (v > off[best] ? i : best), 0);
  const place =
    off[k] > 0
      ? arm.moving[k]
      : arm.moving.find(({ shape }) => chain.links[shape] && chain.links[shape][1]) ||
        arm.moving[k];
  return { off: off[k], part: chain.links[place.shape][1] || "hand" };
}

function notesOf(arms, runs, cycles) {
  const cost = runs.at(-1).speed / runs[0].speed - 1;
  const said = [];
  if (runs.length > 1)
    said.push([
      Math.abs(cost) < 5e-4
        ? "The repeatable one takes no more joint speed (rms)."
        : `The repeatable one takes ${Math.abs(100 * cost).toFixed(Math.abs(cost) < 0.1 ? 1 : 0)}\u00a0% ${cost > 0 ? "more" : "less"} joint speed (rms).`,
    ]);
  const violated = runs.flatMap(({ data: { broken, under } }) =>
    broken && broken.cycle <= cycles
      ? [
          [
            ` ${broken.name ? `${broken.name} leaves its range` : broken.words} in cycle ${broken.cycle} under ${under}.`,
            "bad",
          ],
        ]
      : [],
  );
  said.push(...(violated.length ? violated : [[" Joint limits kept."]]));
  const margin = Math.min(...runs.map((run) => run.margin));
  said.push([
    ` Leaf margin ${margin.toFixed(2)} or more (1 is best, 0 singular). Collisions are not checked.`,
  ]);
  return said;
}
