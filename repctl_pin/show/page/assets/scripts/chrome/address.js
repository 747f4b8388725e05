// The page's address keeps where time stands and where the camera is: #t=4.5&view=1,2,3,0,0,0,1; a
// visitor's own loop: #loop=x,y,z;x,y,z;… of the frame's origin, m, base axes, the strokes that the
// hand could not follow with missed=x,y,z;…|x,y,z;…, of the second hand with hand=2, mirrored by
// the others with mirror=1, or beside those of the others with others=x,y,z;…|x,y,z;… by frame; and
// the place of the elbow's slider: elbow=12, along level=2.

const asked = new URLSearchParams(location.hash.slice(1));

// What the address asks for: `paused`, a time in cycles, a view of seven numbers, a loop of points;
// null where it does not.
export function readAddress() {
  const t = asked.has("t") ? Number(asked.get("t")) : NaN;
  const view = (asked.get("view") || "").split(",").map(Number);
  const points = lineOf(asked.get("loop"));
  return {
    own: points.length > 2 || asked.has("elbow") || asked.has("level") ? ownOf(points) : null,
    paused: asked.has("paused"),
    time: Number.isFinite(t) ? t : null,
    view: view.length === 7 && view.every(Number.isFinite) ? view : null,
  };
}

// A line of points as an address has it.
const lineOf = (text) =>
  (text || "")
    .split(";")
    .map((p) => p.split(",").map(Number))
    .filter((p) => p.length === 3 && p.every(Number.isFinite));

// A visitor's loop: its points, or null for the study's path; the hand that goes along it, whether
// the others mirror it, and where the elbow's slider stands, along which level.
function ownOf(points) {
  const whole = (name) => Math.round(Number(asked.get(name))) || 0;
  return {
    points: points.length > 2 ? points : null,
    missed: (asked.get("missed") || "")
      .split("|")
      .map(lineOf)
      .filter((stroke) => stroke.length > 1),
    hand: Math.max(whole("hand") - 1, 0),
    others: (asked.get("others") || "").split("|").map((text) => {
      const line = lineOf(text);
      return line.length > 2 ? line : null;
    }),
    mirrored: asked.has("mirror"),
    elbow: whole("elbow"),
    level: asked.has("level") ? Math.max(whole("level") - 1, 0) : undefined,
  };
}

// Write them down, once they have been at rest for a moment, and what `own`, of a visitor's loop,
// says of itself.
let waiting = 0;
export function keep(clock, eye, own) {
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    // until the loop of an address is computed, the address stays
    if (clock.playing || !window.repctl.ready) return;
    const view = eye.where().map((v) => Number(v.toFixed(4)));
    const parts = [...(own ? own.addressParts() : []), `t=${Number(clock.time.toFixed(4))}`];
    if (eye.touched) parts.push(`view=${view.join(",")}`);
    try {
      history.replaceState(null, "", `#${parts.join("&")}`);
    } catch {
      /* a page inside another has no address of its own */
    }
  }, 300);
}
