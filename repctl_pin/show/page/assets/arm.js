// One arm: its bodies, where they stand at each frame, a ghost of the start, and how far each body has drifted.


class ArmView {
  constructor(viewer, data, motion, start, frames) {
    const T = MeshCat.THREE;
    Object.assign(this, { data, motion, frames, limbs: data.limbs, rows: [], moving: [], still: [], meshes: [] });
    this.group = new T.Group();
    this.group.name = data.label;
    for (const shape of data.shapes) {
      const body = shape.body === null ? {} : viewer.scene_tree.find(["library", String(shape.body), "<object>"]).object;
      if (!body.isMesh) { if (!shape.pose) this.rows.push(null); continue; } // it could not be read
      const mesh = new T.Mesh(body.geometry, shape.color === null ? copied(body.material) : paint(shape.color));
      mesh.quaternion.copy(body.quaternion);
      mesh.scale.fromArray(shape.scale); // its own node: the placement above it stays rigid
      mesh.castShadow = mesh.receiveShadow = true;
      mesh.geometry.computeBoundingBox();
      const place = new T.Group();
      place.name = shape.name;
      place.add(mesh);
      this.group.add(place);
      this.meshes.push(mesh);
      if (shape.pose) { setPose(place, shape.pose, 0); this.still.push(place); } else { this.moving.push(place); this.rows.push(place); }
    }
    // where in the motion each moving body's numbers are: 7 a row
    this.stride = this.rows.length * 7;
    this.start = start;
    this.tipStart = start + frames * this.stride;
    this.elbowStart = this.tipStart + frames * this.limbs * 3;
    this.end = this.elbowStart + frames * this.limbs * 3;
    viewer.scene.add(this.group);
  }

  // Stand as at frame i, a part f on the way to frame i + 1.
  pose(i, f) {
    const next = f > 0 ? i + 1 : i;
    for (let k = 0; k < this.rows.length; k++)
      if (this.rows[k]) setPose(this.rows[k], this.motion, this.start + i * this.stride + 7 * k, this.start + next * this.stride + 7 * k, f);
  }

  // Where a limb's tip or elbow is at frame i, a part f on the way to the next.
  point(which, limb, i, f = 0, out = new MeshCat.THREE.Vector3()) {
    const a = this[which + "Start"] + 3 * (this.limbs * i + limb), b = a + (f > 0 ? 3 * this.limbs : 0), m = this.motion;
    return out.set(m[a] + f * (m[b] - m[a]), m[a + 1] + f * (m[b + 1] - m[a + 1]), m[a + 2] + f * (m[b + 2] - m[a + 2]));
  }

  // A see-through copy of the moving bodies as they stood at the start.
  makeGhost() {
    const T = MeshCat.THREE;
    this.ghost = new T.Group();
    const shared = { transparent: true, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 64 };
    const veil = new T.MeshBasicMaterial({ ...shared, colorWrite: false, depthWrite: true });
    const tint = new T.MeshLambertMaterial({ ...shared, color: this.data.color, opacity: 0.22, depthWrite: false });
    this.pose(0, 0);
    for (const place of this.moving)
      [veil, tint].forEach((material, order) => {
        const copy = place.clone();
        copy.children.forEach((mesh) => { mesh.material = material; mesh.castShadow = mesh.receiveShadow = false; mesh.renderOrder = 2 + order; });
        this.ghost.add(copy);
      });
    this.group.add(this.ghost);
  }

  // Corners of the bodies, in the arm's own place: those that move, over the motion, and those that do not.
  corners() {
    const moving = [], still = [], step = Math.max(1, Math.floor(this.frames / 36));
    this.group.position.set(0, 0, 0);
    for (let i = 0; i < this.frames; i += step) { this.pose(i, 0); this.moving.forEach((p) => boxCorners(p, this.group, moving)); }
    this.still.forEach((p) => boxCorners(p, this.group, still));
    for (let k = 0; k < this.limbs; k++)
      for (let i = 0; i < this.frames; i += step) moving.push(this.point("tip", k, i), this.point("elbow", k, i));
    return { moving, still };
  }

  // How far each moving body is off its start, m, before and after each cycle: the way of its farthest corner.
  measureDrift(cycles, perCycle) {
    const T = MeshCat.THREE, p = new T.Vector3(), q = new T.Vector3();
    const now = () => this.moving.map((place) => { place.updateMatrix(); return place.matrix.clone(); });
    this.pose(0, 0);
    const start = now(), corners = this.moving.map((place) => boxCorners(place, place, []));
    const off = (frame) => {
      this.pose(frame, 0);
      return now().map((M, k) => corners[k].reduce((most, c) => Math.max(most, p.copy(c).applyMatrix4(start[k]).distanceTo(q.copy(c).applyMatrix4(M))), 0));
    };
    this.drifts = Array.from({ length: cycles }, (_, c) => ({ before: off(c * perCycle), after: off((c + 1) * perCycle - 1) }));
    this.paints = this.moving.map((place) => place.children.flatMap((mesh) => [mesh.material].flat()).map((material) => ({ material, plain: material.color.clone() })));
    this.full = new T.Color(this.data.color);
    return Math.max(0, ...this.drifts.flatMap(({ after }) => after));
  }

  // How far body k has drifted, from cycle to cycle; within one, as far as time has come.
  drift(k, cycle, part) {
    const { before, after } = this.drifts[cycle];
    return before[k] + part * (after[k] - before[k]);
  }

  // Give each body the arm's colour as far as it has drifted; `most`: where the colour is full, 0 for none.
  showDrift(cycle, part, most) {
    this.paints.forEach((paints, k) => {
      const share = most > 0 ? 0.85 * this.drift(k, cycle, part) / most : 0;
      for (const { material, plain } of paints) material.color.copy(plain).lerp(this.full, share);
    });
  }
}

function setPose(node, m, a, b = a, f = 0) {
  node.position.set(m[a] + f * (m[b] - m[a]), m[a + 1] + f * (m[b + 1] - m[a + 1]), m[a + 2] + f * (m[b + 2] - m[a + 2]));
  const q = [3, 4, 5, 6].map((k) => m[a + k] + f * (m[b + k] - m[a + k]));
  node.quaternion.set(...q).normalize();
}

function paint([r, g, b, a]) {
  const T = MeshCat.THREE;
  return new T.MeshPhongMaterial({ color: new T.Color(r, g, b), specular: 0x1c1c1c, shininess: 28, side: T.DoubleSide, opacity: a, transparent: a < 1 });
}

// The same material for this body alone, so that it can change its colour.
function copied(material) {
  const own = (one) => { const copy = one.clone(); copy.side = MeshCat.THREE.DoubleSide; return copy; };
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

function cornersOf({ min, max }) {
  return Array.from({ length: 8 }, (_, k) => new MeshCat.THREE.Vector3(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z));
}
