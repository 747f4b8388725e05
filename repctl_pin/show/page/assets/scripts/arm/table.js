// The whole table around an arm, on the ground and in upright planes: what the arm reaches, in pale,
// and where F has values. Where the hand now is: on the ground, and in numbers.

import { byId, setText } from "../dom.js";

const [OF_REACH, OF_COVER] = ["#6b7784", "#0072b2"];
const WHOLE = 2 * Math.PI - 0.01; // rad, from which an arc is a circle
const DEGREES = 180 / Math.PI;

export class TableMarks {
  // `ground`: height of the floor, m
  constructor(arms, { cover }, ground) {
    const T = MeshCat.THREE;
    Object.assign(this, { cover, arms: [] });
    this.named = Object.fromEntries(
      ["angle", "spin", "radius", "height", "x", "y", "z"].map((name) => [
        name,
        [byId(`now-${name}`), byId(`needle-${name}`)],
      ]),
    );
    if (!cover.axis) return;
    this.origin = new T.Vector3(...cover.origin);
    this.axis = new T.Vector3(...cover.axis);
    const away = new T.Vector3(...cover.inner[0]).sub(this.origin);
    this.outward = away.addScaledVector(this.axis, -away.dot(this.axis)).normalize();
    this.across = this.axis.clone().cross(this.outward);
    this.foot = ground - this.origin.dot(this.axis);
    if (this.axis.z > 0.99) this.arms = arms.map((arm) => this.marksOf(arm.group));
  }

  // Radius and height of a point of a side of F, m, from the origin.
  section(points) {
    const T = MeshCat.THREE;
    return points.map((p) => {
      const away = new T.Vector3(...p).sub(this.origin);
      return new T.Vector2(away.dot(this.outward), away.dot(this.axis));
    });
  }

  // Points of the arc on the ground.
  get arc() {
    const { rim, origin, outward, across, axis, foot, cover } = this;
    if (!rim) return [];
    return Array.from({ length: 33 }, (_, i) => {
      const angle = cover.from + (i / 32) * (cover.to - cover.from);
      return origin
        .clone()
        .addScaledVector(outward, rim * Math.cos(angle))
        .addScaledVector(across, rim * Math.sin(angle))
        .addScaledVector(axis, foot);
    });
  }

  // The marks of one pane: {section, ray, plumb}, which follow the hand.
  marksOf(group) {
    const T = MeshCat.THREE;
    const { inner, outer, from, to, reach = [], around = 0, turns } = this.cover;
    const own = [...this.section(inner), ...this.section(outer).reverse()];
    const lines = reach.map((mm) =>
      Array.from({ length: mm.length / 2 }, (_, i) =>
        new T.Vector2(mm[2 * i], mm[2 * i + 1]).multiplyScalar(1e-3),
      ),
    );
    const [near, far] = spanOf(own);
    const [least, most] = spanOf([...own, ...lines.flat()]);
    const rim = 1.04 * most;
    this.rim = rim;
    const half = Math.round(turns.angle / 2);
    const ends =
      to - from > WHOLE
        ? [[0, `${2 * half}°`]]
        : [
            [from, `−${half}°`],
            [to, `${half}°`],
          ];
    // on the ground: the radii that are reached, those of F, and an arc of its angle
    const ray = ring(0, rim, -0.006, 0.006, 0.9, OF_COVER);
    const flat = new T.Group().add(
      ring(near, far, from, to, 0.1, OF_COVER),
      ring(rim, 1.03 * rim, from, to, 0.9, OF_COVER),
      ...ends.map(([angle, text]) => label(text, 1.14 * rim, angle, rim)),
      ray,
    );
    if (lines.length) flat.add(ring(least, most, -around / 2, around / 2, 0.16));
    flat.position.z = this.foot + 0.002 * rim;
    const section = uprightOf([own], OF_COVER, 0.9);
    const plumb = new T.Line(
      new T.BufferGeometry().setFromPoints([new T.Vector3(), new T.Vector3()]),
      new T.LineBasicMaterial({ color: OF_COVER }),
    );
    const marks = new T.Group().add(section, plumb, flat);
    if (lines.length)
      for (const side of [-1, 1]) marks.add(facing(uprightOf(lines, OF_REACH, 0.6), side, around));
    marks.position.copy(this.origin);
    marks.quaternion.setFromRotationMatrix(
      new T.Matrix4().makeBasis(this.outward, this.across, this.axis),
    );
    group.add(marks);
    return { section, ray, plumb };
  }

  // Show where the hand of an arm is: as it is led, or at this part of a cycle.
  follow(arm, own, cycle, part) {
    const { lead, chain, laws } = own || {};
    const { frame, f } = arm.now;
    const p = lead ? own.onPiece(lead.hand) : arm.point("tip", 0, frame, f);
    const q = lead ? lead.qs.at(-1) : jointsAt(arm.run.joints, cycle, part);
    const [chart] = laws ? laws.at(-1).parts : [];
    if (!chart || !q) return this.show(p);
    chain.place(q);
    const spin = chart.measure(chain.frames[0])[5];
    return this.show(p, spin && spin[0]);
  }

  // Show where the hand is: its place p, and its spin, rad, if that is known.
  show(p, spin) {
    const { named, axis, origin } = this;
    if (!axis) {
      for (const name of ["x", "y", "z"]) say(named[name], `${formatted(p[name])} m`);
      return;
    }
    const away = p.clone().sub(origin);
    const [x, y, z] = [this.outward, this.across, axis].map((e) => away.dot(e));
    const angle = Math.atan2(y, x);
    const radius = Math.hypot(x, y);
    for (const { section, ray, plumb } of this.arms) {
      section.rotation.z = angle;
      ray.rotation.z = angle;
      const { position } = plumb.geometry.attributes;
      position.setXYZ(0, x, y, z);
      position.setXYZ(1, x, y, this.foot);
      position.needsUpdate = true;
    }
    say(named.radius, `${formatted(radius)} m`);
    say(named.height, `${formatted(p.dot(axis))} m`);
    for (const [name, value] of [
      ["angle", angle],
      ["spin", spin],
    ]) {
      const [, dial] = named[name];
      if (value === undefined || !dial) continue;
      say(named[name], `${formatted(DEGREES * value, 0)}°`);
      dial.setAttribute("transform", `rotate(${-DEGREES * value})`);
    }
  }
}

// The joints of a run at a part of a cycle, between their samples.
function jointsAt(joints, cycle, part) {
  if (!joints) return null;
  const { at, count, n, values } = joints;
  const row = (i) => values.subarray((cycle * count + i) * n, (cycle * count + i + 1) * n);
  const next = Math.max(
    1,
    at.findIndex((t) => t >= part),
  );
  const share = Math.min((part - at[next - 1]) / (at[next] - at[next - 1]), 1);
  return row(next - 1).map((v, i) => v + share * (row(next)[i] - v));
}

const say = ([node], words) => node && setText(node, words);
const formatted = (v, digits = 2) =>
  (Number(v.toFixed(digits)) + 0).toFixed(digits).replace("-", "−");

// A flat ring or part of it.
function ring(inner, outer, from, to, opacity, color = OF_REACH) {
  const T = MeshCat.THREE;
  const shape = new T.RingGeometry(
    inner,
    outer,
    Math.ceil(40 * (to - from)) + 1,
    1,
    from,
    to - from,
  );
  return new T.Mesh(shape, flatMaterial(color, opacity));
}

const flatMaterial = (color, opacity) =>
  new MeshCat.THREE.MeshBasicMaterial({
    color,
    opacity,
    transparent: true,
    depthWrite: false,
    side: MeshCat.THREE.DoubleSide,
  });

const spanOf = (points) => [Math.min, Math.max].map((end) => end(...points.map(({ x }) => x)));

// Closed lines of radii and heights in an upright plane, and what is inside; those around holes are
// clockwise.
function uprightOf(lines, color, opacity) {
  const T = MeshCat.THREE;
  const around = lines.filter((line) => lines.length === 1 || T.ShapeUtils.area(line) > 0);
  const shapes = around.map((line) => new T.Shape(line));
  for (const line of lines) if (!around.includes(line)) shapes[0].holes.push(new T.Path(line));
  const upright = new T.Group().add(
    new T.Mesh(new T.ShapeGeometry(shapes), flatMaterial(color, 0.15 * opacity)),
    ...lines.map(
      (line) =>
        new T.LineLoop(
          new T.BufferGeometry().setFromPoints(line),
          new T.LineBasicMaterial({ color, opacity, transparent: true }),
        ),
    ),
  );
  upright.rotation.x = Math.PI / 2; // its y is the height
  return new T.Group().add(upright);
}

// Keep an upright plane square to the line of sight, on one side of the axis, as far as the arm
// goes around.
function facing(plane, side, around) {
  const [first] = plane.children[0].children;
  first.onBeforeRender = (renderer, scene, camera) => {
    const { x, y } = plane.parent.worldToLocal(camera.position.clone());
    const angle = Math.atan2(side * x, -side * y);
    plane.rotation.z = Math.min(Math.max(angle, -around / 2), around / 2);
    plane.updateMatrixWorld(true);
  };
  return plane;
}

// Words on the ground, at a radius and an angle; they face the camera.
function label(text, radius, angle, size) {
  const T = MeshCat.THREE;
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: 192, height: 64 });
  const draw = canvas.getContext("2d");
  Object.assign(draw, { font: "600 48px system-ui, sans-serif", textAlign: "center" });
  draw.textBaseline = "middle";
  Object.assign(draw, { fillStyle: OF_COVER, strokeStyle: "rgba(255,255,255,.8)", lineWidth: 8 });
  draw.strokeText(text, 96, 34);
  draw.fillText(text, 96, 34);
  const map = new T.CanvasTexture(canvas);
  const words = new T.Sprite(new T.SpriteMaterial({ map, depthTest: false, transparent: true }));
  words.position.set(radius * Math.cos(angle), radius * Math.sin(angle), 0.05 * size);
  words.renderOrder = 8;
  words.scale.set(0.36 * size, 0.12 * size, 1);
  return words;
}
