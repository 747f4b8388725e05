// The link to a visitor's loop: what the page's address keeps of it, see chrome/address.js.

// The parts of an address with these loops and this place of the elbow's slider.
export function linkParts(loops, elbow) {
  const { points, missed, mirrored, chain } = loops;
  const { led } = chain;
  const number = (v) => Number(v.toFixed(4));
  const others = loops.each().map((loop, f) => (f !== led && loop) || []);
  const written = (line) => line.map((p) => p.map(number).join(",")).join(";");
  return [
    points && `loop=${written(points)}`,
    points && missed.length && `missed=${missed.map(written).join("|")}`,
    points && led && `hand=${led + 1}`,
    points && loops.keeping().length && `others=${others.map(written).join("|")}`,
    points && mirrored && "mirror=1",
    elbow.at && `elbow=${elbow.at}`,
    elbow.level !== elbow.unnamed(elbow.at) && `level=${elbow.level + 1}`,
  ].filter(Boolean);
}
