// Where what the task has is drawn: on the workpiece, or in the root without one.

import { vector } from "./loops.js";

export class Workpiece {
  // `base`: of a frame whose task is relative to a workpiece, see kinematics.js
  constructor({ base }, arms, panes) {
    Object.assign(this, { arms, panes, home: placementOf(base) });
  }

  // A point, on the workpiece as it stands at the start.
  drawn(x) {
    return vector(x).applyMatrix4(this.home);
  }

  // The same of paths, null among them left out.
  lines(paths) {
    return paths.filter(Boolean).map((path) => path.map((p) => this.drawn(p).toArray()));
  }

  // A direction.
  direction(v) {
    return v.clone().transformDirection(this.home);
  }

  // Points of the scene, with the workpiece as at the start, as the task has them.
  points(path) {
    const back = this.home.clone().invert();
    return path.map((p) => p.clone().applyMatrix4(back).toArray());
  }

  // The placement in pane k of what the task is relative to, as it now stands there.
  placement(k) {
    const { carrier } = this.arms[k];
    if (!carrier) return this.home;
    carrier.updateMatrix();
    return carrier.matrix.clone().multiply(this.home);
  }

  // A point, as it now stands there; and where it is seen, px.
  now(k, x) {
    return vector(x).applyMatrix4(this.placement(k));
  }
  seen(k, x) {
    return this.panes.seen(k, this.now(k, x));
  }

  // The line of sight through a place of pane k, as the task has it.
  sight(k, place) {
    return this.panes.sight(k, place).applyMatrix4(this.placement(k).invert());
  }
}

// The placement of a base as a matrix of the scene; of none, the unit matrix.
function placementOf(base) {
  const M = new MeshCat.THREE.Matrix4();
  if (!base) return M;
  const { R, p } = base;
  return M.set(...[0, 1, 2].flatMap((i) => [...R.subarray(3 * i, 3 * i + 3), p[i]]), 0, 0, 0, 1);
}
