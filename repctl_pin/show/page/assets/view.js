"use strict";
// The picture: meshcat's viewer, light and floor, and a camera that finds its own place.

const byId = (id) => document.getElementById(id);

async function unpack(id) {
  const text = atob(byId(id).textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  byId(id).remove();
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// ---- the viewer ---------------------------------------------------------------------------------

async function openViewer(scene, errors, progress) {
  const code = document.createElement("script");
  code.textContent = new TextDecoder().decode(await unpack("viewer-code"));
  document.head.append(code);
  const pane = byId("pane");
  const viewer = new MeshCat.Viewer(pane, false);
  viewer.gui.domElement.style.display = "none";
  viewer.set_3d_pane_size = function () {
    this.camera.aspect = pane.clientWidth / Math.max(pane.clientHeight, 1);
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(pane.clientWidth, pane.clientHeight);
    this.set_dirty();
  };
  const stream = await unpack("commands");
  const lengths = new DataView(stream.buffer);
  let start = 0, done = 0;
  while (start < stream.length) {
    const length = lengths.getUint32(start, true);
    try {
      viewer.handle_command_bytearray(stream.slice(start + 4, start + 4 + length));
    } catch (error) {
      errors.push("a body could not be drawn: " + error.message);
    }
    start += 4 + length;
    if (++done % 4 === 0) { progress(start / stream.length); await new Promise((go) => setTimeout(go)); }
  }
  return viewer;
}

async function picturesLoaded(root) {
  const waiting = () => {
    let open = 0;
    root.traverse((node) => {
      for (const material of [node.material].flat())
        if (material && material.map && !(material.map.image && material.map.image.complete !== false)) open++;
    });
    return open;
  };
  for (let i = 0; i < 200 && waiting(); i++) await new Promise((go) => setTimeout(go, 25));
}

// ---- light and floor ----------------------------------------------------------------------------

// From over the viewer's shoulder: shadows fall behind the arms, not on their neighbours.
function light(viewer, center, size, eye) {
  const T = MeshCat.THREE, from = (right, back, up) => new T.Vector3(0, 0, up * size).addScaledVector(eye.right, right * size).addScaledVector(eye.out, back * size).add(center);
  const above = Math.abs(eye.out.z) > 0.9; // then the light comes slanting, or nothing would have form
  const sky = new T.HemisphereLight(0xffffff, 0xc3ccd6, above ? 0.6 : 0.7);
  sky.position.set(0, 0, 1);
  const key = new T.DirectionalLight(0xffffff, 0.36), fill = new T.DirectionalLight(0xe6eeff, 0.2);
  key.position.copy(above ? from(-1.5, -0.2, 1.9).addScaledVector(eye.up, 1.1 * size) : from(-0.25, 1.1, 2));
  key.target.position.copy(center);
  fill.position.copy(from(1.6, 0.4, above ? -0.2 : 0.4));
  fill.target.position.copy(center);
  key.castShadow = true;
  key.shadow.mapSize.set(2048, 2048);
  key.shadow.radius = 5;
  key.shadow.bias = -0.0006;
  key.shadow.normalBias = 0.006 * size;
  Object.assign(key.shadow.camera, { left: -1.6 * size, right: 1.6 * size, top: 1.6 * size, bottom: -1.6 * size, near: 0.05 * size, far: 6 * size });
  viewer.scene.add(sky, key, key.target, fill, fill.target);
}

function niceStep(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return [5, 2, 1].map((k) => k * power).find((step) => step <= length * 1.0001) || power;
}

// `size`: of one arm, `width`: of all
function floor(viewer, center, z, size, width) {
  const T = MeshCat.THREE, step = niceStep(size / 7), cells = 10 * Math.ceil(Math.min(Math.max(40, (2.4 * width) / step), 120) / 10), pixels = 2048;
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = pixels;
  const draw = canvas.getContext("2d");
  for (let k = 0; k <= cells; k++) {
    const x = (k / cells) * pixels;
    draw.strokeStyle = (k - cells / 2) % 5 === 0 ? "rgba(92,108,126,.50)" : "rgba(92,108,126,.26)";
    draw.lineWidth = (k - cells / 2) % 5 === 0 ? 2.2 : 1.6;
    draw.beginPath(); draw.moveTo(x, 0); draw.lineTo(x, pixels); draw.moveTo(0, x); draw.lineTo(pixels, x); draw.stroke();
  }
  const fade = draw.createRadialGradient(pixels / 2, pixels / 2, pixels * 0.1, pixels / 2, pixels / 2, pixels * 0.5);
  fade.addColorStop(0, "rgba(0,0,0,1)"); fade.addColorStop(1, "rgba(0,0,0,0)");
  draw.globalCompositeOperation = "destination-in"; draw.fillStyle = fade; draw.fillRect(0, 0, pixels, pixels);
  const texture = new T.CanvasTexture(canvas);
  texture.anisotropy = viewer.renderer.capabilities.getMaxAnisotropy();
  const sheet = new T.PlaneGeometry(cells * step, cells * step);
  const grid = new T.Mesh(sheet, new T.MeshBasicMaterial({ map: texture, transparent: true, depthWrite: false }));
  const shade = new T.Mesh(sheet, new T.ShadowMaterial({ opacity: 0.1, depthWrite: false }));
  const snap = (v) => Math.round(v / step) * step;
  for (const mesh of [grid, shade]) { mesh.position.set(snap(center.x), snap(center.y), z - 0.002 * size); mesh.renderOrder = -1; viewer.scene.add(mesh); }
  shade.receiveShadow = true;
  return step;
}

// ---- the camera ---------------------------------------------------------------------------------

class Eye {
  // `towards`: from what is looked at to the camera, robot axes (z up)
  constructor(viewer, towards) {
    const T = MeshCat.THREE;
    this.viewer = viewer;
    this.out = towards.clone().normalize();
    this.right = new T.Vector3(0, 0, 1).cross(this.out).normalize();
    this.up = new T.Vector3().crossVectors(this.out, this.right);
    viewer.camera.fov = 16;
  }

  span(points, axis) {
    const along = points.map((p) => p.dot(this[axis]));
    return [along.reduce((a, b) => Math.min(a, b), Infinity), along.reduce((a, b) => Math.max(a, b), -Infinity)];
  }

  // Go where all points are in the picture, with room above for the labels.
  fit(points) {
    const { camera, controls } = this.viewer, T = MeshCat.THREE;
    const tall = Math.tan((camera.fov * Math.PI) / 360), wide = tall * camera.aspect;
    const height = this.viewer.dom_element.clientHeight || 1;
    const free = { x: 0.9, top: 1 - Math.min(0.3, 2 * 62 / height), bottom: 0.92 };
    const center = new T.Vector3();
    for (const p of points) center.addScaledVector(p, 1 / points.length);
    let distance = 1;
    for (let round = 0; round < 12; round++) {
      distance = 0;
      for (const p of points) {
        const v = p.clone().sub(center), y = v.dot(this.up);
        distance = Math.max(distance, v.dot(this.out) + Math.max(Math.abs(v.dot(this.right)) / (wide * free.x), y / (tall * free.top), -y / (tall * free.bottom)));
      }
      const spread = { right: [Infinity, -Infinity], up: [Infinity, -Infinity] };
      for (const p of points) {
        const v = p.clone().sub(center), depth = distance - v.dot(this.out);
        for (const axis of ["right", "up"]) {
          const at = v.dot(this[axis]) / depth;
          spread[axis] = [Math.min(spread[axis][0], at), Math.max(spread[axis][1], at)];
        }
      }
      center.addScaledVector(this.right, (distance * (spread.right[0] + spread.right[1])) / 2);
      center.addScaledVector(this.up, distance * ((spread.up[0] * free.top + spread.up[1] * free.bottom) / (free.top + free.bottom)));
    }
    const world = (v) => new T.Vector3(v.x, v.z, -v.y); // three's y is up
    camera.near = distance / 100; camera.far = distance * 20;
    camera.position.copy(world(center.clone().addScaledVector(this.out, distance)));
    controls.target.copy(world(center));
    controls.update();
    camera.updateProjectionMatrix();
    this.viewer.set_dirty();
  }
}
