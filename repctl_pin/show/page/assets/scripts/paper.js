// For print: the end of the motion on white, each arm under its own name.

import { byId, element } from "./dom.js";

export function still(viewer, clock, arms, panes) {
  const { domElement } = viewer.renderer, scale = viewer.renderer.getPixelRatio(), { time } = clock, { width, height } = panes.place(0);
  const columns = width > 1.2 * height ? Math.min(2, arms.length) : Math.min(3, arms.length), rows = Math.ceil(arms.length / columns), head = 34 * scale;
  const paper = element("canvas", { width: Math.round(columns * width * scale), height: Math.round(rows * (height * scale + head)) }), draw = paper.getContext("2d");
  draw.fillStyle = "#ffffff";
  draw.fillRect(0, 0, paper.width, paper.height);
  clock.seek(clock.cycles);
  viewer.renderer.setClearColor("#ffffff", 1);
  viewer.render();
  draw.font = `600 ${17 * scale}px sans-serif`;
  arms.forEach(({ data }, k) => {
    const { left, top, width: w, height: h } = panes.place(k), x = (k % columns) * width * scale, y = Math.floor(k / columns) * (height * scale + head);
    draw.drawImage(domElement, left * scale, top * scale, w * scale, h * scale, x, y + head, w * scale, h * scale);
    draw.fillStyle = data.color;
    draw.fillText(data.title, x + 12 * scale, y + 24 * scale);
  });
  panes.colour();
  clock.seek(time);
  return paper;
}

export function printable(draw) {
  window.addEventListener("beforeprint", () => byId("paper").replaceChildren(draw()));
}
