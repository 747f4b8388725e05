// The time line: over the slider, for each cycle how far each arm is off at its end.

import { byId, element, sharp, tone } from "../dom.js";
import { inMetres, inWords, niceStep } from "../numbers.js";

const INSET = 8; // px: the slider's thumb is as far inside its ends
const SCALE = 0.1; // m, which bars reach at least up to

export class Chart {
  // `seek`: goes to the end of a shown cycle
  constructor(arms, scene, seek) {
    const canvas = byId("chart");
    Object.assign(this, { arms, scene, canvas, gain: 1 });
    canvas.addEventListener("click", ({ offsetX }) => {
      const last = scene.cycles.length;
      seek(
        Math.min(
          last,
          Math.max(1, Math.ceil(((offsetX - INSET) / (canvas.clientWidth - 2 * INSET)) * last)),
        ),
      );
    });
    this.values = arms.map(({ data }) => {
      const value = element("b");
      byId("readings").append(
        element(
          "p",
          { class: "reading", style: `--arm: ${data.color}` },
          element("span", { class: "chip" }),
          ` ${data.title}: `,
          value,
        ),
      );
      return value;
    });
  }

  // Give the readings the room of their longest words, so that nothing moves while time goes.
  reserve() {
    const box = byId("readings");
    const { cycles } = this.scene;
    box.style.minWidth = "";
    this.canvas.setAttribute("aria-valuemax", cycles.at(-1));
    const { values } = this;
    const most = values.map(() => 0);
    for (const value of values) value.style.minWidth = "";
    const widths = [0, ...cycles.keys()].map((c, k) => {
      this.say(k ? cycles[c] : 0, c, k ? 1 : 0);
      values.forEach((value, i) => {
        most[i] = Math.max(most[i], value.offsetWidth);
      });
      return box.scrollWidth;
    });
    if (this.scene.own)
      // numbers of any loop find room
      values.forEach((value, i) => {
        value.textContent = "0.88 mm off";
        most[i] = Math.max(most[i], value.offsetWidth);
        widths.push(box.scrollWidth);
      });
    values.forEach((value, i) => {
      value.style.minWidth = `${most[i] + 1}px`;
    });
    box.style.minWidth = `${Math.max(...widths)}px`;
  }

  // How far an arm is off after the cycles that are finished when time is here, m.
  after(arm, cycle, part) {
    return arm.data.off[cycle][part >= 1 ? 1 : 0];
  }

  // `done`: number of the last cycle that is finished, 0 at the start; `cycle`, `part`: where time is; gives the words of say()
  show(done, cycle, part) {
    const times = this.say(done, cycle, part);
    this.canvas.setAttribute("aria-valuenow", done);
    this.canvas.setAttribute(
      "aria-valuetext",
      this.arms
        .map((arm) => `${arm.data.title}: ${inMetres(this.after(arm, cycle, part))} off ${times}`)
        .join("; "),
    );
    this.draw(cycle, part);
    return times;
  }

  // Write the readings; gives the words for when they hold.
  say(done, cycle, part) {
    const times = done ? `after ${done === 1 ? "1 cycle" : `${done} cycles`}` : "at the start";
    byId("done").textContent = `${times[0].toUpperCase()}${times.slice(1)}`;
    this.values.forEach((value, k) => {
      const arm = this.arms[k];
      const { data } = arm;
      const off = this.after(arm, cycle, part);
      const joints = done ? data.drift[done - 1] : 0;
      value.textContent = `${inMetres(off)} off`;
      value.className = tint(off);
      value.title = `${off.toPrecision(3)} m; joints ${joints < 1e-6 ? 0 : inWords(joints)} ${data.unit}, root of the sum of squares`;
    });
    return times;
  }

  draw(cycle, part) {
    if (!this.canvas.clientWidth) return;
    const { draw, width, height, em } = sharp(this.canvas);
    const { arms, scene } = this;
    const count = scene.cycles.length;
    const pitch = (width - 2 * INSET) / count;
    const foot = height - 1.15 * em;
    const room = foot - 0.5 * em;
    const at = (c) => INSET + c * pitch;
    const group = Math.min(0.66 * pitch, 4.5 * em);
    const wide = group / arms.length;
    const top = Math.max(SCALE / this.gain, ...arms.flatMap(({ data }) => data.off.flat()));
    const scale = niceStep(top);
    const level = (v) => foot - (v / top) * room;
    draw.font = `${0.78 * em}px ${getComputedStyle(document.body).fontFamily}`;
    draw.strokeStyle = tone("--edge");
    draw.fillStyle = tone("--soft");
    draw.lineWidth = 1;
    line(draw, INSET, level(scale), width - INSET, level(scale), [3, 4]);
    line(draw, INSET, foot + 0.5, width - INSET, foot + 0.5, []);
    const every = Math.ceil((1.6 * em) / pitch);
    for (let c = 0; c < count; c++) {
      const finished = c < cycle || (c === cycle && part >= 1);
      arms.forEach((arm, k) => {
        const x = at(c + 1) - group + k * wide;
        const off = arm.data.off[c][1];
        const tall = Math.max(0.13 * em, foot - level(off)); // a zero is seen, too
        draw.fillStyle = arm.data.color;
        draw.globalAlpha = finished ? 1 : 0.3;
        draw.fillRect(x, foot - tall, Math.max(wide - (wide > 4 ? 1 : 0), 0.8), tall);
        const { broken } = arm.data;
        if (broken && scene.cycles[c] >= broken.cycle)
          hatch(draw, x, foot - tall, wide, tall, 0.3 * em);
        draw.globalAlpha = 1;
      });
      draw.fillStyle = tone("--soft");
      draw.textAlign = "center";
      if ((count - 1 - c) % every === 0)
        draw.fillText(scene.cycles[c], at(c + 1) - group / 2, height - 0.25 * em);
    }
    draw.textAlign = "left";
    if (draw.measureText("cycle").width + 1.2 * em < pitch - group / 2)
      draw.fillText("cycle", INSET + 2, height - 0.25 * em);
    const beside = room < 2 * em ? 0.3 : top > 1.4 * scale ? -0.3 : 0.95; // in the line, over it or under it
    if (room > 0.8 * em)
      haloed(
        draw,
        inMetres(scale),
        INSET + 2,
        Math.max(level(scale) + beside * em, 0.75 * em),
        0.3 * em,
      );
    draw.strokeStyle = tone("--ink");
    draw.lineWidth = 1.5;
    line(draw, at(cycle + part), 0, at(cycle + part), foot, []);
  }
}

// What is off by a centimetre and more is wrong; what is back is right.
export const tint = (off) => (off >= 0.01 ? "bad" : off < 1e-4 ? "good" : "");

function line(draw, x0, y0, x1, y1, dash) {
  draw.setLineDash(dash);
  draw.beginPath();
  draw.moveTo(x0, y0);
  draw.lineTo(x1, y1);
  draw.stroke();
  draw.setLineDash([]);
}

// Text that stays legible where bars pass behind it.
function haloed(draw, words, x, y, width) {
  Object.assign(draw, {
    textAlign: "left",
    lineJoin: "round",
    lineWidth: width,
    strokeStyle: tone("--paper"),
    fillStyle: tone("--soft"),
  });
  draw.strokeText(words, x, y);
  draw.fillText(words, x, y);
}

function hatch(draw, x, y, width, height, step) {
  draw.save();
  draw.beginPath();
  draw.rect(x, y, width, height);
  draw.clip();
  draw.strokeStyle = tone("--paper");
  draw.lineWidth = 0.35 * step;
  draw.beginPath();
  for (let s = -height; s < width; s += step) {
    draw.moveTo(x + s, y + height);
    draw.lineTo(x + s + height, y);
  }
  draw.stroke();
  draw.restore();
}
