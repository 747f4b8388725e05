// The one camera of all panes: where it looks from, and how far away it stands.

import { cornersOf, displaced } from "./arm.js";

export class Eye {
  // `out`: from what is looked at to the camera, robot axes (z up); `flat`: without perspective, as
  // a drawing
  constructor(viewer, out, flat) {
    const T = MeshCat.THREE;
    this.viewer = viewer;
    this.out = out.clone().normalize();
    this.right = new T.Vector3(0, 0, 1).cross(this.out).normalize();
    this.up = new T.Vector3().crossVectors(this.out, this.right);
    if (flat) {
      const camera = new T.OrthographicCamera(-1, 1, 1, -1, 0.01, 100);
      viewer.controls.dispose();
      viewer.set_camera(camera);
      viewer.set_object(["Cameras", "default", "rotated"], camera);
    } else viewer.camera.fov = 16;
    viewer.controls.addEventListener("start", () => this.touch());
  }

  // From now on the view is the visitor's: it is kept, and a narrower pane shows as much of it, at
  // a share of its zoom.
  touch() {
    if (!this.touched) Object.assign(this, { touched: true, chosen: this.ratio, share: 1 });
  }

  span(points, axis) {
    const along = points.map((p) => p.dot(this[axis]));
    return [
      along.reduce((a, b) => Math.min(a, b), Infinity),
      along.reduce((a, b) => Math.max(a, b), -Infinity),
    ];
  }

  // Go where all points are in a pane of this size, with room for what is said above and below.
  fit(points, { width, height, above, below }) {
    const { camera, controls } = this.viewer;
    const T = MeshCat.THREE;
    const free = {
      x: 0.92,
      top: 1 - Math.min(0.5, (2 * above) / height),
      bottom: 1 - Math.min(0.5, (2 * below) / height),
    };
    const world = (v) => new T.Vector3(v.x, v.z, -v.y); // three's y is up
    const center = new T.Vector3();
    let distance;
    if (camera.isOrthographicCamera) {
      const [left, right] = this.span(points, "right");
      const [low, high] = this.span(points, "up");
      const depth = this.span(points, "out");
      const half =
        Math.max(
          (high - low) / (free.top + free.bottom),
          (right - left) / (2 * free.x * (width / height)),
        ) || 1;
      Object.assign(camera, { top: half, bottom: -half, zoom: 1 });
      center
        .addScaledVector(this.right, (left + right) / 2)
        .addScaledVector(this.out, (depth[0] + depth[1]) / 2);
      center.addScaledVector(this.up, (low + high - half * (free.top - free.bottom)) / 2);
      distance = 4 * half + depth[1] - depth[0];
    } else {
      const tall = Math.tan((camera.fov * Math.PI) / 360);
      const wide = (tall * width) / height;
      for (const p of points) center.addScaledVector(p, 1 / points.length);
      for (let round = 0; round < 12; round++) {
        distance = 0.01;
        for (const p of points) {
          const v = p.clone().sub(center);
          const y = v.dot(this.up);
          distance = Math.max(
            distance,
            v.dot(this.out) +
              Math.max(
                Math.abs(v.dot(this.right)) / (wide * free.x),
                y / (tall * free.top),
                -y / (tall * free.bottom),
              ),
          );
        }
        const spread = { right: [Infinity, -Infinity], up: [Infinity, -Infinity] };
        for (const p of points) {
          const v = p.clone().sub(center);
          const depth = distance - v.dot(this.out);
          for (const axis of ["right", "up"]) {
            const at = v.dot(this[axis]) / depth;
            spread[axis] = [Math.min(spread[axis][0], at), Math.max(spread[axis][1], at)];
          }
        }
        center.addScaledVector(this.right, (distance * (spread.right[0] + spread.right[1])) / 2);
        center.addScaledVector(
          this.up,
          distance *
            ((spread.up[0] * free.top + spread.up[1] * free.bottom) / (free.top + free.bottom)),
        );
      }
    }
    Object.assign(camera, { near: distance / 100, far: distance * 20 });
    camera.position.copy(world(center.clone().addScaledVector(this.out, distance)));
    controls.target.copy(world(center));
    this.aspect(width / height);
    controls.update();
    this.viewer.set_dirty();
  }

  aspect(ratio) {
    const { camera } = this.viewer;
    this.ratio = ratio;
    if (this.touched) {
      const share = Math.min(1, ratio / this.chosen);
      camera.zoom *= share / this.share;
      this.share = share;
    }
    if (camera.isOrthographicCamera)
      Object.assign(camera, { left: camera.bottom * ratio, right: camera.top * ratio });
    else camera.aspect = ratio;
    camera.updateProjectionMatrix();
  }

  // Where the camera is, what it looks at, and how near it is, without what a narrower pane needs:
  // seven numbers, to set again.
  where() {
    const { camera, controls } = this.viewer;
    const zoom = camera.zoom / (this.touched ? this.share : 1);
    return [...camera.position.toArray(), ...controls.target.toArray(), zoom];
  }
  stand(numbers) {
    const { camera, controls } = this.viewer;
    camera.position.fromArray(numbers);
    controls.target.fromArray(numbers, 3);
    camera.zoom = numbers[6];
    camera.updateProjectionMatrix();
    controls.update();
    this.touched = false;
    this.touch();
    this.viewer.set_dirty();
  }

  // Go round by these angles, and nearer by this factor.
  turn(across, upward, nearer = 1) {
    const T = MeshCat.THREE;
    const { camera, controls } = this.viewer;
    const offset = new T.Spherical().setFromVector3(camera.position.clone().sub(controls.target));
    offset.theta -= across;
    offset.phi -= upward;
    if (camera.isOrthographicCamera) camera.zoom *= nearer;
    else offset.radius /= nearer;
    camera.position.setFromSpherical(offset.makeSafe()).add(controls.target);
    this.touch();
    this.viewer.set_dirty();
  }
}

// Look at the arm from the front, from the side on which it works, a little from above.
export function towards(tip, whole) {
  const middle = whole.getCenter(new MeshCat.THREE.Vector3());
  const reach = { x: tip.x - middle.x, y: tip.y - middle.y };
  const heading = Math.hypot(reach.x, reach.y) > 0.05 ? Math.atan2(reach.y, reach.x) : 0;
  const turn = heading > 0.15 ? 0.75 : -0.75;
  const rise = 0.33;
  const azimuth = Math.abs(heading) > 1.2 ? heading + (heading > 0 ? -0.75 : 0.75) : turn;
  return new MeshCat.THREE.Vector3(
    Math.cos(azimuth) * Math.cos(rise),
    Math.sin(azimuth) * Math.cos(rise),
    Math.sin(rise),
  );
}

// Look at the arm from where its drift is seen best: at the largest gap on the screen, in parts of
// the picture, between where the most displaced place stands at the end and where it stood at the
// start, as far as nothing hides either, nor the hand. `usual`: the direction that counts where
// views are alike, or nothing is off
export function clearest(arms, usual) {
  const T = MeshCat.THREE;
  const { arm, before, after } = displaced(arms);
  if (!(arm.data.off.at(-1)[1] > 1e-4) || !arm.spot) return usual;
  const spotAt = (i) => {
    arm.pose(i, 0);
    return arm.partSpot();
  };
  const start = spotAt(0);
  const end = spotAt(arm.frames - 1);
  const centre = (points) => new T.Box3().setFromPoints(points).getCenter(new T.Vector3());
  const was = centre(before);
  const is = centre(after);
  const tip = arm.point("tip", 0, arm.frames - 1);
  const others = [...arm.moving, ...arm.still]
    .filter((place) => !arm.part.includes(arm.moving.indexOf(place)))
    .flatMap(boxOf);
  const all = others.flatMap(({ corners: c }) => c);
  const own = arm.part.flatMap((k) => boxOf(arm.moving[k]));
  const plan = Math.atan2(usual.y, usual.x);
  let best = { score: -1 };
  for (const rise of [0.2, 0.5])
    for (let k = 0; k < 24; k++) {
      const turn = (k * Math.PI) / 12;
      const out = new T.Vector3(
        Math.cos(plan + turn) * Math.cos(rise),
        Math.sin(plan + turn) * Math.cos(rise),
        Math.sin(rise),
      );
      const across = (v) => Math.sqrt(Math.max(0, v.lengthSq() - v.dot(out) ** 2));
      const gap = (p, q) => across(p.clone().sub(q));
      const size = Math.max(...all.map((p) => gap(p, is)));
      const seen = after.filter((p) => !hidden(p, out, others)).length / after.length;
      const shown =
        (0.15 + 0.85 * seen) *
        (hidden(end, out, others) ? 0.3 : hidden(end, out, own) ? 0.7 : 1) *
        (hidden(is, out, others) ? 0.5 : 1) *
        (hidden(tip, out, others) ? 0.85 : 1);
      const score = ((gap(end, start) + gap(is, was)) / size) * shown * (1 + 0.15 * Math.cos(turn));
      if (score > best.score) best = { score, out };
    }
  return best.out;
}

// A body as a box in its own axes, a little smaller, for rays; and its corners.
function boxOf(place) {
  const T = MeshCat.THREE;
  place.updateMatrix();
  return place.children
    .filter((mesh) => mesh.isMesh && !mesh.geometry.boundingBox.isEmpty())
    .map((mesh) => {
      mesh.updateMatrix();
      const { min, max } = mesh.geometry.boundingBox;
      const matrix = new T.Matrix4().multiplyMatrices(place.matrix, mesh.matrix);
      const box = new T.Box3(min.clone().lerp(max, 0.1), max.clone().lerp(min, 0.1));
      return {
        box,
        inverse: matrix.clone().invert(),
        corners: cornersOf({ min, max }).map((corner) => corner.applyMatrix4(matrix)),
      };
    });
}

// Whether a body stands between a point and a camera far out; what surrounds the point itself does
// not count.
function hidden(point, out, boxes) {
  const ray = new MeshCat.THREE.Ray();
  return boxes.some(({ box, inverse }) => {
    ray.set(point, out).applyMatrix4(inverse);
    return !box.containsPoint(ray.origin) && ray.intersectsBox(box);
  });
}
