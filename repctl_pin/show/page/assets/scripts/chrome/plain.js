// Without WebGL: each arm as a line from its first body over the elbow to the hand, at the start
// and at the end, and the chart.

import { Chart } from "./chart.js";
import { byId, element, sharp, sizeOf, summed, tone, whenResized } from "../dom.js";
import { formatLength } from "../numbers.js";
import { unpack } from "../unpack.js";

export async function drawPlain(scene, reason) {
  const motion = summed(await unpack("motion"), scene.series, scene.resolution);
  const last = scene.cycles.length * scene.perCycle - 1;
  let at = 0;
  const arms = scene.arms.map((data) => {
    const moving = data.shapes.filter(({ pose }) => !pose);
    const posed = moving.length + (data.carried ? 1 : 0); // a workpiece that moves comes last
    const frames = last + 1;
    const chains = Array.from({ length: data.chains }, (_, k) => k);
    const start = at;
    const tip = start + frames * 7 * posed;
    const elbow = tip + frames * 3 * data.chains;
    at =
      elbow +
      frames * 3 * data.chains +
      (data.broken ? 3 * frames : 0) +
      moving.reduce((sum, { points }) => sum + 3 * points, 0);
    const point = (from, size, i, k = 0) => [
      ...motion.subarray(from + i * size + 3 * k, from + i * size + 3 * k + 3),
    ];
    const pose = (i) =>
      chains.map((k) => [
        point(start, 7 * posed, i),
        point(elbow, 3 * data.chains, i, k),
        point(tip, 3 * data.chains, i, k),
      ]);
    return { data, before: pose(0), after: pose(last) };
  });
  const paths = scene.paths.map((count) =>
    Array.from({ length: count }, () => {
      at += 3;
      return [...motion.subarray(at - 3, at)];
    }),
  );
  document.body.classList.add("plain-view");
  byId("drift-note").textContent =
    `No 3D view: ${reason}. First link, elbow and hand; grey: at the start, ` +
    `in colour: after ${scene.cycles.at(-1)} cycles.`;
  byId("scale-note").hidden = true;
  const canvases = arms.map(({ data }) => {
    const canvas = element("canvas", {
      role: "img",
      "aria-label":
        `${data.title}: the arm at the start and after ${scene.cycles.at(-1)} cycles, ` +
        `${formatLength(data.off.at(-1)[1])} from its start`,
    });
    byId("panes").append(
      element(
        "div",
        { class: "pane", style: `--arm: ${data.color}` },
        canvas,
        element(
          "p",
          { class: "arm-label" },
          element(
            "span",
            { class: "name" },
            element("span", { class: "chip" }),
            `${data.title}: ${formatLength(data.off.at(-1)[1])} from its start`,
          ),
        ),
      ),
    );
    return canvas;
  });
  const chart = new Chart(arms, scene, () => {});
  const draw = () => {
    const { clientWidth: w, clientHeight: h } = byId("panes");
    byId("panes").style.gridTemplateColumns = `repeat(${h > w ? 1 : arms.length}, minmax(0, 1fr))`;
    chart.reserve();
    chart.show(scene.cycles.at(-1), scene.cycles.length - 1, 1);
    canvases.forEach((canvas, k) => drawArm(canvas, arms[k], arms, paths, scene.planar));
  };
  whenResized(byId("panes"), draw);
  draw();
}

function drawArm(canvas, { data, before, after }, arms, paths, planar) {
  const seen = ([x, y, z]) =>
    // from the front, a little from above
    planar ? [x, -y] : [0.68 * x - 0.73 * y, 0.24 * x + 0.22 * y - 0.94 * z];
  const all = [...arms.flatMap((arm) => [arm.before, arm.after]).flat(2), ...paths.flat()].map(
    seen,
  );
  const ends = [0, 1]
    .map((i) => all.map((p) => p[i]))
    .map((v) => [v.reduce((a, b) => Math.min(a, b)), v.reduce((a, b) => Math.max(a, b))]);
  const size = sizeOf(canvas);
  const { width, height, em } = size;
  const draw = sharp(canvas, size);
  const [[left, right], [top, bottom]] = ends;
  const room = [width - 4 * em, height - 9 * em];
  const scale = Math.min(
    room[0] / Math.max(right - left, 1e-9),
    room[1] / Math.max(bottom - top, 1e-9),
  );
  const place = (p) => {
    const [x, y] = seen(p);
    return [
      width / 2 + scale * (x - (left + right) / 2),
      height / 2 + scale * (y - (top + bottom) / 2),
    ];
  };
  const line = (points, color, wide) => {
    Object.assign(draw, {
      strokeStyle: color,
      lineWidth: wide,
      lineJoin: "round",
      lineCap: "round",
    });
    draw.beginPath();
    points.map(place).forEach(([x, y], i) => (i ? draw.lineTo(x, y) : draw.moveTo(x, y)));
    draw.stroke();
  };
  for (const path of paths) line(path, tone("--edge"), 0.1 * em);
  for (const limb of before) line(limb, tone("--body"), 0.8 * em);
  for (const limb of after) line(limb, data.color, 0.4 * em);
}
