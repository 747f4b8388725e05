// Time: in cycles, from 0 at the start to the number of shown cycles at the end.

window.repctl = { ready: false, errors: [] };

async function main() {
  const scene = JSON.parse(byId("scene").textContent), api = window.repctl;
  const notice = byId("notice"), say = (text, trouble) => {
    byId("notice-text").textContent = text;
    notice.hidden = !text;
    notice.classList.toggle("trouble", Boolean(trouble));
  };
  byId("title").textContent = scene.title;
  byId("caption").textContent = scene.caption;
  byId("pane").setAttribute("aria-label", `Animation of ${scene.arms.map((a) => a.label).join(" and ")}: ${scene.title}`);
  if (typeof DecompressionStream === "undefined") { say("This page needs a browser of 2023 or newer.", true); return; }
  let viewer;
  try {
    viewer = await openViewer(scene, api.errors, (part) => { byId("loaded").value = part; });
  } catch (error) {
    api.errors.push(String(error));
    say("The 3D view could not start (" + error.message + "). Is WebGL switched on in this browser?", true);
    return;
  }
  const T = MeshCat.THREE, bytes = await unpack("motion"), motion = new Float32Array(bytes.buffer, 0, bytes.length / 4);
  const F = scene.perCycle, cycles = scene.cycles.length, frames = F * cycles;
  await picturesLoaded(viewer.scene);
  let at = 0;
  const arms = scene.arms.map((arm) => { const view = new ArmView(viewer, arm, motion, at, frames); at = view.end; return view; });
  const paths = scene.paths.map((count) => Array.from({ length: count }, () => { const p = new T.Vector3().fromArray(motion, at); at += 3; return p; }));
  const path = paths.flat();

  // ---- where everything stands
  const corners = arms.map((arm) => arm.corners());
  const near = new T.Box3().setFromPoints([...corners.flatMap((c) => c.moving), ...path]);
  if (near.isEmpty()) near.setFromPoints([...corners.flatMap((c) => c.still), new T.Vector3()]);
  const extent = near.getSize(new T.Vector3()).length() || 1;
  const whole = new T.Box3().setFromPoints(corners.flatMap((c) => [...c.moving, ...c.still]));
  const tip = new T.Box3().setFromPoints(arms.flatMap((a) => Array.from({ length: a.limbs }, (_, k) => [a.point("tip", k, 0), a.point("tip", k, F >> 1)]).flat())).getCenter(new T.Vector3());
  const eye = new Eye(viewer, scene.planar ? new T.Vector3(0, -1e-4, 1) : towards(tip, whole));
  const spans = corners.map((c) => eye.span([...c.moving, ...c.still, ...path], "right"));
  const widest = Math.max(...spans.map(([a, b]) => b - a)), pane = byId("pane"), shape = pane.clientHeight / Math.max(pane.clientWidth, 1);
  // all of the robot, where that leaves the arm large; else its whole width, if it is not a hall, and what is near the arm
  const across = (box, axis) => { const [a, b] = eye.span(cornersOf(box), axis); return b - a; }, tall = (box) => across(box, "up");
  const room = near.clone().expandByScalar(0.2 * extent), [low, high] = eye.span(cornersOf(room), "up"), wide = across(whole, "right") < 3 * extent;
  const all = tall(whole) < Math.max(1.45 * tall(near), wide ? 1.3 * widest * arms.length * shape : 0);
  const level = (p) => p.clone().addScaledVector(eye.up, Math.min(Math.max(p.dot(eye.up), low), high) - p.dot(eye.up));
  const nearby = (p) => (wide ? level(p) : room.clampPoint(p, new T.Vector3()));
  const own = corners.map((c) => [...c.moving, ...(all ? c.still : c.still.map(nearby))]);
  const wished = (0.8 * tall(all ? whole : room)) / shape / arms.length - widest;
  const gap = Math.min(Math.max(wished, 0.1 * widest), 0.6 * widest);
  const total = spans.reduce((sum, [a, b]) => sum + b - a + gap, -gap);
  let edge = -total / 2;
  arms.forEach((arm, k) => {
    const [a, b] = spans[k];
    if (arm.data.offset) arm.group.position.fromArray(arm.data.offset);
    else arm.group.position.copy(eye.right).multiplyScalar(edge - a);
    edge += b - a + gap;
  });
  const points = arms.flatMap((arm, k) => [...own[k], ...path].map((p) => p.clone().add(arm.group.position)));
  const shown = new T.Box3().setFromPoints(points), center = shown.getCenter(new T.Vector3()), size = shown.getSize(new T.Vector3()).length();
  light(viewer, center, size * 0.6, eye);
  const step = floor(viewer, center, whole.min.z, extent, size);
  byId("scale-note").textContent = `grid ${inMetres(step)}`;
  const tops = own.map((list, k) => {
    const [a, b] = eye.span(list, "right"), [, top] = eye.span(list, "up"), middle = shown.getCenter(new T.Vector3()).sub(arms[k].group.position);
    return middle.addScaledVector(eye.right, (a + b) / 2 - middle.dot(eye.right)).addScaledVector(eye.up, top - middle.dot(eye.up)).add(arms[k].group.position);
  });

  // ---- path, traces, start pose
  const thick = 0.0026 * extent, traces = [];
  const pieces = (arm, which, limb) => scene.cycles.map((_, c) => Array.from({ length: F }, (_, i) => arm.point(which, limb, c * F + i)));
  for (const arm of arms) {
    const shade = driftShade(arm.data, scene), full = new T.Color(arm.data.color), ink = new T.Color("#3d4854");
    for (const way of paths) if (way.length > 1) new Trace(arm.group, [way], 0.75 * thick, () => ink).show(1, 0);
    arm.traces = new T.Group();
    arm.group.add(arm.traces);
    for (let limb = 0; limb < arm.limbs; limb++)
      for (const [which, width, ball, tone] of [["tip", 1.35, 3.4, () => full], ["elbow", 1, 2.8, shade]])
        traces.push({ arm, which, limb, trace: new Trace(arm.traces, pieces(arm, which, limb), width * thick, tone), ball: new Marker(arm.traces, ball * thick, arm.data.color) });
    arm.makeGhost();
  }
  // the colour of what has drifted; a tenth of a millimetre is not shown
  const drifts = arms.map((arm) => arm.measureDrift(cycles, F)), most = Math.max(...drifts), drifting = most > 1e-4;
  if (drifting) byId("drift-note").append("a body off its start by 0", element("i", { style: `--arm: ${arms[drifts.indexOf(most)].data.color}` }), inMetres(most));
  byId("drift-switch").hidden = !drifting;
  const cards = arms.map((arm) => new Card(byId("cards"), arm.data, arm, scene));
  cards.forEach((card, k) => { card.shade = driftShade(arms[k].data, scene); });
  Card.flatten(cards, eye.right, eye.up);
  const labels = arms.map((arm) => element("div", { class: "arm-label", style: `--arm: ${arm.data.color}` }, element("span", { class: "chip" }), arm.data.label));
  byId("labels").append(...labels);

  // ---- drawing
  const traceBox = byId("show-traces"), ghostBox = byId("show-ghost"), driftBox = byId("show-drift");
  let time = 0, playing = false, speed = 1, touched = false, rest = 0;
  viewer.controls.addEventListener("start", () => { touched = true; });
  function render() {
    viewer.render();
    const { clientWidth: w, clientHeight: h } = byId("pane"), v = new T.Vector3();
    labels.forEach((label, k) => {
      v.set(tops[k].x, tops[k].z, -tops[k].y).project(viewer.camera);
      const x = Math.min(Math.max((0.5 + v.x / 2) * w, 60), w - 60), y = Math.max((0.5 - v.y / 2) * h - 14, 44);
      label.style.transform = `translate(${x}px, ${y}px) translate(-50%, -100%)`;
    });
  }
  function show() {
    const cycle = Math.min(Math.floor(time), cycles - 1), part = time - cycle;
    const row = Math.min(part * (F - 1), F - 1), i = Math.min(Math.floor(row + 1e-9), F - 1), f = Math.max(0, row - i);
    const frame = cycle * F + i;
    for (const arm of arms) { arm.pose(frame, f); arm.showDrift(cycle, part, driftBox.checked && drifting ? most : 0); }
    for (const { arm, which, limb, trace, ball } of traces) { trace.show(cycle, part); arm.point(which, limb, frame, f, ball.node.position); }
    const completed = part >= 1 ? scene.cycles[cycle] : cycle ? scene.cycles[cycle] - 1 : 0;
    for (const card of cards) card.show(completed, cycle, part);
    const drifts = scene.arms[0].drift.length;
    byId("clock").textContent = `cycle ${scene.cycles[cycle]} of ${drifts}`;
    byId("scrub").value = time;
    viewer.set_dirty();
  }
  function seek(cyclesIn) { time = Math.min(Math.max(Number(cyclesIn) || 0, 0), cycles); rest = 0; show(); }
  function play(on) { playing = on; document.body.classList.toggle("playing", on); byId("play").setAttribute("aria-label", on ? "Pause" : "Play"); }
  function resize() {
    viewer.set_3d_pane_size();
    if (!touched) eye.fit(points);
    for (const card of cards) card.done = -1;
    show();
  }

  // ---- hands
  byId("scrub").max = cycles;
  if (cycles > 1) for (let c = 0; c <= cycles; c++) byId("ticks").append(element("i", { style: `left: ${(100 * c) / cycles}%` }));
  byId("play").addEventListener("click", () => play(!playing));
  byId("scrub").addEventListener("input", (event) => { play(false); seek(event.target.value); });
  byId("speed").addEventListener("change", (event) => { speed = Number(event.target.value); });
  byId("view").addEventListener("click", () => { touched = false; viewer.controls.reset(); resize(); });
  const setTraces = (on) => { traceBox.checked = on; for (const arm of arms) arm.traces.visible = on; viewer.set_dirty(); };
  const setGhost = (on) => { ghostBox.checked = on; for (const arm of arms) arm.ghost.visible = on; viewer.set_dirty(); };
  const setDrift = (on) => { driftBox.checked = on; byId("drift-note").hidden = !on; show(); };
  traceBox.addEventListener("change", () => setTraces(traceBox.checked));
  ghostBox.addEventListener("change", () => setGhost(ghostBox.checked));
  driftBox.addEventListener("change", () => setDrift(driftBox.checked));
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, button") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === " ") { event.preventDefault(); play(!playing); }
    const hop = { ArrowRight: 1 / 60, ArrowLeft: -1 / 60 }[event.key];
    if (hop) { play(false); seek(time + hop); }
  });
  new ResizeObserver(resize).observe(byId("pane"));
  resize();

  let before = performance.now(), late = 0;
  (function tick(now) {
    const passed = Math.min(Math.max(now - before, 0), 100) / 1000;
    // no graphics card: after some late pictures in a row, do without shadows and draw fewer pixels
    late = playing && now - before > 140 ? late + 1 : 0;
    if (late === 8) { viewer.scene.traverse((node) => { if (node.isLight) node.castShadow = false; }); viewer.renderer.setPixelRatio(0.75); resize(); }
    before = now;
    if (playing && time >= cycles) { rest += passed; if (rest > 1.4) { time = 0; rest = 0; show(); } }
    else if (playing) { time = Math.min(time + (speed * passed) / scene.seconds, cycles); show(); }
    if (viewer.needs_render) render();
    requestAnimationFrame(tick);
  })(before);

  // For tests, and for anyone at the console.
  Object.defineProperties(api, { time: { get: () => time }, playing: { get: () => playing } });
  Object.assign(api, {
    viewer, cycles, seek, setTraces, setGhost, setDrift,
    play: () => play(true),
    pause: () => play(false),
    meshes: (k) => arms[k].meshes.length,
    placement: (k, shape) => { viewer.scene.updateMatrixWorld(true); const place = arms[k].group.children.find((c) => c.name === shape); return place.matrix.toArray(); },
    picture: () => { render(); return viewer.renderer.domElement.toDataURL(); },
    // columns of the picture, 0 to 1, between which an arm stands
    columns: (k) => { const v = new T.Vector3(), xs = [...own[k], ...path].map((p) => { v.copy(p).add(arms[k].group.position); v.set(v.x, v.z, -v.y).project(viewer.camera); return 0.5 + v.x / 2; }); return [Math.min(...xs), Math.max(...xs)]; },
    // how far a body is off its start, m, and its colour
    drift: (k, shape) => { const cycle = Math.min(Math.floor(time), cycles - 1), b = arms[k].moving.findIndex((place) => place.name === shape); return [arms[k].drift(b, cycle, time - cycle), "#" + arms[k].paints[b][0].material.color.getHexString()]; },
    materials: (change) => { for (const arm of arms) for (const mesh of arm.meshes) [mesh.material].flat().forEach((m) => { change(m); m.needsUpdate = true; }); viewer.set_dirty(); },
  });
  const problems = [...scene.problems, ...api.errors];
  say(problems.length ? `Not everything could be drawn; the motion is complete. ${problems.join(". ")}` : "", problems.length > 0);
  notice.addEventListener("click", () => { notice.hidden = true; });
  if (problems.length) setTimeout(() => { notice.hidden = true; }, 12000);
  render();
  api.ready = true;
  play(!window.matchMedia("(prefers-reduced-motion: reduce)").matches && location.hash !== "#paused");
}

// Look at the arm from the front, from the side on which it works, a little from above.
function towards(tip, whole) {
  const middle = whole.getCenter(new MeshCat.THREE.Vector3()), reach = { x: tip.x - middle.x, y: tip.y - middle.y };
  const heading = Math.hypot(reach.x, reach.y) > 0.05 ? Math.atan2(reach.y, reach.x) : 0;
  const turn = heading > 0.15 ? 0.75 : -0.75, rise = 0.33;
  const azimuth = Math.abs(heading) > 1.2 ? heading + (heading > 0 ? -0.75 : 0.75) : turn;
  return new MeshCat.THREE.Vector3(Math.cos(azimuth) * Math.cos(rise), Math.sin(azimuth) * Math.cos(rise), Math.sin(rise));
}

main().catch((error) => {
  window.repctl.errors.push(String(error && error.stack || error));
  byId("notice").hidden = false;
  byId("notice").classList.add("trouble");
  byId("notice-text").textContent = "This page could not be shown: " + error.message;
});
