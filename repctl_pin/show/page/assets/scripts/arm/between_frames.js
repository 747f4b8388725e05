// A motion between its frames: by a cubic through those that are near, so that it is smooth.

// The frames, and their weights, that give what is a part f on the way from frame i to the next:
// the cubic through four of the same cycle (Catmull and Rom), its ends extrapolated; a line where
// there are fewer.
export function between(i, f, F) {
  if (!(f > 0)) return [[i, 1]];
  if (F < 4)
    return [
      [i, 1 - f],
      [i + 1, f],
    ];
  const at = i % F;
  const ff = f * f;
  const fff = ff * f;
  let [a, b, c, d] = [
    (-f + 2 * ff - fff) / 2,
    (2 - 5 * ff + 3 * fff) / 2,
    (f + 4 * ff - 3 * fff) / 2,
    (fff - ff) / 2,
  ];
  if (at === 0) [a, b, c, d] = [0, b + 3 * a, c - 3 * a, d + a];
  if (at === F - 2) [a, b, c, d] = [a + d, b - 3 * d, c + 3 * d, 0];
  return [
    [i - 1, a],
    [i, b],
    [i + 1, c],
    [i + 2, d],
  ].filter(([, weight]) => weight);
}

// `count` numbers of the frames that are near, weighed.
export function blended(m, start, stride, count, near) {
  const out = new Array(count).fill(0);
  for (const [frame, weight] of near)
    for (let k = 0; k < count; k++) out[k] += weight * m[start + frame * stride + k];
  return out;
}

const AT_FRAME = [[0, 1]];

// Place a node by seven numbers, its position and its quaternion: those from `start` on, or blended
// of the frames that are near.
export function setPose(node, m, start, stride = 0, near = AT_FRAME) {
  const v = blended(m, start, stride, 7, near);
  node.position.set(v[0], v[1], v[2]);
  node.quaternion.set(v[3], v[4], v[5], v[6]).normalize();
}
