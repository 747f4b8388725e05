// Below the panes, a card for each arm: its drift in numbers, cycle by cycle, and two joints against each other.

import { byId, element, sharp, tone } from "./dom.js";
import { inWords, shortened } from "./numbers.js";

export class Card {
  // `seek`: goes to the end of a cycle of this number
  constructor(arm, scene, seek) {
    const { data } = arm, pair = scene.pair, last = data.drift.length;
    Object.assign(this, { arm, scene, largest: Math.max(...scene.arms.flatMap((a) => a.drift)) });
    this.drift = element("p", { class: "drift" });
    this.after = element("p", { class: "after" });
    this.bars = element("canvas", { role: "img", "aria-label": `${data.label}: drift after each of ${last} cycles, ${inWords(data.drift[last - 1])} ${data.unit} after the last` });
    const tallest = `tallest ${inWords(this.largest)} ${data.unit}`, caption = data.broken ? `${tallest}; hatched: violated` : `each cycle; ${tallest}`;
    const figures = [element("figure", { class: "bars" }, this.bars, element("figcaption", {}, caption))];
    if (pair) {
      this.orbit = element("canvas", { role: "img", "aria-label": `${data.label}: ${pair.names[0]} against ${pair.names[1]}, the two joints that drift most` });
      const [across, upward] = apart(pair.names).map(shortened);
      figures.push(element("figure", { class: "orbit", title: `${pair.names[0]} across, ${pair.names[1]} upward; lines: their limits` }, this.orbit, element("figcaption", {}, `${across} → ${upward} ↑`)));
    }
    byId("cards").append(element("article", { class: "card", style: `--arm: ${data.color}` },
      element("div", {}, element("h2", {}, element("span", { class: "chip" }), data.label), this.drift, this.after), ...figures));
    this.bars.addEventListener("click", (event) => {
      const { pitch } = this.measure(this.bars.clientWidth);
      seek(Math.min(last, Math.floor(event.offsetX / pitch) + 1));
    });
  }

  measure(width) { return { pitch: Math.min(width / 8, width / this.arm.data.drift.length) }; }

  // `number`: of the last cycle that is finished, 0 at the start; `cycle`, `part`: where time is
  show(number, cycle, part) {
    const { unit } = this.arm.data, value = this.arm.wander(number);
    this.drift.replaceChildren(inWords(value) + " ", element("small", {}, unit));
    this.after.textContent = number ? `off cycle 1 after ${number === 1 ? "1 cycle" : number + " cycles"}` : "in cycle 1";
    this.drawBars(number, value, part);
    if (this.orbit) this.drawOrbit(cycle, part);
  }

  drawBars(number, value, part) {
    if (!this.bars.clientWidth) return;
    const { draw, width, height, em } = sharp(this.bars), { drift, color, broken } = this.arm.data, { pitch } = this.measure(width);
    const base = height - 1, gap = pitch > 4 ? Math.max(1, 0.12 * pitch) : 0;
    draw.fillStyle = tone("--line");
    draw.fillRect(0, base, width, 1);
    drift.forEach((after, k) => {
      const done = k < number, now = k === number && part > 0, size = done ? after : now ? value : after;
      const tall = Math.max(this.largest > 0 ? (size / this.largest) * (height - 4) : 0, done ? 0.15 * em : 1), wide = Math.max(pitch - gap, 0.6);
      draw.fillStyle = done || now ? color : tone("--empty");
      draw.globalAlpha = now ? 0.5 : 1;
      draw.fillRect(k * pitch, base - tall, wide, tall);
      draw.globalAlpha = 1;
      if (broken && k + 1 >= broken.cycle) hatch(draw, k * pitch, base - tall, wide, tall, 0.3 * em);
    });
  }

  // Two joints over all cycles so far, all arms to one scale, with the limits that are near.
  drawOrbit(cycle, part) {
    if (!this.orbit.clientWidth) return;
    const { draw, width, height, em } = sharp(this.orbit), { arm, scene } = this, { box } = Card, F = scene.perCycle, pad = 0.5 * em;
    const x = (v) => pad + ((v - box[0]) / (box[1] - box[0])) * (width - 2 * pad), y = (v) => height - pad - ((v - box[2]) / (box[3] - box[2])) * (height - 2 * pad);
    draw.strokeStyle = tone("--limit"); draw.lineWidth = 0.1 * em;
    scene.pair.limits.forEach((ends, axis) => ends.forEach((limit) => {
      if (limit === null || limit < box[2 * axis] || limit > box[2 * axis + 1]) return;
      draw.beginPath();
      if (axis === 0) { draw.moveTo(x(limit), 0); draw.lineTo(x(limit), height); } else { draw.moveTo(0, y(limit)); draw.lineTo(width, y(limit)); }
      draw.stroke();
    }));
    draw.lineJoin = "round"; draw.strokeStyle = arm.data.color;
    draw.lineWidth = 0.09 * em;
    let at = arm.pair(0);
    draw.beginPath();
    for (let c = 0; c <= cycle; c++) {
      const until = c < cycle ? F - 1 : Math.floor(part * (F - 1) + 1e-9);
      for (let i = 0; i <= until; i++) { at = arm.pair(c * F + i); if (i || !c) draw.lineTo(x(at[0]), y(at[1])); else draw.moveTo(x(at[0]), y(at[1])); }
    }
    draw.stroke();
    draw.fillStyle = arm.data.color; draw.strokeStyle = tone("--paper"); draw.lineWidth = 0.12 * em;
    draw.beginPath(); draw.arc(x(at[0]), y(at[1]), 0.32 * em, 0, 7); draw.fill(); draw.stroke();
  }

  // The box in which all arms' orbits stand, and the limits that lie near it.
  static frame(arms, scene) {
    const box = [Infinity, -Infinity, Infinity, -Infinity];
    for (const arm of arms)
      for (let i = 0; i < arm.frames; i++) {
        const p = arm.pair(i);
        for (const axis of [0, 1]) { box[2 * axis] = Math.min(box[2 * axis], p[axis]); box[2 * axis + 1] = Math.max(box[2 * axis + 1], p[axis]); }
      }
    for (const axis of [0, 1]) {
      const [low, high] = box.slice(2 * axis, 2 * axis + 2), size = Math.max(high - low, 1e-3), room = 0.05 * size;
      const near = scene.pair.limits[axis].filter((limit) => limit !== null && limit > low - size && limit < high + size);
      box[2 * axis] = Math.min(low, ...near) - room;
      box[2 * axis + 1] = Math.max(high, ...near) + room;
    }
    Card.box = box;
  }
}

// Two names without what both begin and end with, up to a word's end; a number keeps the word before it.
function apart([a, b]) {
  let same = 0, before = 0, end = 0;
  for (let k = 0; k < a.length && a[k] === b[k]; k++) if (/[_/. -]/.test(a[k])) [before, same] = [same, k + 1];
  for (let k = 1; k < a.length - same && a.at(-k) === b.at(-k); k++) if (/[_/. -]/.test(a.at(-k))) end = k;
  if (/^\d/.test(a.slice(same))) same = before;
  return [a, b].map((name) => name.slice(same, name.length - end));
}

function hatch(draw, x, y, width, height, step) {
  draw.save();
  draw.beginPath(); draw.rect(x, y, width, height); draw.clip();
  draw.strokeStyle = tone("--paper"); draw.lineWidth = 0.35 * step;
  draw.beginPath();
  for (let s = -height; s < width; s += step) { draw.moveTo(x + s, y + height); draw.lineTo(x + s + height, y); }
  draw.stroke();
  draw.restore();
}
