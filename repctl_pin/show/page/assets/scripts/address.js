// The page's address keeps where time stands and where the camera is: #t=4.5&view=1,2,3,0,0,0,1.

const asked = new URLSearchParams(location.hash.slice(1));

// What the address asks for: `paused`, a time in cycles, a view of seven numbers; null where it does not.
export function wishes() {
  const t = asked.has("t") ? Number(asked.get("t")) : NaN, view = (asked.get("view") || "").split(",").map(Number);
  return { paused: asked.has("paused"), time: Number.isFinite(t) ? t : null, view: view.length === 7 && view.every(Number.isFinite) ? view : null };
}

// Write them down, once they have been at rest for a moment.
let waiting = 0;
export function keep(clock, eye) {
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    if (clock.playing) return;
    const parts = [`t=${Number(clock.time.toFixed(4))}`, ...(eye.touched ? [`view=${eye.where().map((v) => Number(v.toFixed(4))).join(",")}`] : [])];
    try { history.replaceState(null, "", `#${parts.join("&")}`); } catch { /* a page inside another has no address of its own */ }
  }, 300);
}
