// What stays behind: a tube along each point's way, drawn only as far as time has come.

const SIDES = 6;
const LONGEST = 6000; // points of a trail
const RED = "#e00020"; // of what cannot be done
const CLEAR_RED = 0.8; // opacity of its balls: with less, they are pink
const THICK = 0.0026; // of a way, in parts of the picture's extent

let traceMaterials; // of all traces: what is set up once for several is drawn in less time

export class Trace {
  // cycles: arrays of points, one a cycle; shade(c, p): a colour; `ends`: of many cycles, only the
  // first and the last whole one are seen
  constructor(parent, cycles, radius, shade, ends = false) {
    const T = MeshCat.THREE;
    const position = [];
    const color = [];
    const index = [];
    const tangent = new T.Vector3(1, 0, 0);
    const normal = new T.Vector3();
    const side = new T.Vector3();
    const ring = new T.Vector3();
    this.perCycle = (cycles[0].length - 1) * SIDES * 6;
    cycles.forEach((points, c) => {
      points.forEach((point, i) => {
        const ahead = points[Math.min(i + 1, points.length - 1)];
        const behind = points[Math.max(i - 1, 0)];
        const step = new T.Vector3().subVectors(ahead, behind);
        if (step.lengthSq() > 1e-18) tangent.copy(step).normalize();
        normal.addScaledVector(tangent, -normal.dot(tangent));
        if (normal.lengthSq() < 1e-6) normal.set(0, 0, 1).addScaledVector(tangent, -tangent.z);
        if (normal.lengthSq() < 1e-6) normal.set(0, 1, 0);
        normal.normalize();
        side.crossVectors(tangent, normal);
        const tone = shade(c, i / (points.length - 1));
        for (let k = 0; k < SIDES; k++) {
          const angle = (2 * Math.PI * k) / SIDES;
          ring
            .copy(point)
            .addScaledVector(normal, radius * Math.cos(angle))
            .addScaledVector(side, radius * Math.sin(angle));
          position.push(ring.x, ring.y, ring.z);
          color.push(tone.r, tone.g, tone.b);
        }
        if (i === 0) return;
        const b = position.length / 3 - SIDES;
        const a = b - SIDES;
        for (let k = 0; k < SIDES; k++) {
          const l = (k + 1) % SIDES;
          index.push(a + k, b + k, a + l, a + l, b + k, b + l);
        }
      });
    });
    this.geometry = new T.BufferGeometry();
    this.geometry.setAttribute("position", new T.Float32BufferAttribute(position, 3));
    this.geometry.setAttribute("color", new T.Float32BufferAttribute(color, 3));
    this.geometry.setIndex(index);
    // where a body stands in front, the trace shines through
    traceMaterials ||= [
      new T.MeshBasicMaterial({ vertexColors: true, side: T.DoubleSide }),
      new T.MeshBasicMaterial({
        vertexColors: true,
        transparent: true,
        opacity: 0.5,
        depthFunc: T.GreaterDepth,
        depthWrite: false,
      }),
    ];
    for (const material of traceMaterials) {
      const mesh = new T.Mesh(this.geometry, ends ? [material] : material);
      mesh.frustumCulled = false;
      mesh.renderOrder = material.transparent ? 5 : 1;
      parent.add(mesh);
    }
    this.ends = ends;
    this.show(0, 0);
  }

  show(cycle, part) {
    const { ends, geometry, perCycle } = this;
    const now = cycle * perCycle + Math.floor(part * (perCycle / (SIDES * 6)) + 1e-9) * SIDES * 6;
    if (!ends) {
      geometry.setDrawRange(0, now);
      return;
    }
    const from = Math.max(perCycle, now - perCycle);
    geometry.clearGroups();
    geometry.addGroup(0, Math.min(perCycle, now), 0);
    if (now > from) geometry.addGroup(from, now - from, 0);
  }
}

export class Marker {
  constructor(parent, radius, color, opacity = 1) {
    const T = MeshCat.THREE;
    this.node = new T.Group();
    const ball = new T.SphereGeometry(radius, 20, 14);
    const plain = new T.MeshLambertMaterial({
      color,
      emissive: color,
      emissiveIntensity: 0.35,
      opacity,
      transparent: opacity < 1,
    });
    const through = new T.MeshBasicMaterial({
      color,
      transparent: true,
      opacity: 0.6 * opacity,
      depthFunc: T.GreaterDepth,
      depthWrite: false,
    });
    for (const material of [plain, through]) {
      const mesh = new T.Mesh(ball, material);
      mesh.renderOrder = material === through ? 6 : 1;
      this.node.add(mesh);
    }
    parent.add(this.node);
  }
}

// The colour grows from pale to full with the drift, where there is any; an arm that does not drift
// has one colour. Where only the first and the last cycle are seen, the first is pale.
export function driftShade(arm, scene) {
  const T = MeshCat.THREE;
  const full = new T.Color(arm.color);
  const pale = full.clone().lerp(new T.Color(1, 1, 1), 0.62);
  const largest = Math.max(...scene.arms.flatMap((a) => a.drift));
  const mine = Math.max(...arm.drift);
  return (c, p) => {
    if (!(mine > 0.02 * largest)) return full;
    if (scene.cover) return c ? full : pale;
    const n = scene.cycles[c];
    const before = n > 1 ? arm.drift[n - 2] : 0;
    const after = arm.drift[n - 1];
    return pale.clone().lerp(full, Math.min(1, (before + p * (after - before)) / mine));
  };
}

// Take a group of lines from an arm, and put another in its place.
export function cleared(parent, old) {
  if (old) {
    parent.remove(old);
    old.traverse((node) => node.geometry && node.geometry.dispose());
  }
  const group = new MeshCat.THREE.Group();
  parent.add(group);
  return group;
}

// An arm's path, in place of an earlier one, and a mark where it goes beyond what it can do; in
// dashes, the strokes that a hand could not follow, and a mark where the first begins.
export function drawPaths(arm, paths, extent, strokes) {
  const thick = THICK * extent;
  const ink = new MeshCat.THREE.Color("#6b7784");
  arm.paths = cleared(arm.carrier || arm.group, arm.paths);
  for (const path of paths)
    if (path.length > 1) new Trace(arm.paths, [path], 0.75 * thick, () => ink).show(1, 0);
  arm.marks = cleared(arm.group, arm.marks);
  arm.past = arm.data.broken ? new Marker(arm.marks, 14 * thick, RED, CLEAR_RED) : null;
  const red = new MeshCat.THREE.Color(RED);
  for (const pieces of strokes.map((stroke) => dashes(stroke, 9 * thick)))
    if (pieces.length) new Trace(arm.paths, pieces, thick, () => red).show(pieces.length, 0);
  arm.stop = strokes.length ? new Marker(arm.paths, 14 * thick, RED, CLEAR_RED) : null;
  if (arm.stop) arm.stop.node.position.copy(strokes[0][0]);
}

// A line in pieces of this length, of two points each, with as much room between them.
function dashes(line, long) {
  const pieces = [];
  let left = 0;
  line.slice(1).forEach((p, i) => {
    const size = line[i].distanceTo(p);
    const at = (way) => line[i].clone().lerp(p, Math.min(way / size, 1));
    for (; left < size; left += 2 * long) pieces.push([at(left), at(left + long)]);
    left -= size;
  });
  return pieces;
}

// The ways of each arm's tips and of the place that is pointed at, in place of earlier ones; as far
// from its ghost as the arm is drawn. Pauses after each.
export function* drawTraces(arms, scene, extent) {
  const F = scene.perCycle;
  const thick = THICK * extent;
  const ends = Boolean(scene.cover); // whose paths fill the space
  const lines = [];
  for (const arm of arms) {
    const shade = driftShade(arm.data, scene);
    const full = new MeshCat.THREE.Color(arm.data.color);
    const point = (which, chain, c, i) => arm.drawn(which, chain, c * F + i);
    const pieces = (which, chain) =>
      scene.cycles.map((n, c) => Array.from({ length: F }, (v, i) => point(which, chain, c, i)));
    arm.traces = cleared(arm.group, arm.traces);
    const tips = Array.from({ length: arm.chains }, (_, k) => ["tip", k, 1.35, 3.4, () => full]);
    const spot = arm.spot ? [["spot", 0, 1, 2.8, shade]] : [];
    for (const [which, chain, width, ball, tint] of scene.live ? [] : [...tips, ...spot]) {
      lines.push({
        arm,
        which,
        chain,
        trace: new Trace(arm.traces, pieces(which, chain), width * thick, tint, ends),
        ball: new Marker(arm.traces, ball * thick, arm.data.color),
      });
      yield;
    }
  }
  return lines;
}

// Points of 3 px, seen through bodies: a line is never wider than one pixel.
export function dots(geometry, color) {
  const material = new MeshCat.THREE.PointsMaterial({
    color,
    size: 3 * (window.devicePixelRatio || 1),
    sizeAttenuation: false,
    depthTest: false,
  });
  return Object.assign(new MeshCat.THREE.Points(geometry, material), {
    frustumCulled: false,
    renderOrder: 7,
  });
}

// What a point leaves behind, as it comes; the oldest half is forgotten when there is no room.
export class Trail {
  constructor(parent, color) {
    const T = MeshCat.THREE;
    this.geometry = new T.BufferGeometry();
    this.points = new Float32Array(3 * LONGEST);
    this.geometry.setAttribute("position", new T.BufferAttribute(this.points, 3));
    this.count = 0;
    for (const line of [
      Object.assign(new T.Line(this.geometry, new T.LineBasicMaterial({ color })), {
        frustumCulled: false,
      }),
      dots(this.geometry, color),
    ])
      parent.add(line);
  }

  add(point) {
    const { position } = this.geometry.attributes;
    const { updateRange: news } = position;
    // what is new since the last picture goes to the graphics card, which then sets −1
    if (news.count < 0) Object.assign(news, { offset: 3 * this.count, count: 0 });
    if (this.count === LONGEST) {
      this.points.copyWithin(0, (3 * LONGEST) / 2);
      this.count = LONGEST / 2;
      Object.assign(news, { offset: 0, count: 3 * this.count });
    }
    point.toArray(this.points, 3 * this.count++);
    news.count += 3;
    position.needsUpdate = true;
    this.geometry.setDrawRange(0, this.count);
  }
}
