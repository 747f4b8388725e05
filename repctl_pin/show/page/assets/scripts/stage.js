// What stands on the stage: the arms, their ways, the light, and a camera that sees them all.

import { ArmView, cornersOf, pointAt } from "./arm/arm.js";
import { drawCover, EdgeLine } from "./arm/cover.js";
import { byId, summed } from "./dom.js";
import { clearest, Eye, towards } from "./arm/eye.js";
import { formatLength } from "./numbers.js";
import { Panes } from "./chrome/panes.js";
import { TableMarks } from "./arm/table.js";
import { drawPaths, drawTraces } from "./arm/traces.js";
import { floor, light } from "./arm/viewer.js";
import { unpack } from "./unpack.js";

export async function setStage(viewer, scene) {
  const T = MeshCat.THREE;
  const motion = summed(await unpack("motion"), scene.series, scene.resolution);
  const F = scene.perCycle;
  const frames = F * scene.cycles.length;
  let at = 0;
  const arms = scene.arms.map((data) => {
    const arm = new ArmView(viewer, data, motion, at, frames, F);
    at = arm.end;
    return arm;
  });
  if (!scene.live) pointAt(arms, (s) => arms[0].data.part[s]);
  if (scene.weights) {
    scene.own.laws.at(-1)[0].chart.weights = motion.subarray(at, at + scene.weights);
    at += scene.weights;
  }
  const paths = scene.paths.map((count) =>
    Array.from({ length: count }, () => {
      const p = new T.Vector3().fromArray(motion, at);
      at += 3;
      return p;
    }),
  );

  // what is covered is drawn in pale, and is no path
  const edges = scene.cover ? paths.splice(0, 1) : [];

  if (scene.joints)
    for (const arm of arms) {
      const { names, perCycle, scale, at: times } = scene.joints;
      const n = names.length;
      const count = scene.cycles.length * perCycle * n;
      const values = motion.subarray(at, at + count).map((v) => v / scale);
      arm.study.run.joints = { at: times, count: perCycle, n, values };
      arm.use(arm.run, arm.study.start);
      at += count;
    }

  // the bodies as they were sent are not drawn themselves
  const library = viewer.scene_tree.find(["library"]).object;
  library.parent.remove(library);

  const tips = arms.flatMap((arm) =>
    Array.from({ length: arm.chains }, (_, k) => [
      arm.point("tip", k, 0),
      arm.point("tip", k, F >> 1),
    ]).flat(),
  );
  const tip = new T.Box3().setFromPoints(tips).getCenter(new T.Vector3());
  const whole = new T.Box3().setFromPoints(
    arms.flatMap((arm) => Object.values(arm.reach()).flat()),
  );
  const eye = new Eye(
    viewer,
    scene.planar
      ? new T.Vector3(0, -1e-4, 1)
      : scene.live
        ? towards(tip, whole)
        : clearest(arms, towards(tip, whole)),
    scene.planar,
  );
  const { points, near, extent, ground } = inSight(arms, paths.flat(), eye);
  const shown = new T.Box3().setFromPoints(points);
  const center = shown.getCenter(new T.Vector3());
  light(viewer, center, shown.getSize(new T.Vector3()).length() * 0.6, eye);
  byId("scale-note").textContent = `grid ${formatLength(floor(viewer, center, ground, extent))}`;
  if (scene.cover) drawCover(arms, scene, edges);
  const marks = scene.cover && new TableMarks(arms, scene, ground);
  if (marks) {
    points.push(...marks.arc, ...marks.words);
    near.push(...marks.words);
  }
  // on the page of a cell, F alone ends: in its pane is where, and its edge at that height
  const line = (drawn, strokes = []) => {
    for (const arm of arms) {
      const held = !scene.cover || arm === arms.at(-1);
      drawPaths(arm, drawn, extent, held ? strokes : []);
      if (scene.cover && arm.stop)
        new EdgeLine(arm.paths, scene.cover).show(arm.stop.node.position);
    }
  };
  line(paths);
  const drawnTraces = () => drawTraces(arms, scene, extent);
  const [left, right] = eye.span(points, "right");
  const [low, high] = eye.span(points, "up");
  return {
    arms,
    marks,
    paths,
    line,
    drawnTraces,
    extent,
    eye,
    points,
    near,
    panes: new Panes(viewer, eye, arms, (right - left) / (high - low)),
  };
}

// The points that the camera must see: all of the robot, where that leaves the arm large; else its
// whole width, if it is not a hall, and what is near the arm.
function inSight(arms, path, eye) {
  const T = MeshCat.THREE;
  const reach = arms.map((arm) => arm.reach());
  const moving = reach.flatMap((c) => c.moving);
  const still = reach[0].still;
  const near = new T.Box3().setFromPoints([...moving, ...path]);
  const whole = new T.Box3().setFromPoints([...moving, ...still]);
  if (near.isEmpty()) near.setFromPoints([...still, new T.Vector3()]);
  const extent = near.getSize(new T.Vector3()).length() || 1;
  const across = (box, axis) => {
    const [a, b] = eye.span(cornersOf(box), axis);
    return b - a;
  };
  const room = near.clone().expandByScalar(0.2 * extent);
  const [low, high] = eye.span(cornersOf(room), "up");
  const wide = across(whole, "right") < 3 * extent;
  const all =
    across(whole, "up") <
    Math.max(
      1.45 * across(near, "up"),
      wide ? Math.max(1.3 * across(near, "right"), across(whole, "right")) : 0,
    );
  const level = (p) =>
    p.clone().addScaledVector(eye.up, Math.min(Math.max(p.dot(eye.up), low), high) - p.dot(eye.up));
  const kept = (p) => (all ? p : wide ? level(p) : room.clampPoint(p, new T.Vector3()));
  return {
    points: [...moving, ...path, ...still.map(kept)],
    near: [...moving, ...path, ...still.filter((p) => room.containsPoint(p))],
    extent,
    ground: whole.min.z,
  };
}
