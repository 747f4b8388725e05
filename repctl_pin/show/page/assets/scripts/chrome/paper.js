// For print: the end of the motion on white, in the light colours, each arm under its own name.

import { byId, element, forgetTones } from "../dom.js";
import { formatLength } from "../numbers.js";

const WIDE = 1800; // px
// the stage, whatever the window
const SHEET = "position: fixed; left: 0; top: 0; width: 1400px; height: 640px";

export function still(viewer, clock, arms, panes, resize) {
  byId("stage").style.cssText = SHEET;
  resize();
  const { renderer } = viewer;
  const { domElement } = renderer;
  const { time } = clock;
  const { width, height } = panes.place(0);
  const before = renderer.getPixelRatio();
  const columns = width > 1.2 * height ? Math.min(2, arms.length) : Math.min(3, arms.length);
  const rows = Math.ceil(arms.length / columns);
  const scale = Math.max(before, WIDE / (columns * width));
  const text = (columns * width * scale) / 80;
  const head = 2.2 * text;
  const paper = element("canvas", {
    width: Math.round(columns * width * scale),
    height: Math.round(rows * (height * scale + head)),
  });
  const draw = paper.getContext("2d");
  draw.fillStyle = "#ffffff";
  draw.fillRect(0, 0, paper.width, paper.height);
  const light = (on) => {
    document.documentElement.classList.toggle("on-paper", on);
    forgetTones();
  };
  light(true);
  renderer.setPixelRatio(scale);
  clock.seek(clock.cycles);
  renderer.setClearColor("#ffffff", 1);
  viewer.render();
  arms.forEach(({ data }, k) => {
    const { left, top, width: w, height: h } = panes.place(k);
    const x = (k % columns) * width * scale;
    const y = Math.floor(k / columns) * (height * scale + head);
    draw.drawImage(
      domElement,
      left * scale,
      top * scale,
      w * scale,
      h * scale,
      x,
      y + head,
      w * scale,
      h * scale,
    );
    draw.fillStyle = data.color;
    draw.font = `600 ${text}px sans-serif`;
    draw.fillText(
      `${data.title}: ${formatLength(data.off.at(-1)[1])} from its start`,
      x + 0.6 * text,
      y + 1.5 * text,
    );
  });
  light(false);
  renderer.setPixelRatio(before);
  byId("stage").style.cssText = "";
  resize();
  clock.seek(time);
  return paper;
}

export function printable(draw) {
  window.addEventListener("beforeprint", () => byId("paper").replaceChildren(draw()));
}
