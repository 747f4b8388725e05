// The whole table around an arm: what it reaches, in pale, where F has values, and where the hand
// now is, on the ground, in the upright plane through the axis and the hand, and in numbers.

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

  // The marks of one pane: {upright, needle, plumb}, which follow the hand.
  marksOf(group) {
    const T = MeshCat.THREE;
    const { cover } = this;
    const { inner, outer, from, to, reach = [], around } = cover;
    const own = [...this.section(inner), ...this.section(outer).reverse()];
    const lines = reach.map((line) => line.map(([x, y]) => new T.Vector2(x, y)));
    const far = (points) => Math.max(...points.map(({ x }) => x));
    const near = (points) => Math.min(...points.map(({ x }) => x));
    const upright = new T.Group();
    const needle = new T.Group();
    const still = new T.Group();
    // on the ground: the radii that are reached, and those of F, and an arc of its angle
    const rim = 1.05 * Math.max(far(own), ...lines.map(far));
    if (lines.length)
      still.add(
        ring(Math.min(...lines.map(near)), far(lines.flat()), -around / 2, around / 2, 0.1),
      );
    still.add(ring(near(own), far(own), from, to, 0.1, OF_COVER));
    still.add(ring(rim, 1.03 * rim, from, to, 0.9, OF_COVER));
    const half = Math.round(cover.turns.angle / 2);
    if (to - from > WHOLE) still.add(label(`${2 * half}°`, 1.1 * rim, 0, rim));
    else
      for (const [angle, sign] of [
        [from, "−"],
        [to, ""],
      ]) {
        still.add(ring(0.97 * rim, 1.06 * rim, angle - 0.008, angle + 0.008, 0.9, OF_COVER));
        still.add(label(`${sign}${half}°`, 1.14 * rim, angle, rim));
      }
    // at the angle of the hand: a ray on the ground, and the sections of reach and F
    needle.add(ring(0, rim, -0.006, 0.006, 0.9, OF_COVER));
    for (const line of lines) upright.add(outline(line, OF_REACH, 0.6));
    if (lines.length) upright.add(filled(lines, OF_REACH, 0.1));
    upright.add(outline(own, OF_COVER, 0.9), filled([own], OF_COVER, 0.12));
    upright.rotation.x = Math.PI / 2; // its y is the height
    const plumb = new T.Line(
      new T.BufferGeometry().setFromPoints([new T.Vector3(), new T.Vector3()]),
      new T.LineBasicMaterial({ color: OF_COVER, transparent: true, opacity: 0.6 }),
    );
    const turned = new T.Group().add(upright);
    const marks = new T.Group().add(turned, plumb);
    const flat = new T.Group().add(still, needle);
    flat.position.z = this.foot + 0.002 * rim;
    marks.add(flat);
    marks.position.copy(this.origin);
    marks.quaternion.setFromRotationMatrix(
      new T.Matrix4().makeBasis(this.outward, this.across, this.axis),
    );
    group.add(marks);
    return { turned, needle, plumb };
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
    for (const { turned, needle, plumb } of this.arms) {
      turned.rotation.z = angle;
      needle.rotation.z = angle;
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

function outline(points, color, opacity) {
  const T = MeshCat.THREE;
  return new T.LineLoop(
    new T.BufferGeometry().setFromPoints(points),
    new T.LineBasicMaterial({ color, opacity, transparent: true }),
  );
}

// What is inside closed lines: those around holes are clockwise.
function filled(lines, color, opacity) {
  const T = MeshCat.THREE;
  const around = lines.filter((line) => lines.length === 1 || T.ShapeUtils.area(line) > 0);
  const holes = lines.filter((line) => !around.includes(line));
  const shapes = around.map((line) => new T.Shape(line));
  for (const hole of holes) shapes[0].holes.push(new T.Path(hole));
  return new T.Mesh(new T.ShapeGeometry(shapes), flatMaterial(color, opacity));
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
  words.scale.set(0.36 * size, 0.12 * size, 1);
  return words;
}
