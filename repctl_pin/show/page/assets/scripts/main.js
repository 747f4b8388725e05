// The page: what stands where, and what happens when.

import { ArmView, cornersOf } from "./arm.js";
import { Card } from "./cards.js";
import { Clock } from "./clock.js";
import { connect } from "./controls.js";
import { byId, forgetTones, unpack } from "./dom.js";
import { Eye, towards } from "./eye.js";
import { follow } from "./live.js";
import { inMetres } from "./numbers.js";
import { Panes } from "./panes.js";
import { driftShade, Marker, Trace } from "./traces.js";
import { floor, light, openViewer } from "./viewer.js";

window.repctl = { ready: false, errors: [] };

function say(text, trouble) {
  byId("notice-text").textContent = text;
  byId("notice").hidden = !text;
  byId("notice").classList.toggle("trouble", Boolean(trouble));
}

// The points that the camera must see: all of the robot, where that leaves the arm large; else its whole width, if it is
// not a hall, and what is near the arm.
function inSight(arms, path, eye) {
  const T = MeshCat.THREE, reach = arms.map((arm) => arm.reach()), moving = reach.flatMap((c) => c.moving), still = reach[0].still;
  const near = new T.Box3().setFromPoints([...moving, ...path]), whole = new T.Box3().setFromPoints([...moving, ...still]);
  if (near.isEmpty()) near.setFromPoints([...still, new T.Vector3()]);
  const extent = near.getSize(new T.Vector3()).length() || 1;
  const across = (box, axis) => { const [a, b] = eye.span(cornersOf(box), axis); return b - a; };
  const room = near.clone().expandByScalar(0.2 * extent), [low, high] = eye.span(cornersOf(room), "up"), wide = across(whole, "right") < 3 * extent;
  const all = across(whole, "up") < Math.max(1.45 * across(near, "up"), wide ? 1.3 * across(near, "right") : 0);
  const level = (p) => p.clone().addScaledVector(eye.up, Math.min(Math.max(p.dot(eye.up), low), high) - p.dot(eye.up));
  const kept = (p) => (all ? p : wide ? level(p) : room.clampPoint(p, new T.Vector3()));
  return { points: [...moving, ...path, ...still.map(kept)], extent, ground: whole.min.z };
}

function drawWays(arms, paths, scene, extent) {
  const T = MeshCat.THREE, F = scene.perCycle, thick = 0.0026 * extent, ways = [];
  for (const arm of arms) {
    const shade = driftShade(arm.data, scene), full = new T.Color(arm.data.color), ink = new T.Color("#6b7784");
    const pieces = (which, limb) => scene.cycles.map((n, c) => Array.from({ length: F }, (v, i) => arm.point(which, limb, c * F + i)));
    for (const way of paths) if (way.length > 1) new Trace(arm.group, [way], 0.75 * thick, () => ink).show(1, 0);
    arm.traces = new T.Group();
    arm.group.add(arm.traces);
    for (let limb = 0; limb < arm.limbs && !scene.live; limb++)
      for (const [which, width, ball, tint] of [["tip", 1.35, 3.4, () => full], ["elbow", 1, 2.8, shade]])
        ways.push({ arm, which, limb, trace: new Trace(arm.traces, pieces(which, limb), width * thick, tint), ball: new Marker(arm.traces, ball * thick, arm.data.color) });
    if (arm.data.broken) arm.past = new Marker(arm.group, 14 * thick, "#e00020", 0.55);
  }
  return ways;
}

async function main() {
  const scene = JSON.parse(byId("scene").textContent), api = window.repctl, start = performance.now();
  if (typeof DecompressionStream === "undefined") { say("This page needs a browser of 2023 or newer.", true); return; }
  let viewer;
  try {
    viewer = await openViewer(api.errors, (part) => { byId("loaded").value = part; });
  } catch (error) {
    api.errors.push(String(error));
    say("The 3D view could not start (" + error.message + "). Is WebGL switched on in this browser?", true);
    return;
  }
  const T = MeshCat.THREE, bytes = await unpack("motion"), motion = new Float32Array(bytes.buffer, 0, bytes.length / 4);
  const F = scene.perCycle, cycles = scene.cycles.length, frames = F * cycles, last = scene.arms[0].drift.length;
  let at = 0;
  const arms = scene.arms.map((arm) => { const view = new ArmView(viewer, arm, motion, at, frames, F); at = view.end; return view; });
  const paths = scene.paths.map((count) => Array.from({ length: count }, () => { const p = new T.Vector3().fromArray(motion, at); at += 3; return p; }));

  const tip = new T.Box3().setFromPoints(arms.flatMap((a) => Array.from({ length: a.limbs }, (_, k) => [a.point("tip", k, 0), a.point("tip", k, F >> 1)]).flat())).getCenter(new T.Vector3());
  const whole = new T.Box3().setFromPoints(arms.flatMap((arm) => Object.values(arm.reach()).flat()));
  const eye = new Eye(viewer, scene.planar ? new T.Vector3(0, -1e-4, 1) : towards(tip, whole), scene.planar);
  const { points, extent, ground } = inSight(arms, paths.flat(), eye);
  const shown = new T.Box3().setFromPoints(points), center = shown.getCenter(new T.Vector3());
  light(viewer, center, shown.getSize(new T.Vector3()).length() * 0.6, eye);
  byId("scale-note").textContent = `grid ${inMetres(floor(viewer, center, ground, extent))}`;
  const ways = drawWays(arms, paths, scene, extent);
  const [left, right] = eye.span(points, "right"), [low, high] = eye.span(points, "up");
  const panes = new Panes(viewer, eye, arms, (right - left) / (high - low));

  // ---- what is shown at each time
  const clock = new Clock(cycles, scene.seconds, () => show()), box = (name) => byId(`show-${name}`);
  if (scene.pair && !scene.live) Card.frame(arms, scene);
  const toCycle = (number) => { clock.play(false); clock.seek(scene.cycles.findIndex((n) => n >= number) + 1); };
  const cards = scene.live ? [] : arms.map((arm) => new Card(arm, scene, toCycle));
  let tell = () => {};
  function show() {
    const cycle = Math.min(Math.floor(clock.time), cycles - 1), part = clock.time - cycle, done = scene.cycles[cycle] - (part >= 1 ? 0 : 1);
    for (const arm of arms) {
      if (!scene.live || !api.received) arm.stand(cycle, part);
      arm.ghost.visible = box("ghost").checked;
      if (arm.traces) arm.traces.visible = box("traces").checked;
      arm.showDrift(box("drift").checked);
      if (!arm.past) continue;
      const past = scene.cycles[cycle] - 1 + part >= arm.data.broken.at;
      arm.past.node.visible = past;
      arm.mark(arm.past.node.position);
      arm.notice.textContent = past ? arm.data.broken.words : "";
    }
    if (scene.live) { viewer.set_dirty(); return; }
    for (const { arm, which, limb, trace, ball } of ways) { trace.show(cycle, part); arm.point(which, limb, arm.now.frame, arm.now.f, ball.node.position); }
    for (const card of cards) card.show(done, cycle, part);
    tell(done, part);
    viewer.set_dirty();
  }
  function resize() {
    panes.layout();
    if (!eye.touched) eye.fit(points, panes.size);
    show();
  }
  const view = {
    reset() { viewer.controls.reset(); eye.touched = false; resize(); },
    set(name, on) { box(name).checked = on; byId("drift-note").hidden = !box("drift").checked; show(); },
    turn(...way) { eye.turn(...way); },
  };
  tell = connect(clock, view, last);
  document.body.classList.toggle("live", Boolean(scene.live));
  if (scene.live) follow(arms, viewer.camera, show);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", () => { forgetTones(); panes.colour(); show(); });
  if (window.parent !== window) { // inside another page the wheel scrolls that page, unless the picture has the focus
    viewer.controls.enableZoom = false;
    byId("panes").addEventListener("focus", () => { viewer.controls.enableZoom = true; });
    byId("panes").addEventListener("blur", () => { viewer.controls.enableZoom = false; });
  }
  byId("picture").addEventListener("pointerdown", () => byId("panes").focus());
  new ResizeObserver(resize).observe(byId("panes"));
  resize();

  let before = performance.now(), late = 0;
  document.addEventListener("visibilitychange", () => { before = performance.now(); });
  (function tick(now) {
    const passed = Math.max(now - before, 0) / 1000;
    before = now;
    // no graphics card: after some late pictures in a row, do without shadows and draw fewer pixels
    late = (clock.playing || scene.live) && passed > 0.14 ? late + 1 : 0;
    if (late === 8) { viewer.scene.traverse((node) => { if (node.isLight) node.castShadow = false; }); viewer.renderer.setPixelRatio(0.75); resize(); }
    clock.pass(passed);
    if (viewer.needs_render) viewer.render();
    requestAnimationFrame(tick);
  })(before);

  // For tests, and for anyone at the console.
  Object.defineProperties(api, { time: { get: () => clock.time }, playing: { get: () => clock.playing } });
  const place = (k, name) => arms[k].moving.find((node) => node.name === name) || arms[k].still.find((node) => node.name === name);
  Object.assign(api, {
    viewer, cycles, took: performance.now() - start,
    seek: (time) => clock.seek(time),
    set: view.set, turn: view.turn,
    play: () => clock.play(true),
    pause: () => clock.play(false),
    meshes: (k) => arms[k].meshes.length,
    placement: (k, name) => { place(k, name).updateMatrix(); return place(k, name).matrix.toArray(); },
    picture: () => { viewer.render(); return viewer.renderer.domElement.toDataURL(); },
    // where a pane is in the picture: left, top, width, height, in parts of the whole
    pane: (k) => { const { clientWidth: w, clientHeight: h } = byId("panes"), { left: a, top: b, width: c, height: d } = panes.place(k); return [a / w, b / h, c / w, d / h]; },
    // how far a body is off where it was in cycle 1, m, and its colour
    drift: (k, name) => [arms[k].drift(arms[k].moving.indexOf(place(k, name))), "#" + [place(k, name).children[0].material].flat()[0].color.getHexString()],
    materials: (change) => { for (const arm of arms) for (const mesh of arm.meshes) [mesh.material].flat().forEach((m) => { change(m); m.needsUpdate = true; }); viewer.set_dirty(); },
  });
  const problems = [...scene.problems, ...api.errors];
  say(problems.length ? `Not everything could be drawn; the motion is complete. ${problems.join(". ")}` : "", problems.length > 0);
  byId("notice").addEventListener("click", () => { byId("notice").hidden = true; });
  if (problems.length) setTimeout(() => { byId("notice").hidden = true; }, 12000);
  viewer.render();
  api.ready = true;
  if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches && location.hash !== "#paused" && !scene.live) clock.open();
}

main().catch((error) => {
  window.repctl.errors.push(String(error && error.stack || error));
  say("This page could not be shown: " + error.message, true);
});
