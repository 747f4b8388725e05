// One pane an arm, all drawn by one camera: turning one turns all.

import { PIXEL } from "../arm/outline.js";
import { byId, element, tone } from "../dom.js";

export const LOW = 360; // px
const NARROW = 180; // px, below which a pane cannot hold its label and what is said of the part

const NAMED = 340; // px, from which a pane has room for what its control is called in brackets

export class Panes {
  // `ratio`: width to height of what a pane shows
  constructor(viewer, eye, arms, ratio) {
    Object.assign(this, { viewer, eye, arms, ratio });
    this.frames = arms.map((arm) => {
      arm.notice = element("span", { class: "past" });
      return element(
        "div",
        { class: "pane", style: `--arm: ${arm.data.color}` },
        element(
          "p",
          { class: "arm-label", title: arm.data.about },
          element(
            "span",
            { class: "name" },
            element("span", { class: "chip" }),
            arm.data.title,
            element("span", { class: "more" }, arm.data.law),
          ),
          arm.notice,
        ),
      );
    });
    byId("panes").append(...this.frames);
    this.measure();
    viewer.render = () => this.render();
    viewer.set_3d_pane_size = () => {};
  }

  // Hide all panes, with what is written in them, or show them.
  hide(on) {
    for (const frame of this.frames) frame.classList.toggle("opening", on);
  }

  // Stack a few panes in portrait; else give the stage as many columns as make their pictures
  // largest.
  layout() {
    const { clientWidth: width, clientHeight: height } = byId("panes");
    const count = this.arms.length;
    // a pane's label and what is said of the part take some of its height
    const kept = 3 * this.frames[0].firstChild.clientHeight;
    const size = (columns) =>
      Math.min(width / columns / this.ratio, height / Math.ceil(count / columns) - kept);
    const stacked = height > width || width < NARROW * count;
    let best = stacked && count < 4 ? 1 : count;
    for (let columns = best; columns >= 1; columns--)
      if (size(columns) > 1.02 * size(best)) best = columns;
    byId("panes").style.gridTemplateColumns = `repeat(${best}, minmax(0, 1fr))`;
    // what is pressed stays in its pane
    const stage = byId("stage");
    const wide = Math.round(width / best);
    stage.classList.toggle("in-columns", best > 1);
    stage.classList.toggle("narrow", wide < NAMED);
    stage.style.setProperty("--pane", `${wide}px`);
    this.viewer.renderer.setSize(width, height);
    this.measure();
    this.inRows();
    const [first] = this.places;
    this.size = { width: Math.max(first.width, 1), height: Math.max(first.height, 1) };
    Object.assign(this.size, this.room());
    this.eye.aspect(this.size.width / this.size.height);
    if (PIXEL.value) PIXEL.value.set(2 / this.size.width, 2 / this.size.height);
    this.colour();
  }

  // Decide whether all panes have room for what is said of the part beside their labels, in this
  // run.
  inRows() {
    this.beside =
      this.frames[0].clientHeight < LOW &&
      this.frames.every((frame, k) => this.inOneRow(frame, this.arms[k]));
  }

  // Whether a pane's label and what is said of the part fit into one row at all times.
  inOneRow(frame, { data, notice }) {
    const label = frame.firstChild;
    const box = frame.querySelector(".callout:not(.hand)");
    const value = box && box.firstChild;
    if (!box) return true;
    const words = [notice.textContent, value.textContent];
    notice.textContent = data.broken ? data.broken.words : "";
    value.textContent = value.widest;
    const fits = label.offsetLeft + label.offsetWidth + box.offsetWidth + 16 <= frame.clientWidth;
    [notice.textContent, value.textContent] = words;
    return fits;
  }

  // What a pane keeps free above the arm, for its label and what is said of the part, and below it,
  // px.
  room() {
    const label = this.frames[0].firstChild.clientHeight * 1.5;
    const low = this.frames[0].clientHeight < LOW;
    const box = this.frames[0].querySelector(".callout:not(.hand)");
    const above = box ? box.offsetHeight : 0;
    const stage = byId("panes");
    const left = (node) => stage.offsetTop + stage.offsetHeight - node.offsetTop;
    const legend = byId("legend");
    const covered = legend && legend.offsetHeight ? left(legend) + 4 : 0;
    return {
      above: this.beside ? Math.max(label, above + 12) : label + above,
      below: Math.max(low ? Math.max(left(byId("below")), 10) + 8 : label, covered),
    };
  }

  colour() {
    this.viewer.renderer.setClearColor(tone("--stage"), 1);
    this.viewer.set_dirty();
  }

  // Where a pane is on the stage: left, top, width, height, in pixels; as measured last, since to
  // ask lays the page out.
  measure() {
    this.sizes = new Map();
    this.tall = byId("panes").clientHeight;
    this.places = this.frames.map(
      ({ offsetLeft: left, offsetTop: top, clientWidth: width, clientHeight: height }) => ({
        left,
        top,
        width,
        height,
      }),
    );
  }
  place(k) {
    return this.places[k];
  }

  // Where a label of words stands before it is moved, and its size, in pixels: as measured when
  // words of this form, whose digits are equally wide, were there last.
  sizeOf(node) {
    const { className } = document.body;
    const form = `${node.className} ${node.textContent}`.replace(/\d/g, "0");
    const key = `${this.frames.indexOf(node.parentNode)} ${className} ${form}`;
    if (!this.sizes.has(key)) {
      const { offsetLeft: x, offsetTop: y, offsetWidth: w, offsetHeight: h } = node;
      this.sizes.set(key, { x, y, w, h });
    }
    return this.sizes.get(key);
  }

  // Where a point is seen in a pane, in pixels from its corner; and the line of sight through such
  // a place, robot axes.
  seen(k, p) {
    const { width, height } = this.place(k);
    const { camera } = this.viewer;
    camera.updateMatrixWorld();
    const v = new MeshCat.THREE.Vector3(p.x, p.z, -p.y).project(camera); // three's y is up
    return { x: ((v.x + 1) / 2) * width, y: ((1 - v.y) / 2) * height };
  }
  sight(k, { x, y }) {
    const { width, height } = this.place(k);
    const T = MeshCat.THREE;
    const at = (depth) => {
      const v = new T.Vector3((2 * x) / width - 1, 1 - (2 * y) / height, depth).unproject(
        this.viewer.camera,
      );
      return new T.Vector3(v.x, -v.z, v.y);
    };
    return new T.Ray(at(-1), at(1).sub(at(-1)).normalize());
  }

  render() {
    const { renderer, scene, camera, controls } = this.viewer;
    const { tall } = this;
    controls.update();
    renderer.setScissorTest(true);
    // once for all panes, and not of what is hidden in all
    for (const arm of this.arms) arm.group.visible = true;
    placeVisible(scene);
    for (const arm of this.arms) arm.drawJoined();
    camera.updateWorldMatrix(true, false);
    scene.autoUpdate = false;
    this.arms.forEach((arm, k) => {
      const { left, top, width, height } = this.place(k);
      const low = tall - top - height;
      this.arms.forEach((other) => {
        other.group.visible = other === arm;
      });
      renderer.setViewport(left, low, width, height);
      renderer.setScissor(left, low, width, height);
      renderer.render(scene, camera);
    });
    scene.autoUpdate = true;
    if (this.drawn) this.drawn();
    this.viewer.needs_render = false;
  }
}

// Place what is seen below a node in the world.
function placeVisible(node) {
  if (!node.visible) return;
  if (node.matrixAutoUpdate) node.updateMatrix();
  if (node.parent) node.matrixWorld.multiplyMatrices(node.parent.matrixWorld, node.matrix);
  else node.matrixWorld.copy(node.matrix);
  for (const child of node.children) placeVisible(child);
}
