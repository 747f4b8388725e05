// The CSV of a visitor's loop.

// The loops of the hands as a file of waypoints: columns x,y,z, or those of each frame that moves.
export function loopCsv(loops) {
  const { frames } = loops.chain;
  const moving = loops
    .paths()
    .map((path, f) => ({ path, name: frames.length > 1 ? `${frames[f].frame}.` : "" }))
    .filter(({ path }) => path);
  const head = moving.flatMap(({ name }) => ["x", "y", "z"].map((axis) => name + axis));
  const rows = moving[0].path.map((_, i) =>
    moving.flatMap(({ path }) => Array.from(path[i], (v) => Number(v.toFixed(9)))),
  );
  return `${[head, ...rows].map((row) => row.join(",")).join("\n")}\n`;
}
