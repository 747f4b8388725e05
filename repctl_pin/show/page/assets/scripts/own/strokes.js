// The strokes of a drawn loop that the hand cannot follow.

import { lengthOf, nearestPiece } from "./loops.js";

// Where on a loop the hand cannot follow each of these strokes, without those that it can: an
// address may have such, and so may another place of the slider.
export function* failedStrokes(steps, loop, strokes) {
  const found = new Map();
  for (const stroke of strokes) {
    const stop = yield* stopOf(steps, loop, stroke);
    if (stop.reasons.length) found.set(stroke, stop);
  }
  return found;
}

// Where on a loop the hand cannot follow a stroke, and why: {after, m of the loop, reasons}, one
// for each arm that cannot; where F ends, its `edge`, and how far the stroke `goes` beyond.
function* stopOf(steps, loop, stroke) {
  const from = steps.from(loop[0]);
  const till = loop.slice(1, nearestPiece(loop, stroke[0]) + 1);
  const { refusal, trail } = yield* steps.walk(from, [...till, ...stroke]);
  const reasons = refusal ? from.refusals : [];
  const edge = (refusal && from.edge) || null;
  const chart = edge && edge.i < 3 && steps.laws.at(-1).parts[0];
  // in the coordinate of the edge; null if that is no position
  const goes = chart ? chart.farthest(edge.i, stroke, edge.at > edge.high) : null;
  return { after: lengthOf([loop[0], ...trail]), reasons, edge, goes };
}
