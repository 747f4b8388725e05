// The whole table around an arm, on the ground and in upright planes: what the arm reaches, in
// pale, and where F has values. Where the hand now is: on the ground, and in numbers.

import { byId, element, inEachScheme, setText, tone } from "../dom.js";

const [OF_REACH, OF_COVER] = ["--reach", "--cover"];
const WHOLE = 2 * Math.PI - 0.01; // rad, from which an arc is a circle
const ON_PHONE = window.matchMedia("(max-width: 640px)"); // where words in the scene are unreadable
const DEGREES = 180 / Math.PI;

export class TableMarks {
  // `cover`: as in drawCover, and {reach, around, turns}: closed lines of radii and heights, mm,
  // how far the arm goes around, rad, and the angle, degrees; `ground`: height of the floor, m
  constructor(arms, { cover }, ground) {
    const T = MeshCat.THREE;
    const { axis, origin, inner } = cover;
    Object.assign(this, { cover, arms: [], arc: [], words: [] });
    if (!axis) return;
    const [o, up, side] = [origin, axis, inner[0]].map((v) => new T.Vector3(...v));
    const across = side.sub(o).cross(up).normalize().negate();
    // x outward at the angle 0, z along the axis
    this.place = new T.Matrix4().makeBasis(across.clone().cross(up), across, up).setPosition(o);
    this.inverse = this.place.clone().invert();
    this.base = o.dot(up);
    if (up.z > 0.99) this.arms = arms.map((arm) => this.marksOf(arm.group, ground - this.base));
  }

  // The marks of one pane that follow the hand.
  marksOf(group, foot) {
    const T = MeshCat.THREE;
    const { inner, outer, from, to, reach = [], around, turns } = this.cover;
    const own = [...inner, ...outer.slice().reverse()].map((p) => {
      const { x, z } = new T.Vector3(...p).applyMatrix4(this.inverse);
      return new T.Vector3(x, 0, z);
    });
    const lines = reach.map((line) =>
      line.map(([x, z]) => new T.Vector3(x, 0, z).multiplyScalar(1e-3)),
    );
    const [near, far] = spanOf(own);
    const [least, most] = spanOf([...own, ...lines.flat()]);
    const rim = 1.04 * most;
    const half = Math.floor(turns.angle / 2);
    // beside the ends of the arc, where no path leads
    const aside = Math.min((WHOLE - to + from) / 6, 0.14);
    const ends =
      to - from > WHOLE
        ? [[0, `${2 * half}°`]]
        : [
            [from - aside, `−${half}°`],
            [to + aside, `${half}°`],
          ];
    const words = ON_PHONE.matches ? [] : ends;
    // on the ground: the radii that are reached, those of F, and an arc of its angle
    const ray = ring(0, rim, -0.006, 0.006, 0.9);
    const flat = new T.Group().add(
      ring(near, far, from, to, 0.1),
      ring(rim, 1.03 * rim, from, to, 0.9),
      ...words.map(([angle, text]) => label(text, 1.16 * rim, angle, rim)),
      ray,
    );
    const section = upright([own], OF_COVER, 0.9);
    const marks = new T.Group().add(section, flat);
    if (lines.length) {
      flat.add(ring(least, most, -around / 2, around / 2, 0.16, OF_REACH));
      for (const side of [-1, 1]) marks.add(facing(upright(lines, OF_REACH, 0.6), side, around));
    }
    flat.position.z = foot + 0.002 * rim;
    marks.applyMatrix4(this.place);
    group.add(marks);
    this.arc = Array.from({ length: 33 }, (_, i) => {
      const angle = from + (i / 32) * (to - from);
      const p = new T.Vector3(rim * Math.cos(angle), rim * Math.sin(angle), foot);
      return p.applyMatrix4(this.place);
    });
    // as far out as the words beside it are wide
    this.words = words.map(([angle]) => {
      const p = new T.Vector3(Math.cos(angle), Math.sin(angle), 0).multiplyScalar(1.3 * rim);
      return p.setZ(foot).applyMatrix4(this.place);
    });
    return [section, ray];
  }

  // Show where the hand of an arm is: as it is led, or at this part of a cycle.
  follow(arm, own, cycle, part) {
    const { lead, chain, laws } = own || {};
    const { frame, f } = arm.now;
    const p = lead ? own.piece.drawn(lead.hand) : arm.point("tip", 0, frame, f).clone();
    const q = lead ? lead.qs.at(-1) : jointsAt(arm.run.joints, cycle, part);
    const [chart] = laws ? laws.at(-1).parts : [];
    if (!this.place) {
      for (const name of ["x", "y", "z"]) say(name, p[name]);
      return;
    }
    const { x, y, z } = p.applyMatrix4(this.inverse);
    const angle = Math.atan2(y, x);
    for (const mark of this.arms.flat()) mark.rotation.z = angle;
    say("radius", Math.hypot(x, y));
    say("height", this.base + z);
    const { turns } = this.cover;
    turn("angle", angle, turns.angle);
    if (!chart || !q) return;
    chain.place(q);
    const [spin] = chart.measure(chain.frames[0])[5] || [];
    if (spin !== undefined) turn("spin", spin, turns.spin);
  }
}

// The joints of a run at a part of a cycle, between their samples.
function jointsAt(joints, cycle, part) {
  if (!joints) return null;
  const { at, count, n, values } = joints;
  const next = Math.max(
    at.findIndex((t) => t >= part),
    1,
  );
  const share = Math.min((part - at[next - 1]) / (at[next] - at[next - 1]), 1);
  const first = (cycle * count + next - 1) * n;
  return values.slice(first, first + n).map((v, i) => v + share * (values[first + n + i] - v));
}

// Write a number, and turn the needle of its dial; the number has the colour of what is near where
// the range, in degrees, is about to end.
function say(name, value, digits = 2, unit = " m") {
  const words = (Number(value.toFixed(digits)) + 0).toFixed(digits).replace("-", "−");
  const node = byId(`now-${name}`);
  if (node) setText(node, words + unit);
}
function turn(name, angle, range) {
  const needle = byId(`needle-${name}`);
  if (!needle) return;
  say(name, DEGREES * angle, 0, "°");
  const left = range / 2 - Math.abs(DEGREES * angle);
  byId(`now-${name}`).classList.toggle("near", range < 360 && left < 3);
  needle.setAttribute("transform", `rotate(${-DEGREES * angle})`);
}

const spanOf = (points) => [Math.min, Math.max].map((end) => end(...points.map(({ x }) => x)));

// A flat ring or part of it.
function ring(inner, outer, from, to, opacity, color = OF_COVER) {
  const T = MeshCat.THREE;
  const parts = Math.ceil(40 * (to - from));
  const shape = new T.RingGeometry(inner, outer, parts, 1, from, to - from);
  const drawn = new T.MeshBasicMaterial({
    opacity,
    transparent: true,
    depthWrite: false,
    side: T.DoubleSide,
  });
  inEachScheme(() => drawn.color.set(tone(color)));
  return new T.Mesh(shape, drawn);
}

// Closed lines of radii and heights in an upright plane.
function upright(lines, color, opacity) {
  const T = MeshCat.THREE;
  const drawn = new T.LineBasicMaterial({ opacity, transparent: true });
  inEachScheme(() => drawn.color.set(tone(color)));
  const plane = new T.Group();
  for (const line of lines)
    plane.add(new T.LineLoop(new T.BufferGeometry().setFromPoints(line), drawn));
  return plane;
}

// Keep an upright plane square to the line of sight, on one side of the axis, as far as the arm
// goes around.
function facing(plane, side, around) {
  const [first] = plane.children;
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
  const canvas = element("canvas", { width: 192, height: 64 });
  const draw = canvas.getContext("2d");
  Object.assign(draw, { font: "600 46px sans-serif", textAlign: "center" });
  const wide = draw.measureText(text).width + 28;
  const map = new T.CanvasTexture(canvas);
  inEachScheme(() => {
    draw.clearRect(0, 0, 192, 64);
    draw.fillStyle = tone("--stage");
    draw.fillRect(96 - wide / 2, 2, wide, 60);
    draw.fillStyle = tone(OF_COVER);
    draw.fillText(text, 96, 48);
    map.needsUpdate = true;
  });
  const words = new T.Sprite(new T.SpriteMaterial({ map, depthTest: false }));
  words.position.set(radius * Math.cos(angle), radius * Math.sin(angle), 0.05 * size);
  words.renderOrder = 9;
  words.scale.set(0.36 * size, 0.12 * size, 1);
  return words;
}
