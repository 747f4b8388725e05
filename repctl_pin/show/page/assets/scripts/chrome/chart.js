// The time line over the slider: how far each arm is off at the end of each cycle, or the joints.

import { byId, element, setAttribute, setColor, setText, sharp, sizeOf, tone } from "../dom.js";
import { formatLength, formatNumber, stepAbove } from "../numbers.js";

const INSET = 8; // px: the slider's thumb is as far inside its ends
const DOT = 2; // px, of a dotted bar
const LEAST_AXIS = 1e-3; // m, at which the axis of the bars ends, at least
const CONTRAST = 3; // of a bar to the paper, at least, as WCAG 2 measures it
const TEXT_CONTRAST = 5; // of words to it
// what hollow bars are, in the words that fit
const COMING = [" bars: cycles to come, computed ahead", " bars: cycles to come", ": to come"];

export class Chart {
  // `seek`: goes to the end of a shown cycle
  constructor(arms, scene, seek) {
    const canvas = byId("chart");
    Object.assign(this, { arms, scene, canvas });
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
        value.textContent = "0.88 mm";
        most[i] = Math.max(most[i], value.offsetWidth);
        widths.push(box.scrollWidth);
      });
    values.forEach((value, i) => {
      value.style.minWidth = `${most[i] + 1}px`;
    });
    box.style.minWidth = `${Math.max(...widths)}px`;
    this.size = sizeOf(this.canvas);
    this.font = getComputedStyle(document.body).fontFamily;
  }

  // How far an arm is off after the cycles that are finished when time is here, m.
  after(arm, cycle, part) {
    return arm.data.off[cycle][part >= 1 ? 1 : 0];
  }

  // `done`: number of the last cycle that is finished, 0 at the start; `cycle`, `part`: where time
  // is; gives the words of say()
  show(done, cycle, part) {
    const times = this.say(done, cycle, part);
    setAttribute(this.canvas, "aria-valuenow", done);
    setAttribute(
      this.canvas,
      "aria-valuetext",
      this.arms
        .map((arm, k) => `${arm.data.title}: ${this.values[k].textContent} ${times}`)
        .join("; "),
    );
    this.draw(cycle, part);
    return times;
  }

  // Write the readings; gives the words for when they hold.
  say(done, cycle, part) {
    const count = done === 1 ? "1 cycle" : `${done} cycles`;
    const times = done ? `after ${count}, from its start` : "at the start";
    const { idle } = this.scene;
    const when = idle ? "the loop was not followed" : times;
    setText(byId("done"), `${when[0].toUpperCase()}${when.slice(1)}`);
    this.values.forEach((value, k) => {
      const arm = this.arms[k];
      const { data } = arm;
      const off = this.after(arm, cycle, part);
      const known = off !== null;
      setText(value, idle ? "–" : known ? formatLength(off) : "not known");
      setColor(value, wordColour(data.color));
      const drift = done ? data.drift[done - 1] : 0;
      const joints = `${drift < 1e-6 ? 0 : formatNumber(drift)} ${data.unit}`;
      setAttribute(
        value,
        "title",
        known
          ? `${off.toPrecision(3)} m; joints ${joints}, root of the sum of squares`
          : "Close to a singularity the drift cannot be computed reliably",
      );
    });
    return times;
  }

  draw(cycle, part) {
    const { width, height, em } = this.size;
    if (!width) return;
    const draw = sharp(this.canvas, this.size);
    const count = this.scene.cycles.length;
    const pitch = (width - 2 * INSET) / count;
    const foot = Math.round(height - 1.15 * em);
    draw.font = `${0.78 * em}px ${this.font}`;
    draw.lineWidth = 1;
    const sheet = { draw, width, height, em, count, pitch, foot, at: (c) => INSET + c * pitch };
    if (document.body.classList.contains("joints")) this.drawJoints(sheet, cycle, part);
    else this.drawBars(sheet, cycle, part);
  }

  // Where time is: a line, below these words at a height where it would cross them.
  drawNow({ draw, foot, em, at }, cycle, part, words = "", y = 0) {
    const x = at(cycle + part);
    const crossed = words && x < INSET + draw.measureText(words).width + 6;
    draw.strokeStyle = tone("--ink");
    draw.lineWidth = 1.5;
    line(draw, x, crossed ? y + 0.3 * em : 0, x, foot, []);
  }

  // How far each arm is off at the end of each cycle; the axis ends at a step of 1, 2 or 5.
  drawBars(sheet, cycle, part) {
    const { draw, width, height, em, count, pitch, foot, at } = sheet;
    const { arms } = this;
    // words stand over the line of the axis, where no bar is
    const room = foot - 1.05 * em;
    const group = Math.min(0.66 * pitch, 4.5 * em);
    const wide = group / arms.length;
    const offs = arms.flatMap(({ data }) => data.off.flat());
    const top = stepAbove(Math.max(LEAST_AXIS, ...offs));
    const level = (v) => foot - (v / top) * room;
    draw.strokeStyle = tone("--edge");
    line(draw, INSET, foot + 0.5, width - INSET, foot + 0.5, []);
    const { failure, idle } = this.scene;
    if (idle) {
      // a way there and back has nothing to show
      const words = "no bars: the loop was not followed";
      const y = 0.95 * em;
      this.drawNow(sheet, cycle, part, words, y);
      textWithHalo(draw, words, INSET + 2, y, em);
      return;
    }
    const open = new Set(); // how those to come are drawn
    let fails = "";
    for (let c = 0; c < count; c++) {
      const finished = c < cycle || (c === cycle && part >= 1);
      arms.forEach((arm, k) => {
        const [before, off] = arm.data.off[c];
        const x = Math.round(at(c + 1) - group + k * wide);
        if (off === null) {
          // the cycle in which it fails
          if (c && before === null) return;
          draw.fillStyle = legible(arm.data.color, TEXT_CONTRAST);
          draw.fillText("×", x, foot - 0.15 * em);
          fails = "×: fails";
          return;
        }
        // in whole pixels, so that no edge is pale; a zero is a hairline
        const tall = Math.max(off < 1e-4 ? 1 : 2, Math.round(foot - level(off)));
        const across = Math.max(Math.floor(wide) - (wide > 4 ? 1 : 0), 1);
        draw.fillStyle = legible(arm.data.color, CONTRAST);
        if (finished) draw.fillRect(x, foot - tall, across, tall);
        else open.add(outline(draw, x, foot - tall, across, tall));
      });
    }
    this.number({ draw, height, em, count, pitch, at }, group);
    const kinds = [...open].sort().reverse().join(" or ");
    const legends = (kinds ? COMING : [""]).flatMap((words) =>
      [failure ? "of the solid line" : "", ""].map((whose) =>
        [formatLength(top), whose, kinds + words, fails].filter(Boolean).join(" · "),
      ),
    );
    const fits = (text) => draw.measureText(text).width < width - 2 * INSET;
    const words = legends.find(fits) || legends.at(-1);
    const y = level(top) - 0.3 * em;
    draw.strokeStyle = tone("--edge");
    line(draw, INSET, level(top), width - INSET, level(top), [3, 4]);
    this.drawNow(sheet, cycle, part, words, y);
    textWithHalo(draw, words, INSET + 2, y, em);
  }

  // The numbers of the cycles, each under its group of bars, this wide.
  number({ draw, height, em, count, pitch, at }, group) {
    const { cycles } = this.scene;
    const every = Math.ceil((1.6 * em) / pitch);
    draw.fillStyle = tone("--soft");
    draw.textAlign = "center";
    for (let c = (count - 1) % every; c < count; c += every)
      draw.fillText(cycles[c], at(c + 1) - group / 2, height - 0.25 * em);
    draw.textAlign = "left";
    if (draw.measureText("cycle").width + 1.2 * em < pitch - group / 2)
      draw.fillText("cycle", INSET + 2, height - 0.25 * em);
  }

  // Each joint over all cycles in a row of its own, and its value now.
  drawJoints(sheet, cycle, part) {
    const { draw, height, em, count, pitch, foot, at } = sheet;
    const { arms, scene } = this;
    const { names, turns, perCycle } = scene.joints;
    const values = arms.map((arm) => arm.run.joints.values);
    const n = names.length;
    const tall = foot / n;
    draw.drawImage(this.curves(sheet, values), 0, 0, sheet.width, height);
    this.drawNow(sheet, cycle, part);
    const row = Math.round(part * (perCycle - 1));
    for (let i = 0; i < n; i++) {
      const now = values.map((all) => all[(cycle * perCycle + row) * n + i].toFixed(2));
      const words = `${names[i]} ${now.join(" and ")} ${turns[i] ? "rad" : "m"}`;
      const y = this.image.low[i] ? (i + 1) * tall - 0.25 * em : i * tall + 0.85 * em;
      textWithHalo(draw, words, INSET + 2, y, em);
    }
    this.number({ draw, height, em, count, pitch, at }, 0);
  }

  // The curves of all joints, each from limit to limit: a canvas, drawn anew where they change; and
  // which words stand `low` in their row, because curves begin in its upper half.
  curves({ count, foot, at }, values) {
    const scale = window.devicePixelRatio || 1;
    const drawn = [...values, count, this.size, scale, tone("--line")];
    const { image } = this;
    if (image && drawn.every((v, i) => v === image.drawn[i])) return image.canvas;
    const canvas = document.createElement("canvas");
    const draw = sharp(canvas, this.size);
    const { arms, scene } = this;
    const { names, lower, upper, perCycle } = scene.joints;
    const n = names.length;
    const tall = foot / n;
    const right = at(count);
    const low = [];
    for (let i = 0; i < n; i++) {
      // from limit to limit and as far beyond as it goes, or, without limits, over what it moves
      const seen = values.flatMap((all) => range(all, i, n));
      const least = Math.min(lower[i] ?? Math.min(...seen) - 0.5, ...seen);
      const most = Math.max(upper[i] ?? Math.max(...seen) + 0.5, ...seen);
      const level = (v) => (i + 1) * tall - 2 - ((v - least) / (most - least)) * (tall - 4);
      low[i] = Math.min(...values.map((all) => level(all[i]))) < (i + 0.5) * tall;
      draw.lineWidth = 1;
      draw.strokeStyle = tone("--line");
      line(draw, INSET, (i + 1) * tall, right, (i + 1) * tall, []);
      draw.strokeStyle = tone("--bad");
      for (const limit of [lower[i], upper[i]])
        if (limit !== null && least < limit && limit < most)
          line(draw, INSET, level(limit), right, level(limit), [2, 4]);
      arms.forEach((arm, k) => {
        draw.strokeStyle = arm.data.color;
        draw.lineWidth = 1.5;
        draw.beginPath();
        for (let c = 0; c < count; c++)
          for (let row = 0; row < perCycle; row++) {
            const time = c + row / (perCycle - 1);
            // an arm that fails has no joints from there on
            if (time > (arm.data.lost ?? Infinity)) break;
            draw.lineTo(at(time), level(values[k][(c * perCycle + row) * n + i]));
          }
        draw.stroke();
      });
    }
    this.image = { canvas, drawn, low };
    return canvas;
  }
}

// What is said of an arm has its colour.
export const wordColour = (color) => legible(color, TEXT_CONTRAST);

// A colour #rrggbb, mixed with ink until its contrast to the paper is large enough; computed once.
const legibleBefore = new Map();
function legible(color, contrast) {
  const key = [color, contrast, tone("--paper")].join();
  if (!legibleBefore.has(key)) legibleBefore.set(key, mixed(color, contrast));
  return legibleBefore.get(key);
}

function mixed(color, contrast) {
  const [from, ink, paper] = [color, tone("--ink"), tone("--paper")].map(channels);
  for (let share = 0; share < 1; share += 0.05) {
    const rgb = from.map((v, i) => v + share * (ink[i] - v));
    const [dark, bright] = [luminance(rgb), luminance(paper)].sort((a, b) => a - b);
    if ((bright + 0.05) / (dark + 0.05) >= contrast)
      return `rgb(${rgb.map(Math.round).join(", ")})`;
  }
  return tone("--ink");
}

const channels = (color) => [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));

function luminance(rgb) {
  const [r, g, b] = rgb.map((v) =>
    v <= 10 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4,
  );
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

// The smallest and the largest value of joint i of n.
function range(values, i, n) {
  let low = Infinity;
  let high = -Infinity;
  for (let k = i; k < values.length; k += n) {
    low = Math.min(low, values[k]);
    high = Math.max(high, values[k]);
  }
  return [low, high];
}

function line(draw, x0, y0, x1, y1, dash) {
  draw.setLineDash(dash);
  draw.beginPath();
  draw.moveTo(x0, y0);
  draw.lineTo(x1, y1);
  draw.stroke();
  draw.setLineDash([]);
}

// Text that stays legible where bars pass behind it.
function textWithHalo(draw, words, x, y, em) {
  Object.assign(draw, {
    textAlign: "left",
    lineJoin: "round",
    lineWidth: 0.3 * em,
    strokeStyle: tone("--paper"),
    fillStyle: tone("--soft"),
  });
  draw.strokeText(words, x, y);
  draw.fillText(words, x, y);
}

// Draw a bar that is still to come: hollow, or dotted if it is too thin to have an inside; which.
function outline(draw, x, y, width, height) {
  if (width < 4 || height < 4) {
    for (let at = 0; at < Math.max(width, height); at += 2 * DOT)
      if (width > height) draw.fillRect(x + at, y, Math.min(DOT, width - at), height);
      else draw.fillRect(x, y + at, width, Math.min(DOT, height - at));
    return "dotted";
  }
  draw.fillRect(x, y, width, height);
  draw.fillStyle = tone("--paper");
  draw.fillRect(x + 1, y + 1, width - 2, height - 1);
  return "hollow";
}
