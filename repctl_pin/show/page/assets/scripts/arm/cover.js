// What a function covers, in pale: a surface around its positions, and their edges.

const COLOUR = "#0072b2";
const SECTIONS = 49;

// `cover`: {inner, outer} sides of a section, points from below, and {shift}, which leads from the
// first section to the last, or {origin, axis, from, to}, around which the section turns, rad.
export function drawCover(arms, { cover }, edges) {
  const T = MeshCat.THREE;
  const pale = { color: COLOUR, transparent: true, depthWrite: false };
  const [inner, outer] = [cover.inner, cover.outer].map((side) =>
    side.map((p) => new T.Vector3(...p)),
  );
  const sheets = [inner, outer, [inner[0], outer[0]], [inner.at(-1), outer.at(-1)]].map((side) =>
    sections(side, cover),
  );
  for (const at of [0, -1]) sheets.push([inner, outer].map((side) => sections(side, cover).at(at)));
  for (const arm of arms) {
    for (const sheet of sheets)
      arm.group.add(
        new T.Mesh(
          strip(sheet),
          new T.MeshBasicMaterial({ ...pale, opacity: 0.055, side: T.DoubleSide }),
        ),
      );
    for (const line of edges)
      arm.group.add(
        new T.Line(
          new T.BufferGeometry().setFromPoints(line),
          new T.LineBasicMaterial({ ...pale, opacity: 0.5 }),
        ),
      );
  }
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
