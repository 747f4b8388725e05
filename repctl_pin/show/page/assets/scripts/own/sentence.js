// What is said of a visitor's loop: as show/text/headline.py says it of a study.

import { formatLength, formatNumber } from "../numbers.js";

const SMALL = 0.01; // m, below which a part has hardly drifted
const BACK = 1e-4; // m, below which it is back
const TURNED = 0.1; // rad, from which a joint is named although no part is off
const FULL = 0.95; // turns from which a joint is said to have wound
const FAR = 0.5; // leaf margin from which the repeatable control is far from where it fails
const FROM = " from its start";
const WHERE = "close to a singularity, at the red ball";
// stands after every loop, whatever is said of it
export const CHECKED = " Limits are checked, collisions are not.";

// {sentence, notes, part} after a number of cycles, in pieces [words, tone]; a number has for its
// tone the control whose colour it shows. `whose`: "your loop"
// or "the path"; whether it encloses anything, and how often it turns around the first joint.
export function answer(chain, arms, { runs }, cycles, shape) {
  // an arm that has come close to a singularity is named first, the others are compared
  const lost = arms.flatMap((arm, k) => (runs[k].data.lost < cycles ? [k] : []));
  const kept = arms.flatMap((_, k) => (lost.includes(k) ? [] : [k]));
  if (!kept.length) {
    const sentence = [[noneWords(runs, shape), "bad"]];
    return {
      sentence,
      notes: [...notesOf(chain, arms, runs, cycles, shape), notKnown("")],
      part: "hand",
    };
  }
  const sentence = lost.flatMap((k) => lostWords(arms[k], runs[k].data));
  const context = {
    chain,
    arms: kept.map((k) => arms[k]),
    runs: kept.map((k) => runs[k]),
    alone: lost.length > 0,
    times: cycles === 1 ? "one cycle" : `${cycles} cycles`,
    k: cycles - 1,
  };
  const violations = brokenLimits(context.runs).flatMap((data) =>
    violationWords(data, cycles, shape.whose),
  );
  const found = comparison({ ...context, broken: violations.length > 0 }, shape);
  return {
    sentence: [...sentence, ...violations, ...found.sentence],
    notes: [
      ...notesOf(chain, context.arms, context.runs, cycles, shape),
      ...lost.map((k) => notKnown(` under ${aloneUnder(arms[k])}`)),
    ],
    part: found.part,
  };
}

// What is said of a loop that the hand could not follow: how much of it, why not all, and what the
// solid line is. One reason may hold for all arms, or for the function of a cell alone, which says
// so itself.
export function failureWords(chain, arms, { after, reasons }) {
  const far = unbroken(formatLength(after));
  const each = reasons.flatMap((reason, k) => (reason ? [[reason, arms[k].data.under]] : []));
  const [[first]] = each;
  const alike = each.every(([reason]) => reason === first);
  const either = each.length > 1 ? " under either control" : "";
  const listed = each.map(([reason, under]) => `${reason} under ${under}`).join(", ");
  const words = `The ${armWord(chain)} cannot follow all of your loop. After its first ${far}`;
  return [[`${words}, at the red ball, ${alike ? `${first}${either}` : listed}.`, "bad"]];
}

// The same on the page of a cell, where F alone ends, by its edge or at a limit.
export function edgeWords({ after, reasons, edge, goes }) {
  const why = reasons.at(-1).replace(/^F covers/, "it covers");
  const far = unbroken(formatLength(after));
  const asked = goes ? goesWords(edge, goes) : "";
  return [[`F ends after the first ${far} of your loop, at the red ball: ${why}${asked}.`, "bad"]];
}

// What the solid line of such a loop is, this long, m; `both` arms follow it, although one alone
// ends. It encloses nothing if the way home was blocked, too. `flaws`: what is wrong with it, see
// lineFlaws(); then what it leaves out is left to its key.
export function lineWords(length, { encloses }, both, flaws) {
  const line = `the solid line, ${unbroken(formatLength(length))} long,`;
  const begin = encloses ? "" : "There is no way around: ";
  if (flaws) return [[` ${capitalized(`${begin}on ${line}`)}`], [` ${flaws}.`, "bad"]];
  const how = encloses
    ? "leaves that part out"
    : "goes as far as it can and comes back the same way";
  const words = both ? `both arms follow ${line} which ${how}` : `${line} ${how}`;
  return [[` ${capitalized(`${begin}${words}`)}.`]];
}

// What happens on the solid line within these cycles: which control fails, or breaks a limit.
export function lineFlaws(runs, cycles) {
  const seen = brokenLimits(runs).filter(({ broken }) => broken && broken.cycle <= cycles);
  const each = seen.map((data) => [
    aloneUnder({ data }),
    data.lost < Infinity ? "fails" : "breaks a limit",
  ]);
  const alike = each.length > 1 && each.every(([, what]) => what === each[0][1]);
  const listed = alike ? [["either control", each[0][1]]] : each;
  return listed.map((words) => words.join(" ")).join(", ");
}

// Which range of a coordinate F covers where it ends, see CellPotentials.beyond().
export function coverWords({ name, low, high, angle, height }) {
  const unit = angle ? "°" : "\u00a0m";
  const [from, to] = [inward(low, angle, 1), inward(high, angle, -1)];
  const at = height === null ? "" : ` at height\u00a0${decimals(height)}\u00a0m`;
  return `F covers ${name} ${from} to\u00a0${to}${unit}${at}`;
}

// How far a loop goes beyond that range, where its number differs from the range's; nothing if it
// goes there at another height, at which F has another range.
function goesWords({ low, high, angle, at, height }, goes) {
  if (height !== null && decimals(goes.height) !== decimals(height)) return "";
  const value = decimals(goes.value, angle);
  const end = at > high ? inward(high, angle, -1) : inward(low, angle, 1);
  return value === end ? "" : `, your loop goes to ${value}${angle ? "°" : "\u00a0m"}`;
}

// An end of a range, rounded into it: whole degrees or centimetres.
function inward(value, angle, side) {
  const scale = angle ? 180 / Math.PI : 100;
  const steps = side > 0 ? Math.ceil(value * scale - 1e-3) : Math.floor(value * scale + 1e-3);
  return decimals(steps / scale, angle);
}

function decimals(value, angle) {
  const text = angle ? ((180 / Math.PI) * value).toFixed(0) : value.toFixed(2);
  return text.replace(/^-(?=0(\.00)?$)/, "").replace("-", "−");
}

// The reason of a refusal as a sentence; it may begin with the name of a joint.
export const stated = (reason) => `${reason.replace(/^th(?=e |at )/, "Th")}.`;

function lostWords(arm, { broken }) {
  const control = capitalized(aloneUnder(arm));
  return [[`${control} fails in cycle ${broken.cycle}, ${WHERE}.`, "bad"], [" "]];
}

// Why the drift of an arm that fails is not said.
const notKnown = (under) => [
  ` Close to a singularity, small errors of the computation grow, so the drift${under} is not ` +
    "known from the red ball on.",
];

function noneWords(runs, { whose }) {
  const each = runs.map(({ data: { under, broken } }, k) =>
    k ? `${under} in cycle ${broken.cycle}` : `${under} fails in cycle ${broken.cycle}`,
  );
  const solid = whose === "the solid line";
  const none = solid ? `On ${whose}` : `No arm can follow ${whose} to its end:`;
  return `${none} ${each.join(", ")}, ${WHERE}.`;
}

// Who is back and who is not, of the arms that have gone all the way; after a limit is `broken`,
// no hand is called back.
function comparison(context, { encloses, turns, whose }) {
  const { chain, arms, runs, alone, broken, times, k } = context;
  const worst = runs.map(({ ends }, i) => mostOff(chain, arms[i], ends[k]));
  const most = worst.reduce((a, b) => (b.off > a.off ? b : a));
  const joints = runs.map(({ turned }) => Math.max(...turned[k]));
  const back = worst.every(({ off }, i) => off < BACK && joints[i] < TURNED);
  const under = (i) => (runs.length > 1 ? ` under ${arms[i].data.under}` : "");
  const listed = (say) => runs.flatMap((run, i) => [[i ? ", " : ""], say(i), [under(i)]]);
  const sentence = [];
  if (turns && !back)
    sentence.push([
      `${capitalized(whose)} winds around the axis of ${chain.axis.name}, ` +
        "so it need not close under any control. ",
    ]);
  const by = alone ? ` under ${aloneUnder(arms[0])}` : "";
  if (alone && back && encloses && !broken)
    return {
      sentence: [
        [`${capitalized(aloneUnder(arms[0]))} brings every part back: `],
        ["0", arms[0].data.whose],
        [`${FROM} after ${times}.`],
        ...othersOf(chain, arms, runs, k),
      ],
      part: most.part,
    };
  if (!broken) sentence.push([`After ${times} of ${whose} ${chain.back}${by}. `]);
  const is = (subject, verb) =>
    broken
      ? `In a simulation that goes on, after ${times} ${subject} ${verb}: `
      : `${capitalized(subject)} ${verb}: `;
  const not = broken ? "is not back" : "is not";
  const value = (i, unit) => {
    const { off, part } = worst[i];
    const zero = off < BACK;
    const also = zero || part === most.part ? "" : ` (${part})`;
    return [`${unbroken(formatLength(off))}${zero && i ? "" : unit}${also}`, arms[i].data.whose];
  };
  if (back && !encloses)
    sentence.push(
      ["A line out and back encloses nothing: "],
      ["0", "ink"],
      [` from the start${runs.length === 2 ? " under both controls" : ""}.`],
    );
  else if (back)
    sentence.push(
      [
        broken
          ? is(`every part of the ${armWord(chain)}`, "is back")
          : `So is every part of the ${armWord(chain)}: `,
      ],
      ["0", "ink"],
      [" from its start."],
    );
  else if (most.off >= SMALL) {
    const offs = listed((i) => value(i, FROM));
    sentence.push([is(partWords(most.part), not)], ...offs, ["."], ...windingWords(context));
  } else if (Math.max(...joints) >= TURNED) {
    const angles = listed((i) => [angleWords(joints[i]), arms[i].data.whose]);
    sentence.push([is(`the joint ${mostTurned(chain, runs, k)}`, not)], ...angles, ["."]);
  } else {
    const offs = listed((i) => value(i, ""));
    // the bars of later cycles may show more
    const later = runs.some(({ ends }) => Math.max(...ends.at(-1)) >= SMALL);
    const verb = `${later ? "has drifted" : "has hardly drifted"}${broken ? "" : ` in ${times}`}`;
    sentence.push([is(partWords(most.part), verb)], ...offs, ["."]);
  }
  sentence.push(...othersOf(chain, arms, runs, k));
  return { sentence, part: most.part };
}

const armWord = ({ frames }) => (frames.length > 1 ? "arms" : "arm");
const aloneUnder = ({ data }) => data.under.replace("repeatable one", "repeatable control");
const unbroken = (words) => words.replaceAll(" ", "\u00a0");

// A part in a label: "the elbow", "link 5".
export const shortName = (part) => (/\d/.test(part) ? part : `the ${part}`);

function partWords(part) {
  if (!/\d/.test(part)) return shortName(part);
  return part.startsWith("arm ") ? part : `${part} of the arm`;
}

const angleWords = (angle) =>
  angle < 1e-5 ? "0" : `${formatNumber(Number(angle.toPrecision(2)))}\u00a0rad`;

// Which joint is a full turn or more from its start, which no part shows.
function windingWords({ chain, arms, runs, k }) {
  const turns = runs.map(({ turned }) => Math.max(...turned[k]) / (2 * Math.PI));
  const most = Math.max(...turns);
  if (most < FULL) return [];
  const i = turns.indexOf(most);
  const under = runs.length > 1 ? ` under ${arms[i].data.under}` : "";
  const joint = mostTurned(chain, [runs[i]], k);
  return [[` The joint ${joint} is ${most.toFixed(1)}\u00a0turns from its start${under}.`]];
}

// The joint that has turned most under any control.
function mostTurned({ names }, runs, k) {
  const most = (all) => Math.max(...all);
  const worst = runs.map(({ turned }) => turned[k]).reduce((a, b) => (most(b) > most(a) ? b : a));
  return names[worst.indexOf(most(worst))];
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
  const upTo = moved.length > 1 ? "up to " : "";
  const named = ({ name, link }, i) => {
    const plain = name !== "other end" && away.filter((end) => end.name === name).length === 1;
    const article = one || i ? "the" : "The";
    const words = `${article} ${plain ? name : `${name} ${link}`}`;
    return i ? `, ${words} ${upTo}` : `${words} is ${upTo}`;
  };
  return [
    [one ? ` Under ${moved[0].data.under} ` : " "],
    ...away.flatMap((end, i) => [
      [named(end, i)],
      [unbroken(formatLength(end.off)), moved.length === 1 ? moved[0].data.whose : "ink"],
      [i ? "" : FROM],
    ]),
    ["."],
  ];
}

const capitalized = (words) => words[0].toUpperCase() + words.slice(1);

// The most displaced part of an arm, and its displacement.
function mostOff(chain, arm, off) {
  const k = off.reduce((best, v, i) => (v > off[best] ? i : best), 0);
  const named = arm.moving.find(({ shape }) => chain.links[shape] && chain.links[shape][1]);
  const place = off[k] > 0 ? arm.moving[k] : named || arm.moving[k];
  return { off: off[k], part: chain.links[place.shape][1] || "hand" };
}

function notesOf(chain, arms, runs, cycles, { whose }) {
  const finished = runs.every(({ data }) => data.lost >= cycles);
  const notes = runs.length > 1 && finished ? [[speedWords(runs.at(-1), runs[0], cycles)]] : [];
  const later = brokenLimits(runs).flatMap((data) => laterWords(data, cycles));
  const kept = finished && runs.every(({ data }) => !data.broken || data.lost < Infinity);
  const blind = chain.fastest.includes(null) ? "; joint speeds are not checked" : "";
  const there = whose === "the solid line" ? ` on ${whose}` : "";
  notes.push(...(kept && !later.length ? [[` Joint limits are kept${there}${blind}.`]] : later));
  const repeatable = arms.findIndex(({ data }) => data.under === "the repeatable one");
  const run = runs[repeatable];
  // of one that fails in any cycle, this would be said of a part of its way
  if (!run || run.data.lost < Infinity) return notes;
  const where = run.margin >= FAR ? "stays far from" : "comes near to";
  const scale = `${run.margin.toFixed(2)} (1 is best, 0 fails)`;
  notes.push([` The repeatable control ${where} where it alone fails: ${scale}.`]);
  return notes;
}

// The limits that the motions break; what all of them break is one, for a line that is cut off
// must not make one control look worse than the other.
export function brokenLimits(runs) {
  const [first, ...others] = runs.map(({ data }) => data);
  const same = ({ broken, lost }) =>
    broken &&
    lost === Infinity &&
    broken.cycle === first.broken.cycle &&
    broken.words === first.broken.words;
  const alike = others.length && first.broken && [first, ...others].every(same);
  return alike ? [{ ...first, under: "either control" }] : [first, ...others];
}

const limitWords = ({ name, words }) =>
  name ? `${name} leaves its range` : words.replace(" past ", " exceeds ");

function violationWords({ broken, under, lost }, cycles, whose) {
  if (!broken || lost < Infinity || broken.cycle > cycles) return [];
  const words = `${limitWords(broken)} in cycle ${broken.cycle} of ${whose}`;
  return [[`Under ${under}, ${words}.`, "bad"], [" "]];
}

// What happens in a later cycle, whose bars may be missing.
function laterWords({ broken, under, lost }, cycles) {
  if (!broken || broken.cycle <= cycles) return [];
  const what =
    lost < Infinity
      ? `${under} fails close to a singularity, at the red ball`
      : `${limitWords(broken)} under ${under}`;
  return [[` In cycle ${broken.cycle}, ${what}.`, "bad"]];
}

// Which joints go beyond the ends of their rails, as these are drawn; see own_loop.py.
export function railNotes({ n, names, rails }, motions) {
  const left = names.filter((_, i) => {
    const goes = (q, k) => k % n === i && (q < rails[i][0] || q > rails[i][1]);
    return rails[i] && motions.some(({ Q }) => Q.some(goes));
  });
  const one = left.length === 1;
  const words = one ? "goes beyond its rail, which is" : "go beyond their rails, which are";
  const range = one ? "its range" : "their ranges";
  return left.length ? [[` ${left.join(" and ")} ${words} drawn shorter than ${range}.`]] : [];
}

// How much higher the joint speed is under the repeatable control than under the usual one.
function speedWords(one, usual, cycles) {
  const [early, late] = [0, cycles - 1].map((c) => higher(one.speeds[c] / usual.speeds[c] - 1));
  const middle = early === late ? " and" : `, ${late}`;
  const over = cycles > 1 ? `${middle} over all ${cycles} cycles` : "";
  const than = `under ${one.data.under} than under the usual control in cycle 1`;
  return `Average joint speed on this path: ${early} ${than}${over}.`;
}

function higher(cost) {
  if (Math.abs(cost) < 5e-4) return "no higher";
  const share = Math.abs(100 * cost).toFixed(Math.abs(cost) < 0.1 ? 1 : 0);
  return `${share}\u00a0% ${cost > 0 ? "higher" : "lower"}`;
}
