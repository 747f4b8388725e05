// The page's address keeps where time stands and where the camera is: #t=4.5&view=1,2,3,0,0,0,1; and a
// visitor's own loop: #loop=x,y,z;x,y,z;… of the frame's origin, m, base axes.

const asked = new URLSearchParams(location.hash.slice(1));

// What the address asks for: `paused`, a time in cycles, a view of seven numbers, a loop of points; null where it does not.
export function wishes() {
  const t = asked.has("t") ? Number(asked.get("t")) : NaN;
  const view = (asked.get("view") || "").split(",").map(Number);
  const points = (asked.get("loop") || "")
    .split(";")
    .map((p) => p.split(",").map(Number))
    .filter((p) => p.length === 3 && p.every(Number.isFinite));
  return {
    loop: points.length > 2 ? points : null,
    paused: asked.has("paused"),
    time: Number.isFinite(t) ? t : null,
    view: view.length === 7 && view.every(Number.isFinite) ? view : null,
  };
}

// Write them down, once they have been at rest for a moment.
let waiting = 0;
export function keep(clock, eye, loop) {
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    if (clock.playing) return;
    const parts = [
      ...(loop
        ? [`loop=${loop.map((p) => p.map((v) => Number(v.toFixed(4))).join(",")).join(";")}`]
        : []),
      `t=${Number(clock.time.toFixed(4))}`,
      ...(eye.touched
        ? [
            `view=${eye
              .where()
              .map((v) => Number(v.toFixed(4)))
              .join(",")}`,
          ]
        : []),
    ];
    try {
      history.replaceState(null, "", `#${parts.join("&")}`);
    } catch {
      /* a page inside another has no address of its own */
    }
  }, 300);
}
