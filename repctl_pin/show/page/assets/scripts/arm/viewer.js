// meshcat's viewer: opened, filled with the bodies, lit, and set on a floor.

import { byId } from "../dom.js";
import { niceStep } from "../numbers.js";
import { unpack } from "../unpack.js";

export async function openViewer(errors, progress) {
  const code = document.createElement("script");
  code.textContent = new TextDecoder().decode(await unpack("viewer-code"));
  document.head.append(code);
  const viewer = new MeshCat.Viewer(byId("picture"), false);
  viewer.gui.domElement.remove();
  const stream = await unpack("commands");
  const lengths = new DataView(stream.buffer);
  let start = 0;
  let done = 0;
  while (start < stream.length) {
    const length = lengths.getUint32(start, true);
    try {
      viewer.handle_command_bytearray(stream.slice(start + 4, start + 4 + length));
    } catch (error) {
      errors.push("a body could not be drawn: " + error.message);
    }
    start += 4 + length;
    if (++done % 4 === 0) {
      progress(start / stream.length);
      await new Promise((go) => setTimeout(go));
    }
  }
  viewer.hide_background();
  return viewer;
}

// From over the viewer's shoulder: shadows fall behind the arm.
export function light(viewer, center, size, eye) {
  const T = MeshCat.THREE;
  const from = (right, back, up) =>
    new T.Vector3(0, 0, up * size)
      .addScaledVector(eye.right, right * size)
      .addScaledVector(eye.out, back * size)
      .add(center);
  // then the light comes slanting, or nothing would have form
  const above = Math.abs(eye.out.z) > 0.9;
  const sky = new T.HemisphereLight(0xffffff, 0xc3ccd6, above ? 0.6 : 0.7);
  sky.position.set(0, 0, 1);
  const key = new T.DirectionalLight(0xffffff, 0.36);
  const fill = new T.DirectionalLight(0xe6eeff, 0.2);
  key.position.copy(
    above ? from(-1.5, -0.2, 1.9).addScaledVector(eye.up, 1.1 * size) : from(-0.25, 1.1, 2),
  );
  key.target.position.copy(center);
  fill.position.copy(from(1.6, 0.4, above ? -0.2 : 0.4));
  fill.target.position.copy(center);
  key.castShadow = true;
  key.shadow.mapSize.set(2048, 2048);
  key.shadow.radius = 5;
  key.shadow.bias = -0.0006;
  key.shadow.normalBias = 0.006 * size;
  Object.assign(key.shadow.camera, {
    left: -1.6 * size,
    right: 1.6 * size,
    top: 1.6 * size,
    bottom: -1.6 * size,
    near: 0.05 * size,
    far: 6 * size,
  });
  viewer.scene.add(sky, key, key.target, fill, fill.target);
}

// A floor at height z, its grid fit for an arm of this size; gives the grid's step, m.
export function floor(viewer, center, z, size) {
  const T = MeshCat.THREE;
  const step = niceStep(size / 7);
  const cells = 60;
  const pixels = 2048;
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = pixels;
  const draw = canvas.getContext("2d");
  for (let k = 0; k <= cells; k++) {
    const x = (k / cells) * pixels;
    draw.strokeStyle =
      (k - cells / 2) % 5 === 0 ? "rgba(112,128,146,.55)" : "rgba(112,128,146,.28)";
    draw.lineWidth = (k - cells / 2) % 5 === 0 ? 2.2 : 1.6;
    draw.beginPath();
    draw.moveTo(x, 0);
    draw.lineTo(x, pixels);
    draw.moveTo(0, x);
    draw.lineTo(pixels, x);
    draw.stroke();
  }
  const fade = draw.createRadialGradient(
    pixels / 2,
    pixels / 2,
    pixels * 0.1,
    pixels / 2,
    pixels / 2,
    pixels * 0.5,
  );
  fade.addColorStop(0, "rgba(0,0,0,1)");
  fade.addColorStop(1, "rgba(0,0,0,0)");
  draw.globalCompositeOperation = "destination-in";
  draw.fillStyle = fade;
  draw.fillRect(0, 0, pixels, pixels);
  const texture = new T.CanvasTexture(canvas);
  texture.anisotropy = viewer.renderer.capabilities.getMaxAnisotropy();
  const sheet = new T.PlaneGeometry(cells * step, cells * step);
  const grid = new T.Mesh(
    sheet,
    new T.MeshBasicMaterial({ map: texture, transparent: true, depthWrite: false }),
  );
  const shade = new T.Mesh(sheet, new T.ShadowMaterial({ opacity: 0.12, depthWrite: false }));
  const snap = (v) => Math.round(v / step) * step;
  for (const mesh of [grid, shade]) {
    mesh.position.set(snap(center.x), snap(center.y), z - 0.002 * size);
    mesh.renderOrder = -1;
    viewer.scene.add(mesh);
  }
  shade.receiveShadow = true;
  return step;
}
