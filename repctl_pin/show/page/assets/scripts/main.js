// The page: what is loaded, and what happens when.

import { keep, readAddress } from "./chrome/address.js";
import { fullDrift, GAIN, pointAt, referenceOf } from "./arm/arm.js";
import { Callouts } from "./chrome/callouts.js";
import { Chart } from "./chrome/chart.js";
import { Clock } from "./chrome/clock.js";
import { openConsole } from "./chrome/console.js";
import { connect, rule } from "./chrome/controls.js";
import { byId, finished, forgetTones, setText, whenResized } from "./dom.js";
import { follow } from "./live/live.js";
import { formatLength } from "./numbers.js";
import { Own } from "./own/own.js";
import { printable, still } from "./chrome/paper.js";
import { drawPlain } from "./chrome/plain.js";
import { savable } from "./chrome/save.js";
import { setStage } from "./stage.js";
import { cleared } from "./arm/traces.js";
import { openViewer } from "./arm/viewer.js";

const LIVE_FULL = 0.1; // m off, where a body of a running loop is coloured in full

window.repctl = { ready: false, errors: [] };

function notify(text, trouble) {
  byId("notice-text").textContent = text;
  byId("notice").hidden = !text;
  byId("notice").classList.toggle("trouble", Boolean(trouble));
}

// Inside another page the wheel scrolls that page, unless the picture has the focus.
function releaseWheel(viewer) {
  byId("picture").addEventListener(
    "wheel",
    () => {
      viewer.controls.enableZoom = document.hasFocus() && document.activeElement === byId("panes");
    },
    { capture: true },
  );
}

const vectors = (points) => points.map((p) => new MeshCat.THREE.Vector3(...p));

// Whether a place on a body is another than this one.
const isElsewhere = (one, other) =>
  one !== other && !(one && other && one.k === other.k && one.point.equals(other.point));

// Let time pass, a picture at a time; a machine that is late loses pictures, not time.
function run(clock, viewer, live, resize) {
  let before = performance.now();
  let late = 0;
  let plain = false;
  document.addEventListener("visibilitychange", () => {
    before = performance.now();
  });
  (function tick(now) {
    const passed = Math.max(now - before, 0) / 1000;
    before = now;
    // no graphics card: after some late pictures in a row, or two very late ones, do without
    // shadows and draw fewer pixels
    late = (clock.playing || live) && passed > 0.14 ? late + Math.min(passed / 0.14, 4) : 0;
    if (late >= 8 && !plain) {
      plain = true;
      viewer.scene.traverse((node) => {
        if (node.isLight) node.castShadow = false;
      });
      viewer.renderer.setPixelRatio(0.75);
      resize();
    }
    // the end, of which the headline speaks, is seen first, however late pictures are
    clock.pass(clock.opening ? Math.min(passed, 0.1) : passed);
    if (viewer.needs_render) viewer.render();
    requestAnimationFrame(tick);
  })(before);
}

// Bodies are placed by a texture of floating-point numbers, see arm/bodies.js.
function requireTextures({ capabilities }) {
  if (!capabilities.floatVertexTextures)
    throw new Error("its WebGL has no floating-point textures for vertices");
}

async function main() {
  const scene = JSON.parse(byId("scene").textContent);
  const api = window.repctl;
  const start = performance.now();
  let viewer;
  try {
    viewer = await openViewer(api.errors, (part) => {
      byId("loaded").value = part;
    });
    requireTextures(viewer.renderer);
  } catch (error) {
    api.errors.push(String(error));
    if (!scene.live) {
      byId("picture").replaceChildren();
      await drawPlain(scene, viewer ? error.message : "WebGL is off here");
      notify("");
      return;
    }
    notify(
      "The 3D view could not start (" + error.message + "). Is WebGL switched on in this browser?",
      true,
    );
    return;
  }
  const { arms, marks, paths, line, drawnTraces, extent, eye, points, near, panes } =
    await setStage(viewer, scene);
  // labels have no places until the first picture, which waits for the loop of an address
  panes.hide(true);
  const study = { ...scene, last: scene.arms[0].drift.length };

  const compare = () => {
    const found = scene.live ? null : referenceOf(arms);
    for (const arm of arms)
      Object.assign(arm, { repeats: arm === found, reference: arm === found ? null : found });
  };
  compare();

  // ---- what is shown at each time
  const clock = Object.assign(new Clock(scene.cycles.length, scene.seconds, () => show()), {
    last: study.last,
  });
  const box = (name) => byId(`show-${name}`);
  const chart = scene.live
    ? null
    : new Chart(arms, scene, (time) => {
        clock.play(false);
        clock.seek(time);
      });
  const callouts = scene.live ? null : new Callouts(panes, scene);
  const address = readAddress();
  let tell = () => {};
  let traces = [];
  let traced = null; // the place that is pointed at, of which they are
  function* trace() {
    traced = arms[0].spot;
    traces = yield* drawnTraces();
  }
  if (!scene.live) finished(trace());
  let drawing = false;
  let lines = []; // what a visitor's loop adds to what is seen: its points, and where it stops
  let own = null;
  let wide = false; // whether the view was widened for a visitor's loop
  let unfitted = false; // whether the stage has another size since a hand was led
  function show() {
    if (drawing) return;
    const { cycles } = clock;
    const leading = own && own.lead;
    const full = scene.live ? LIVE_FULL : fullDrift(arms);
    const cycle = Math.min(Math.floor(clock.time), cycles - 1);
    const part = clock.time - cycle;
    // the grey arm stands at the start at the end of a cycle, and while the slider moves the arms
    const atEnd = leading ? scene.leading === "slides" : part === 0 || part >= 1;
    setText(byId("drift-to"), `${formatLength(full)}${scene.live ? " and more" : ""}`);
    const done = scene.cycles[cycle] - (part >= 1 ? 0 : 1);
    for (const arm of arms) {
      if (!leading && !scene.live) arm.measureEnds();
      if (leading) arm.stand(1, 0);
      else if (!scene.live || !api.received) arm.stand(cycle, part);
      arm.ghost.visible = box("ghost").checked;
      if (arm.traces) arm.traces.visible = box("traces").checked;
      arm.showFan(box("fan").checked);
      arm.showDrift(box("drift").checked, full);
      if (scene.live) continue;
      for (const rim of arm.rims)
        rim.visible = box("callouts").checked && !arm.lost && !scene.failure;
      const { broken } = arm.data;
      const past = Boolean(arm.past) && scene.cycles[cycle] - 1 + part >= broken.at;
      // without callouts, the label says what else stands at the red ball
      setText(arm.notice, past && !box("callouts").checked ? broken.words : "");
      if (!arm.past) continue;
      // the place where a motion ends is marked from the beginning; where a visitor's loop stops
      // is a ball already, so one is added only once the arm fails elsewhere
      const fails = arm.data.lost < Infinity;
      arm.past.node.visible = scene.failure ? past && fails : past || fails;
      arm.mark(arm.past.node.position);
    }
    if (marks) marks.follow(arms.at(-1), own, cycle, part);
    if (scene.live || leading) {
      if (leading) callouts.say(atEnd);
      viewer.set_dirty();
      return;
    }
    // the trace is of the part that the numbers are of
    if (isElsewhere(traced, arms[0].spot)) finished(trace());
    for (const one of traces) {
      const { arm, which, chain } = one;
      one.trace.show(cycle, part);
      one.ball.node.position.copy(arm.drawn(which, chain, arm.now.frame, arm.now.f));
    }
    const times = chart.show(done, cycle, part);
    callouts.say(atEnd, times, [cycle, Number(part >= 1)]);
    tell(done, part);
    keep(clock, eye, own);
    viewer.set_dirty();
  }
  // there the arm is seen, not all of its robot
  const small = window.matchMedia("(max-width: 640px), (max-height: 480px)");
  function resize() {
    panes.layout();
    document.body.style.setProperty("--tall", `${byId("stage").clientHeight}px`);
    if (own) own.reserve();
    unfitted = Boolean(own && own.lead);
    if (!eye.touched && !unfitted)
      eye.fit([...(small.matches ? near : points), ...lines], panes.size);
    if (chart && !unfitted) chart.reserve();
    show();
  }
  const view = {
    reset() {
      viewer.controls.reset();
      viewer.camera.zoom = 1;
      eye.touched = false;
      resize();
    },
    set(name, on) {
      box(name).checked = on;
      byId("drift-note").hidden = !box("drift").checked;
      byId("panes").classList.toggle("quiet", !box("callouts").checked);
      show();
    },
    turn(...way) {
      eye.turn(...way);
    },
    joints(on) {
      document.body.classList.toggle("joints", on);
      resize();
    },
    enlarge(on) {
      for (const arm of arms) arm.gain = on ? GAIN : 1;
      byId("enlarge").setAttribute("aria-pressed", String(on));
      document.body.classList.toggle("enlarged", on);
      finished(trace());
      show();
    },
  };
  // beside a pane, or under the row of what is said in it
  const isOutside = (p) => {
    const { x, y } = panes.seen(0, p);
    const { width, height } = panes.place(0);
    const rim = 0.04 * width; // a ball at the edge would be cut
    return !(x >= rim && y >= panes.size.above && x <= width - rim && y <= height);
  };
  const offerEnlarge = () => {
    const most = Math.max(...scene.arms.flatMap(({ off }) => off.flat()));
    byId("enlarge").hidden = scene.live || !(most >= 1e-4 && most < 0.01);
  };
  offerEnlarge();
  tell = connect(clock, view);
  // another run in the player, of a visitor's loop or of the study, at its end; pauses, and shows
  // nothing of it until all is drawn
  function* play(cycles, perCycle, seconds, runs, paths_, strokes) {
    player.plain();
    arms.forEach((arm, k) => arm.use(...runs[k]));
    Object.assign(scene, { cycles, perCycle, arms: arms.map((arm) => arm.data) });
    compare();
    Object.assign(clock, {
      cycles: cycles.length,
      last: cycles.at(-1),
      seconds,
      time: cycles.length,
    });
    drawing = true;
    traces = [];
    try {
      yield;
      line(paths_, strokes);
      lines = strokes ? [...paths_.flat(), ...strokes.slice(0, 1).map(([stop]) => stop)] : [];
      yield* trace();
      rule(clock);
      offerEnlarge();
      panes.inRows();
      // a loop that leads out of the picture is seen whole, and the study as before
      const widened = lines.some(isOutside);
      if (unfitted || widened || wide) resize();
      wide = widened;
      yield;
      chart.reserve();
    } finally {
      drawing = false;
    }
  }
  const player = {
    plain() {
      if (byId("enlarge").getAttribute("aria-pressed") === "true") view.enlarge(false);
    },
    clear(left) {
      line(left.map(vectors));
      for (const arm of arms) arm.traces = cleared(arm.group, arm.traces);
    },
    play(result) {
      clock.play(false);
      return play(
        Array.from({ length: result.cycles }, (_, c) => c + 1),
        result.perCycle,
        result.seconds,
        result.runs.map((one) => [one]),
        ...[result.paths, result.strokes].map((lines) => lines.map(vectors)),
      );
    },
    study() {
      scene.part = study.part;
      finished(
        play(
          study.cycles,
          study.perCycle,
          study.seconds,
          arms.map((arm) => [arm.study.run, arm.study.start]),
          paths,
        ),
      );
      pointAt(arms, (s) => study.arms[0].part[s]);
      show();
    },
    show,
  };
  if (scene.own) own = new Own(scene.own, { arms, panes, scene, clock, extent, player, paths });
  document.body.classList.toggle("live", Boolean(scene.live));
  if (scene.live) follow(arms, panes, scene, extent, show);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", () => {
    forgetTones();
    panes.colour();
    show();
  });
  if (window.parent !== window) releaseWheel(viewer);
  byId("picture").addEventListener("click", () => byId("panes").focus({ preventScroll: true }));
  if (callouts)
    panes.drawn = () => {
      const spots = own ? own.rings.spots() : null;
      callouts.place(spots);
      if (own) own.rings.place(callouts.rooms, spots);
    };
  viewer.controls.addEventListener("end", () => keep(clock, eye, own));
  savable(viewer, clock, scene, arms);
  const paper = () => still(viewer, clock, arms, panes, resize);
  printable(paper);
  if (address.time !== null) clock.time = Math.min(Math.max(address.time, 0), clock.cycles);
  whenResized(byId("panes"), resize);
  resize();
  if (address.view) eye.stand(address.view);
  if (own && address.own) {
    await own.open(address.own, address.time ?? undefined);
    if (address.time !== null) clock.seek(Math.min(address.time, clock.cycles));
  }

  run(clock, viewer, scene.live, resize);
  openConsole(api, { viewer, clock, view, arms, panes, still: paper, own, scene });
  api.took = performance.now() - start;
  const problems = [...scene.problems, ...api.errors];
  notify(
    problems.length
      ? `Not everything could be drawn; the motion is complete. ${problems.join(". ")}`
      : "",
    problems.length > 0,
  );
  byId("notice").addEventListener("click", () => {
    byId("notice").hidden = true;
  });
  if (problems.length)
    setTimeout(() => {
      byId("notice").hidden = true;
    }, 12000);
  panes.hide(false);
  viewer.render();
  api.ready = true;
  if (
    !window.matchMedia("(prefers-reduced-motion: reduce)").matches &&
    !address.paused &&
    address.time === null &&
    !address.own &&
    !scene.live
  )
    clock.open();
}

main().catch((error) => {
  window.repctl.errors.push(String((error && error.stack) || error));
  notify("This page could not be shown: " + error.message, true);
});
