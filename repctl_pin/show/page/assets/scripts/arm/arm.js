// One arm: its bodies, where they stand at each frame, and its ghost: where the repeatable arm
// stands at the same instant, or else where this arm stood in cycle 1.

import { between, blended, setPose } from "./between_frames.js";
import { Bodies } from "./bodies.js";
import { hull, outlined, OUTLINE } from "./outline.js";
import { tone } from "../dom.js";
import { stepAbove } from "../numbers.js";

const LEAST_FULL = 0.05; // m off, of which colour is full, at least
const LEAST_ENLARGED = 1e-3; // the same where drift is drawn enlarged
export const GAIN = 50; // how many times as large a small drift is drawn
const SAME = 1e-4; // m, within which a body covers its ghost
const OF_ARM = 1;
const OF_GHOST = 2;
const OF_PART = 4; // bits of the stencil: where the arm is seen, its ghost, and the part in words

export class ArmView {
  constructor(viewer, data, motion, start, frames, perCycle) {
    const T = MeshCat.THREE;
    Object.assign(this, {
      data,
      chains: data.chains,
      rows: [],
      moving: [],
      still: [],
      part: [],
      gain: 1,
      difference: new Float64Array(16), // of two matrices
      reference: null,
      rims: [],
      rim: outlined({
        stencilWrite: true,
        stencilFunc: T.EqualStencilFunc,
        stencilFuncMask: OF_PART,
      }),
    });
    this.group = new T.Group();
    this.group.name = data.label;
    data.shapes.forEach((shape, s) => {
      const body =
        shape.body === null
          ? {}
          : viewer.scene_tree.find(["library", String(shape.body), "<object>"]).object;
      if (!body.isMesh) {
        if (!shape.pose) this.rows.push(null);
        return;
      } // it could not be read
      const mesh = new T.Mesh(
        body.geometry,
        shape.color === null ? copied(body.material) : paint(shape.color),
      );
      mesh.quaternion.copy(body.quaternion);
      mesh.scale.fromArray(shape.scale); // its own node: the placement above it stays rigid
      mesh.updateMatrix();
      mesh.matrixAutoUpdate = false;
      mesh.castShadow = mesh.receiveShadow = true;
      mesh.geometry.computeBoundingBox();
      mesh.plain = mesh.material;
      mesh.grey = shape.standing ? mesh.plain : paint([1, 1, 1, 1]);
      for (const material of [mesh.plain, mesh.grey].flat())
        Object.assign(material, inStencil(OF_ARM));
      const place = new T.Group();
      Object.assign(place, { name: shape.name, shape: s });
      place.add(mesh);
      this.group.add(place);
      if (shape.pose) {
        setPose(place, shape.pose, 0);
        this.still.push(place);
      } else {
        this.moving.push(place);
        this.rows.push(place);
      }
    });
    // a workpiece that moves carries the paths
    this.carrier = null;
    if (data.carried) {
      this.carrier = new T.Group();
      this.group.add(this.carrier);
      this.rows.push(this.carrier);
    }
    // where in the motion each series of numbers is
    this.stride = this.rows.length * 7;
    this.use({ data, motion, frames, perCycle }, start);
    let at = this.end;
    // the points by which each moving body is measured
    this.corners = [];
    let row = 0;
    data.shapes.forEach((shape) => {
      if (shape.pose) return;
      const points = Array.from({ length: shape.points }, (_, k) =>
        new T.Vector3().fromArray(motion, at + 3 * k),
      );
      at += 3 * shape.points;
      if (!this.rows[row++]) return;
      this.corners.push(points);
    });
    this.study = { run: this.run, start };
    this.end = at;
    this.join();
    this.makeGhost();
    viewer.scene.add(this.group);
  }

  // Play this run from now on: its data and its numbers, in which the arm's begin at `start`.
  use(run, start = 0) {
    Object.assign(this, run, { run, end: start, ends: null });
    for (const [name, width] of [
      ["body", this.stride],
      ["tip", 3 * this.chains],
      ["elbow", 3 * this.chains],
      ["mark", run.data.broken ? 3 : 0],
    ]) {
      this[name + "Start"] = this.end;
      this.end += run.frames * width;
    }
    if (this.fan) {
      this.group.remove(this.fan);
      this.fan = null;
    }
  }

  // Stand as at frame i, a part f on the way to frame i + 1.
  pose(i, f, rows = this.rows) {
    const near = between(i, f, this.perCycle);
    for (let k = 0; k < rows.length; k++)
      if (rows[k]) setPose(rows[k], this.motion, this.bodyStart + 7 * k, this.stride, near);
  }

  // What frame i is compared with: that frame of the reference, or the same one of cycle 1; a
  // cycle's end is the start.
  against(i) {
    const F = this.perCycle;
    return this.reference
      ? { base: this.reference, first: i }
      : { base: this, first: i % F === F - 1 ? 0 : i % F };
  }

  // Stand as at this part of a shown cycle, and the ghost where it is compared with.
  stand(cycle, part) {
    const F = this.perCycle;
    const row = Math.min(part * (F - 1), F - 1);
    const i = Math.min(Math.floor(row + 1e-9), F - 1);
    const f = Math.max(0, row - i);
    this.now = { frame: cycle * F + i, f, ...this.against(cycle * F + i) };
    this.pose(this.now.frame, f);
    this.now.base.pose(this.now.first, f, this.ghosts);
    this.measure();
    // where a motion ends before the others, it is compared with nothing
    this.lost = cycle + part > this.data.lost;
    if (this.lost) {
      this.off.fill(0);
      for (const shade of this.shades) shade.visible = false;
    }
    if (this.gain > 1) {
      this.enlarge(this.moving, this.shades);
      this.shades.forEach((shade, k) => {
        shade.visible = this.gain * this.off[k] > SAME;
      });
    }
  }

  // Put each body as many times as far from where another is as it stands; what was measured stays.
  enlarge(places, others) {
    const turn = new MeshCat.THREE.Quaternion();
    places.forEach((place, k) => {
      const { position, quaternion } = others[k];
      place.position.sub(position).multiplyScalar(this.gain).add(position);
      turn.copy(quaternion).invert().premultiply(place.quaternion);
      const half = Math.acos(Math.min(1, Math.abs(turn.w)));
      const side = Math.sign(turn.w) || 1;
      const sine = Math.sin(half);
      if (sine > 1e-9) {
        const share = (side * Math.sin(this.gain * half)) / sine;
        turn.set(turn.x * share, turn.y * share, turn.z * share, Math.cos(this.gain * half));
        place.quaternion.copy(turn.multiply(quaternion));
      }
      place.updateMatrix();
    });
  }

  // Stand as a message says, the bodies from this number on, the ghost from that.
  setPoses(poses, at, before) {
    this.rows.forEach((row, k) => {
      if (row) setPose(row, poses, at + 7 * k);
    });
    this.ghosts.forEach((row, k) => {
      if (row) setPose(row, poses, before + 7 * k);
    });
    this.measure();
  }

  // How far each body is off its ghost; what its body covers is not drawn.
  measure() {
    this.off = this.moving.map((place, k) => this.drift(k));
    this.shades.forEach((shade, k) => {
      shade.visible = this.off[k] > SAME;
    });
  }

  // How far the part that is pointed at is off its ghost, and how far the hand is, m.
  partOff() {
    return this.part.reduce((most, k) => Math.max(most, this.off[k]), 0);
  }
  handOff(chain) {
    const { frame, base, first, f } = this.now;
    const now = this.point("tip", chain, frame, f);
    const then = base.point("tip", chain, first, f);
    if (!this.carrier) return now.distanceTo(then);
    // relative to the workpiece, where the path is
    const before = this.ghosts[this.rows.indexOf(this.carrier)];
    return relativeTo(this.carrier, now).distanceTo(relativeTo(before, then));
  }

  // How far that part is from its start at the beginning and at the end of each shown cycle, m:
  // this.ends, measured once.
  measureEnds() {
    if (this.ends) return;
    const F = this.perCycle;
    this.pose(0, 0, this.ghosts);
    const off = (i) => {
      this.pose(i, 0);
      return this.part.reduce((most, k) => Math.max(most, this.drift(k)), 0);
    };
    this.ends = Array.from({ length: this.frames / F }, (_, c) => [off(c * F), off(c * F + F - 1)]);
  }

  // The corners of that part, as it stands.
  partCorners() {
    return this.part.flatMap((k) => this.corners[k].map((c) => this.placed(k, c)));
  }

  // A point of body k, now.
  placed(k, point) {
    this.moving[k].updateMatrix();
    return point.clone().applyMatrix4(this.moving[k].matrix);
  }

  // Present position of the place on that part which is displaced most; the elbow without a part.
  partSpot() {
    return this.spot
      ? this.placed(this.spot.k, this.spot.point)
      : this.point("elbow", 0, this.now.frame);
  }

  // The same place on the ghost.
  ghostSpot() {
    if (!this.spot || !this.ghost.visible || !this.shades[this.spot.k].visible) return null;
    const shade = this.shades[this.spot.k];
    shade.updateMatrix();
    return this.spot.point.clone().applyMatrix4(shade.matrix);
  }

  // An outline of that part, which moves with it.
  outlinePart() {
    const T = MeshCat.THREE;
    for (const rim of this.rims) rim.parent.remove(rim);
    this.rims = this.moving.flatMap(({ children }, k) => {
      const named = this.part.includes(k);
      return children.flatMap((mesh) => {
        for (const material of [mesh.plain, mesh.grey].flat())
          material.stencilRef = named ? OF_ARM | OF_PART : OF_ARM;
        if (!named) return [];
        const rim = Object.assign(new T.Mesh(hull(mesh.geometry), this.rim), { renderOrder: 5 });
        mesh.add(rim);
        return [rim];
      });
    });
  }

  // Where the joint is that breaks its limit, now.
  mark(out) {
    return out.fromArray(this.motion, this.markStart + 3 * this.now.frame);
  }

  // Where a chain's tip or elbow, or the place that is pointed at, is at frame i, a part f on the
  // way to the next.
  point(which, chain, i, f = 0, out = new MeshCat.THREE.Vector3()) {
    if (which === "spot") {
      const body = new MeshCat.THREE.Object3D();
      const start = this.bodyStart + 7 * this.rows.indexOf(this.moving[this.spot.k]);
      setPose(body, this.motion, start, this.stride, between(i, f, this.perCycle));
      return out.copy(this.spot.point).applyQuaternion(body.quaternion).add(body.position);
    }
    return out.set(
      ...blended(
        this.motion,
        this[which + "Start"] + 3 * chain,
        3 * this.chains,
        3,
        between(i, f, this.perCycle),
      ),
    );
  }

  // The same point, as far from what it is compared with as the arm is drawn.
  drawn(which, chain, i, f = 0) {
    const p = this.point(which, chain, i, f);
    const { base, first } = this.against(i);
    return this.gain > 1 ? p.lerp(base.point(which, chain, first, f), 1 - this.gain) : p;
  }

  // One mesh of all bodies, for those that are not drawn by themselves.
  join() {
    const T = MeshCat.THREE;
    this.places = [...this.moving, ...this.still];
    this.meshes = this.places.flatMap(({ children }) => children);
    const material = Object.assign(paint([1, 1, 1, 1]), inStencil(OF_ARM), { vertexColors: true });
    this.bodies = new Bodies(this.group, this.meshes, this.places.length, [material]);
    Object.assign(this.bodies.meshes[0], {
      castShadow: true,
      receiveShadow: true,
      customDepthMaterial: this.bodies.placing(
        new T.MeshDepthMaterial({ depthPacking: T.RGBADepthPacking }),
      ),
    });
  }

  // Draw as one mesh what is not drawn by itself, and the ghosts, as they are placed now.
  drawJoined() {
    this.bodies.draw(this.places.map((place) => !place.children[0].visible && place));
    this.shadow.draw(this.shades.map((shade) => shade.visible && shade));
  }

  // A see-through copy of the moving bodies with an outline, one in this.shades for each, where the
  // arm does not cover it; it stands behind what it nearly coincides with.
  makeGhost() {
    const T = MeshCat.THREE;
    const shared = {
      transparent: true,
      polygonOffset: true,
      polygonOffsetFactor: 2,
      polygonOffsetUnits: 256,
    };
    const bare = {
      stencilWrite: true,
      stencilRef: OF_GHOST,
      stencilFunc: T.EqualStencilFunc,
      stencilFuncMask: OF_ARM,
    };
    const veil = new T.MeshBasicMaterial({
      ...shared,
      ...bare,
      colorWrite: false,
      depthWrite: true,
      stencilWriteMask: OF_GHOST,
      stencilZPass: T.ReplaceStencilOp,
    });
    const tint = new T.MeshLambertMaterial({ ...shared, ...bare, opacity: 0.3, depthWrite: false });
    const edge = outlined({
      ...shared,
      ...bare,
      stencilRef: 0,
      stencilFuncMask: OF_ARM | OF_GHOST,
      depthWrite: false,
    });
    this.rim.uniforms.least.value = 2 * OUTLINE;
    Object.assign(this, { tint, edge });
    this.ghost = new T.Group();
    this.ghosts = this.rows.map((place) => {
      if (!place) return null;
      const copy = new T.Group();
      this.ghost.add(copy);
      return copy;
    });
    this.shadow = new Bodies(this.ghost, this.meshes, this.moving.length, [veil, tint, edge]);
    const { meshes } = this.shadow;
    meshes.forEach((mesh, order) => {
      mesh.renderOrder = 2 + order;
    });
    // three draws both sides of what is transparent one after the other, and looks its program up
    // for each; an outline is one colour
    meshes[2].onBeforeRender = () => {
      edge.transparent = false;
    };
    meshes[2].onAfterRender = () => {
      edge.transparent = true;
    };
    this.shades = this.moving.map((place) => this.ghosts[this.rows.indexOf(place)]);
    this.group.add(this.ghost);
  }

  // The arm at the ends of all cycles at once, see-through, from pale to its colour; made when it
  // is first asked for.
  showFan(on) {
    if (this.fan && this.fan.gain !== this.gain) {
      this.group.remove(this.fan);
      this.fan = null;
    }
    if (on && !this.fan) {
      const T = MeshCat.THREE;
      const full = new T.Color(this.data.color);
      const count = this.frames / this.perCycle;
      const ends = [this.moving.map(() => new T.Group())];
      this.fan = Object.assign(new T.Group(), { gain: this.gain });
      this.pose(
        0,
        0,
        this.rows.map((place) => ends[0][this.moving.indexOf(place)]),
      );
      for (let c = 0; c < count; c++) {
        const color = full.clone().lerp(new T.Color(1, 1, 1), 0.7 * (1 - (c + 1) / count));
        const shared = {
          transparent: true,
          polygonOffset: true,
          polygonOffsetFactor: 1,
          polygonOffsetUnits: 128,
        };
        const tint = new T.MeshLambertMaterial({
          ...shared,
          color,
          opacity: 0.24,
          depthWrite: false,
        });
        const copies = this.moving.map((place) => fanned(place, tint, 4 + c));
        this.pose(
          (c + 1) * this.perCycle - 1,
          0,
          this.rows.map((place) => copies[this.moving.indexOf(place)]),
        );
        if (this.gain > 1) this.enlarge(copies, ends[0]);
        const before = ends.at(-1);
        copies.forEach((copy, k) => {
          if (isDisplaced(copy, before[k])) this.fan.add(copy);
        });
        ends.push(copies);
      }
      this.group.add(this.fan);
    }
    if (this.fan) this.fan.visible = on;
  }

  // Corners of the bodies: those that move, over the motion, and those that do not.
  reach() {
    const moving = [];
    const still = [];
    const step = Math.max(1, Math.floor(this.frames / 36));
    for (let i = 0; i < this.frames; i += step) {
      this.pose(i, 0);
      this.moving.forEach((p) => boxCorners(p, this.group, moving));
    }
    this.still.forEach((p) => boxCorners(p, this.group, still));
    for (let k = 0; k < this.chains; k++)
      for (let i = 0; i < this.frames; i += step)
        moving.push(this.point("tip", k, i), this.point("elbow", k, i));
    return { moving, still };
  }

  // How far body k is off its ghost, m: the way of its farthest point.
  drift(k) {
    const here = this.moving[k];
    const there = this.shades[k];
    for (const place of [here, there]) place.updateMatrix();
    const { difference: D } = this;
    for (let i = 0; i < 16; i++) D[i] = here.matrix.elements[i] - there.matrix.elements[i];
    let most = 0;
    for (const { x, y, z } of this.corners[k]) {
      const a = D[0] * x + D[4] * y + D[8] * z + D[12];
      const b = D[1] * x + D[5] * y + D[9] * z + D[13];
      const c = D[2] * x + D[6] * y + D[10] * z + D[14];
      most = Math.max(most, a * a + b * b + c * c);
    }
    return Math.sqrt(most);
  }

  // The largest displacement of a body at the end of a cycle of this run, m.
  mostOff() {
    if (this.run.most === undefined) {
      this.pose(0, 0, this.ghosts);
      const ends = this.data.off.flatMap(([, off], c) => (off === null ? [] : [c]));
      this.run.most = Math.max(
        0,
        ...ends.flatMap((c) => {
          this.pose((c + 1) * this.perCycle - 1, 0);
          return this.moving.map((_, k) => this.drift(k));
        }),
      );
    }
    return this.run.most;
  }

  // Grey, and the arm's own colour as far as a body is off, which is full at `most`, m; or else the
  // robot's own colours.
  showDrift(on, most) {
    const T = MeshCat.THREE;
    const grey = new T.Color(tone("--body"));
    const full = new T.Color(this.data.color);
    this.tint.color.set(tone("--ghost"));
    this.edge.uniforms.color.value.set(tone("--ghost"));
    this.rim.uniforms.color.value.set(tone("--ink"));
    const painted = (place, share, named) => {
      for (const mesh of place.children) {
        mesh.material = on ? mesh.grey : mesh.plain;
        if (mesh.material !== mesh.plain) mesh.grey.color.copy(grey).lerp(full, share);
        // by itself is drawn what has more than one colour, is transparent, or outlined
        mesh.visible = named || !mesh.material.joins;
      }
    };
    this.still.forEach((place) => painted(place, 0, false));
    this.moving.forEach((place, k) =>
      painted(place, Math.min(1, this.off[k] / most), this.part.includes(k)),
    );
  }
}

// What a material writes where it is seen.
function inStencil(mark) {
  const { ReplaceStencilOp } = MeshCat.THREE;
  return { stencilWrite: true, stencilRef: mark, stencilZPass: ReplaceStencilOp };
}

// A point relative to a group, with the group's own turn and place taken off.
function relativeTo(group, point) {
  return point.sub(group.position).applyQuaternion(group.quaternion.clone().conjugate());
}

// The arm that the others are compared with, frame by frame: the last one that is back after each
// cycle, if all begin where it begins and their hands go where its hand goes; null without. It is
// itself compared with its cycle 1.
export function referenceOf(arms) {
  const found = arms.findLast(({ data }) =>
    data.off.flat().every((off) => off !== null && off < SAME),
  );
  if (!found || arms.length < 2) return null;
  const near = (arm, i) =>
    Array.from({ length: arm.chains }, (_, k) =>
      arm.point("tip", k, i).distanceTo(found.point("tip", k, i)),
    ).every((way) => way < 1e-3);
  const alike = (arm) => {
    if (arm.rows.length !== found.rows.length) return false;
    // as far as its motion goes
    const { lost = Infinity } = arm.data;
    const last = Math.min(arm.frames, Math.floor(lost) * arm.perCycle + 1);
    for (let i = 0; i < last; i++) if (!near(arm, i)) return false;
    arm.pose(0, 0);
    found.pose(0, 0);
    return arm.rows.every(
      (place, k) => !place === !found.rows[k] && (!place || !isDisplaced(place, found.rows[k])),
    );
  };
  return arms.every(alike) ? found : null;
}

// Point at the part of these bodies in all arms from now on.
export function pointAt(arms, isPart) {
  for (const arm of arms) {
    arm.part = arm.moving.flatMap((place, k) => (isPart(place.shape) ? [k] : []));
    arm.ends = null;
  }
  const { arm: worst, before, after } = displaced(arms);
  const distances = after.map((p, i) => p.distanceTo(before[i]));
  const most = Math.max(...distances);
  const corners = worst.part.flatMap((k) => worst.corners[k].map((c) => [k, c]));
  const [k] = corners[distances.indexOf(most)] || [];
  const point = new MeshCat.THREE.Vector3();
  const way = point.clone();
  let all = 0;
  corners.forEach(([body, c], i) => {
    if (body !== k) return;
    const weight = most > SAME ? (distances[i] / most) ** 4 : 1;
    point.addScaledVector(c, weight);
    way.addScaledVector(after[i], weight).addScaledVector(before[i], -weight);
    all += weight;
  });
  // the middle of a body that turns about itself hardly moves: then its farthest corner is pointed
  // at
  const place =
    way.length() < 0.8 * most * all
      ? corners[distances.indexOf(most)][1]
      : point.divideScalar(all || 1);
  for (const arm of arms) {
    arm.spot = all ? { k, point: place } : null;
    arm.outlinePart();
  }
}

// The most displaced arm after all cycles, and where the corners of its part are before and after
// them.
export function displaced(arms) {
  const arm = arms.reduce((a, b) => (b.data.off.at(-1)[1] > a.data.off.at(-1)[1] ? b : a));
  const at = (i) => {
    arm.pose(i, 0);
    return arm.partCorners();
  };
  return { arm, before: at(0), after: at(arm.frames - 1) };
}

// How far off a body of these arms is coloured in full, m: as far as one is after any cycle, also
// one beside the arm, such as the head.
export function fullDrift(arms) {
  const least = arms[0].gain > 1 ? LEAST_ENLARGED : LEAST_FULL;
  return stepAbove(Math.max(least, ...arms.map((arm) => arm.mostOff())));
}

function fanned(place, material, order) {
  const copy = new MeshCat.THREE.Group();
  for (const mesh of place.children)
    copy.add(
      Object.assign(mesh.clone(false), {
        material,
        visible: true,
        castShadow: false,
        receiveShadow: false,
        renderOrder: order,
      }),
    );
  return copy;
}

// Whether a body stands elsewhere than another: what coincides is drawn once.
function isDisplaced({ position, quaternion }, other) {
  return (
    position.distanceTo(other.position) > SAME ||
    1 - Math.abs(quaternion.dot(other.quaternion)) > SAME ** 2
  );
}

function paint([r, g, b, a]) {
  const T = MeshCat.THREE;
  const look = { specular: 0x1c1c1c, shininess: 28, side: T.DoubleSide };
  const material = new T.MeshPhongMaterial({ ...look, opacity: a, transparent: a < 1 });
  material.color.setRGB(r, g, b);
  return Object.assign(material, { joins: a === 1 });
}

function copied(material) {
  const own = (one) => {
    const copy = one.clone();
    copy.side = MeshCat.THREE.DoubleSide;
    return copy;
  };
  return Array.isArray(material) ? material.map(own) : own(material);
}

// Corners of the bodies of a place, as seen from a group that it stands in, or from itself.
function boxCorners(place, group, out) {
  const T = MeshCat.THREE;
  group.updateMatrixWorld(true);
  const inverse = new T.Matrix4().copy(group.matrixWorld).invert();
  for (const mesh of place.children) {
    const { min, max } = mesh.geometry.boundingBox;
    if (min.x > max.x) continue;
    const M = new T.Matrix4().multiplyMatrices(inverse, mesh.matrixWorld);
    for (const corner of cornersOf({ min, max })) out.push(corner.applyMatrix4(M));
  }
  return out;
}

export function cornersOf({ min, max }) {
  return Array.from(
    { length: 8 },
    (_, k) =>
      new MeshCat.THREE.Vector3(
        k & 1 ? max.x : min.x,
        k & 2 ? max.y : min.y,
        k & 4 ? max.z : min.z,
      ),
  );
}
