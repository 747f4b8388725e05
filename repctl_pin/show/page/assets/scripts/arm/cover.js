// What a function covers, in pale: a surface around its positions, and their edges.

import { inEachScheme, tone } from "../dom.js";
import { dots } from "./traces.js";

const SECTIONS = 49;
const EDGE = 400; // points of the line around what is covered at a height

// `cover`: {inner, outer} sides of a section, points from below, and {shift}, which leads from the
// first section to the last, or {origin, axis, from, to}, around which the section turns, rad.
export function drawCover(arms, { cover }, edges) {
  const T = MeshCat.THREE;
  const pale = { transparent: true, depthWrite: false };
  // in a small picture, lines and surfaces stand closer
  const faint = window.matchMedia("(max-width: 640px)").matches ? 0.6 : 1;
  const sheetOf = new T.MeshBasicMaterial({ ...pale, opacity: 0.055 * faint, side: T.DoubleSide });
  const lineOf = new T.LineBasicMaterial({ ...pale, opacity: 0.5 * faint });
  inEachScheme(() => {
    for (const { color } of [sheetOf, lineOf]) color.set(tone("--cover"));
  });
  const [inner, outer] = [cover.inner, cover.outer].map((side) =>
    side.map((p) => new T.Vector3(...p)),
  );
  const sheets = [inner, outer, [inner[0], outer[0]], [inner.at(-1), outer.at(-1)]].map((side) =>
    sections(side, cover),
  );
  for (const at of [0, -1]) sheets.push([inner, outer].map((side) => sections(side, cover).at(at)));
  for (const arm of arms) {
    for (const sheet of sheets) arm.group.add(new T.Mesh(strip(sheet), sheetOf));
    for (const line of edges)
      arm.group.add(new T.Line(new T.BufferGeometry().setFromPoints(line), lineOf));
  }
}

// Where F ends at the height of a point: a closed line that follows it.
export class EdgeLine {
  constructor(parent, cover) {
    const T = MeshCat.THREE;
    this.cover = cover;
    [this.inner, this.outer] = [cover.inner, cover.outer].map((side) =>
      side.map((p) => new T.Vector3(...p)),
    );
    this.up = cover.shift
      ? this.inner.at(-1).clone().sub(this.inner[0]).normalize()
      : new T.Vector3(...cover.axis);
    this.positions = new T.Float32BufferAttribute(3 * EDGE, 3);
    const geometry = new T.BufferGeometry().setAttribute("position", this.positions);
    const color = tone("--cover");
    const line = new T.LineLoop(geometry, new T.LineBasicMaterial({ color }));
    parent.add(Object.assign(line, { frustumCulled: false }), dots(geometry, color));
  }

  show(point) {
    const { inner, outer, up, positions } = this;
    const height = point.clone().sub(inner[0]).dot(up);
    const over = inner.findIndex((p, i) => i && p.clone().sub(inner[0]).dot(up) >= height);
    const next = over < 0 ? inner.length - 1 : over;
    const [low, high] = [next - 1, next].map((i) => inner[i].clone().sub(inner[0]).dot(up));
    const share = Math.min(Math.max((height - low) / (high - low), 0), 1);
    const ends = [inner, outer].map((side) => side[next - 1].clone().lerp(side[next], share));
    const rows = sections(ends, this.cover);
    const around = [...rows.map((row) => row[0]), ...rows.map((row) => row[1]).reverse()];
    spaced(around, EDGE).forEach((p, i) => positions.setXYZ(i, p.x, p.y, p.z));
    positions.needsUpdate = true;
  }
}

// As many points at equal distances along a closed line.
function spaced(line, count) {
  const sizes = line.map((p, i) => p.distanceTo(line[(i + 1) % line.length]));
  const step = sizes.reduce((sum, v) => sum + v, 0) / count;
  const found = [];
  let left = 0;
  line.forEach((p, i) => {
    const next = line[(i + 1) % line.length];
    for (; left < sizes[i] && found.length < count; left += step)
      found.push(p.clone().lerp(next, left / sizes[i]));
    left -= sizes[i];
  });
  while (found.length < count) found.push(line[0]);
  return found;
}

// The places of a line of points at each section.
function sections(line, { shift, origin, axis, from, to }) {
  const T = MeshCat.THREE;
  const count = shift ? 2 : SECTIONS;
  return Array.from({ length: count }, (_, i) => {
    const part = i / (count - 1);
    if (shift) return line.map((p) => p.clone().addScaledVector(new T.Vector3(...shift), part));
    const [o, a] = [origin, axis].map((v) => new T.Vector3(...v));
    const angle = from + part * (to - from);
    return line.map((p) => p.clone().sub(o).applyAxisAngle(a, angle).add(o));
  });
}

// A surface through rows of equally many points.
function strip(rows) {
  const T = MeshCat.THREE;
  const n = rows[0].length;
  const index = [];
  for (let i = 0; i < rows.length - 1; i++)
    for (let k = i * n; k < (i + 1) * n - 1; k++)
      index.push(k, k + n, k + 1, k + 1, k + n, k + n + 1);
  const made = new T.BufferGeometry().setFromPoints(rows.flat());
  made.setIndex(index);
  return made;
}
