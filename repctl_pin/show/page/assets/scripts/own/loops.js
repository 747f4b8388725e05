// Shapes of loops, from the hand on, and what is kept of one that was drawn.

const POINTS = 40; // of a loop, as it is kept
const IN_AXES = 0.998; // cosine of the angle to an axis within which a plane is named by the others

export const gap = (p, q) => Math.hypot(...p.map((v, i) => v - q[i]));

export const vector = (p) => new MeshCat.THREE.Vector3(...p);

const round = (f) =>
  Array.from({ length: POINTS - 1 }, (_, i) => f((2 * Math.PI * (i + 1)) / POINTS));

// In a plane, in parts of a size.
export const FORMS = {
  circle: round((a) => [1 - Math.cos(a), Math.sin(a)]),
  eight: round((a) => [Math.sin(a), Math.sin(2 * a) / 2]),
  square: [
    [0, 1.6],
    [1.6, 1.6],
    [1.6, 0],
  ],
};

// A closed loop of at most POINTS points, to a tenth of a millimetre, that begins and ends at home.
export const kept = (points, home) => closed(few(points), home);

// A stroke of at most POINTS points, to a tenth of a millimetre.
export const thinned = (points) => few(points).map(rounded);

function few(points) {
  let left = points;
  for (let most = 5e-4; left.length > POINTS || most === 5e-4; most *= 1.3)
    left = simpler(points, most);
  return left;
}

const rounded = (p) => p.map((v) => Number(v.toFixed(4)));

export const lengthOf = (points) =>
  points.slice(1).reduce((sum, p, i) => sum + gap(p, points[i]), 0);

// The first piece of a line that comes nearest to a point, to a tenth of a millimetre.
export function nearestPiece(points, p) {
  const off = points.slice(1).map((b, i) => fromPiece(p, points[i], b));
  return off.findIndex((v) => v < Math.min(...off) + 1e-4);
}

export function closed(points, first) {
  const inside = points.slice(1).map(rounded);
  const last = inside.at(-1);
  if (Math.hypot(...last.map((v, i) => v - first[i])) < 1e-3) inside.pop();
  return [Array.from(first), ...inside, Array.from(first)];
}

// Douglas and Peucker: leave out points that are this near to the line without them.
function simpler(points, most) {
  const [a, b] = [points[0], points.at(-1)];
  let worst = 0;
  let at = 0;
  points.forEach((p, k) => {
    const off = fromPiece(p, a, b);
    if (off > worst) {
      worst = off;
      at = k;
    }
  });
  return worst > most
    ? [...simpler(points.slice(0, at + 1), most).slice(0, -1), ...simpler(points.slice(at), most)]
    : [a, b];
}

// How far a point is from the piece of a line from a to b.
function fromPiece(p, a, b) {
  const d = b.map((v, i) => v - a[i]);
  const size = d.reduce((sum, v) => sum + v * v, 0);
  const w = p.map((v, i) => v - a[i]);
  const t =
    size > 0 ? Math.min(1, Math.max(0, w.reduce((sum, v, i) => sum + v * d[i], 0) / size)) : 0;
  return Math.hypot(...w.map((v, i) => v - t * d[i]));
}

// The length of a loop without the ways that it goes there and back, m: 0 where it encloses
// nothing.
export function enclosing(points) {
  const sizes = points.slice(1).map((p, i) => gap(p, points[i]));
  const step = sizes.reduce((sum, v) => sum + v, 0) / 80;
  const outline = [points[0]];
  let left = step;
  points.slice(1).forEach((p, i) => {
    for (; left <= sizes[i] + 1e-12; left += step) {
      const at = points[i].map((v, k) => v + (left / sizes[i]) * (p[k] - v));
      if (outline.length > 1 && gap(at, outline.at(-2)) < 1.5 * step) outline.pop();
      else if (gap(at, outline.at(-1)) > 0.5 * step) outline.push(at);
    }
    left -= sizes[i];
  });
  return outline.length > 4 ? (outline.length - 1) * step : 0;
}

// The same paths, null for a frame that holds still; of several, with corners at the same shares of
// their lengths, so that they are followed together.
export function inStep(paths) {
  if (paths.filter(Boolean).length < 2) return paths;
  const shares = paths.map((path) => path && sharesOf(path));
  const all = [...new Set(shares.flatMap((own) => own || []))].sort((a, b) => a - b);
  const corners = all.filter((share, i) => !i || share - all[i - 1] > 1e-9);
  return paths.map((path, f) => path && corners.map((share) => pointOn(path, shares[f], share)));
}

// At which share of its length each point of a path is.
function sharesOf(path) {
  const length = lengthOf(path);
  let passed = 0;
  return path.map((p, i) => {
    if (i) passed += gap(p, path[i - 1]);
    return passed / length;
  });
}

function pointOn(path, shares, share) {
  const i = Math.max(shares.findIndex((v) => v >= share) - 1, 0);
  const step = shares[i + 1] - shares[i]; // 0 between equal points
  const part = step ? Math.min((share - shares[i]) / step, 1) : 0;
  return path[i].map((v, c) => v + part * (path[i + 1][c] - v));
}

// The normal of the plane of a loop, from its widest triangle at its start.
export function normalOf([home, ...points]) {
  const T = MeshCat.THREE;
  const off = points.map((p) => vector(p.map((v, i) => v - home[i])));
  const far = off.reduce((a, b) => (b.length() > a.length() ? b : a));
  const across = off.map((p) => new T.Vector3().crossVectors(far, p));
  return across.reduce((a, b) => (b.length() > a.length() ? b : a)).normalize();
}

// A plane with this normal, in words.
export function planeWords(normal) {
  const across = normal.toArray().map(Math.abs);
  const i = across.findIndex((v) => v > IN_AXES);
  if (i >= 0) return `in ${["yz (upright)", "xz (upright)", "xy (horizontal)"][i]}`;
  const tilt = Math.round((180 / Math.PI) * Math.acos(Math.min(across[2], 1)));
  return tilt > 87 ? "upright" : `${tilt}° from horizontal`;
}

// How often a loop goes round the axis of the first joint.
export function windings(about, points) {
  if (!about) return 0;
  const T = MeshCat.THREE;
  const axis = vector(about.axis);
  const flat = points.map((p) => vector(p).sub(vector(about.origin)).projectOnPlane(axis));
  const angles = flat
    .slice(1)
    .map((p, i) => Math.atan2(new T.Vector3().crossVectors(flat[i], p).dot(axis), flat[i].dot(p)));
  return Math.round(angles.reduce((sum, v) => sum + v, 0) / (2 * Math.PI));
}
