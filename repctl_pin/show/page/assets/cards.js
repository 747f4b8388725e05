// Below each arm: its drift in numbers, cycle by cycle, and its elbow's trace enlarged.

function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

// 0.0133; 4.1 × 10⁻¹³
function inWords(value) {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  if (value >= 1e-3) return value.toPrecision(3);
  const [digits, power] = value.toExponential(1).split("e");
  return `${digits} × 10${[...power.replace("+", "")].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("")}`;
}

// 2 m; 12.5 cm; 0.3 mm
function inMetres(value) {
  const two = (v) => Number(v.toPrecision(2));
  return value >= 1 ? `${two(value)} m` : value >= 0.01 ? `${two(100 * value)} cm` : `${two(1000 * value)} mm`;
}

function sharp(canvas) {
  const scale = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale)) canvas.width = Math.round(width * scale);
  if (canvas.height !== Math.round(height * scale)) canvas.height = Math.round(height * scale);
  const draw = canvas.getContext("2d");
  draw.setTransform(scale, 0, 0, scale, 0, 0);
  draw.clearRect(0, 0, width, height);
  return { draw, width, height };
}

const elbows = (arm) => (arm.limbs > 1 ? "elbows’ traces" : shortened(arm.elbows[0]) || "elbow’s trace");
// j2s6s200…joint_3: its end tells one joint from the next
const shortened = (name) => (name && name.length > 18 ? `${name.slice(0, 7)}…${name.slice(-10)}` : name);

class Card {
  constructor(parent, arm, view, scene) {
    Object.assign(this, { arm, view, scene, done: -1 });
    this.drift = element("p", { class: "drift" });
    this.after = element("p", { class: "after" });
    this.bars = element("canvas", { role: "img", "aria-label": `Drift of ${arm.label} after each cycle` });
    this.elbow = element("canvas", { role: "img", "aria-label": `${arm.label}: trace of ${arm.elbows.join(" and ") || "the elbow"}` });
    this.scaleNote = element("figcaption");
    const largest = Math.max(...scene.arms.flatMap((a) => a.drift));
    this.top = largest;
    parent.append(element("article", { class: "card", style: `--arm: ${arm.color}` }, element("div", {},
      element("div", {}, element("h2", {}, element("span", { class: "chip" }), arm.label), this.drift, this.after),
      element("figure", { class: "bars" }, this.bars, element("figcaption", {}, `after each cycle; top ${inWords(largest)} ${arm.unit}`)),
      element("figure", { class: "elbow" }, this.elbow, this.scaleNote))));
  }

  // `completed`: number of the last cycle that is finished, 0 at the start
  show(completed, cycle, part) {
    if (completed !== this.done) {
      this.done = completed;
      const value = completed ? inWords(this.arm.drift[completed - 1]) : "0";
      this.drift.replaceChildren(value + " ", element("small", {}, this.arm.unit));
      this.after.textContent = completed ? `off the start after ${completed === 1 ? "1 cycle" : completed + " cycles"}` : "at the start";
      this.drawBars();
    }
    this.drawElbow(cycle, part);
  }

  drawBars() {
    if (!this.bars.clientWidth) return; // no room for it
    const { draw, width, height } = sharp(this.bars), n = this.arm.drift.length, pitch = Math.min(26, width / n), base = height - 1;
    draw.fillStyle = "#c9d2da";
    draw.fillRect(0, base, pitch * n, 1);
    this.arm.drift.forEach((value, k) => {
      const tall = this.top > 0 ? (value / this.top) * (height - 4) : 0, gap = pitch > 4 ? 2 : 0;
      draw.fillStyle = k < this.done ? this.arm.color : "#e3e8ed";
      const drawn = Math.max(tall, k < this.done ? 2 : 1);
      draw.fillRect(k * pitch, base - drawn, Math.max(pitch - gap, 0.6), drawn);
    });
  }

  // The trace as the camera sees it, enlarged; all arms to one scale.
  drawElbow(cycle, part) {
    const { draw, width, height } = sharp(this.elbow), flat = this.flat;
    if (!flat || !width) return;
    const x = (i) => width / 2 + flat.scale * (flat.points[2 * i] - flat.center[0]);
    const y = (i) => height / 2 - flat.scale * (flat.points[2 * i + 1] - flat.center[1]);
    const F = this.scene.perCycle;
    draw.lineWidth = 1.5; draw.lineJoin = "round";
    for (let limb = 0; limb < this.view.limbs; limb++) {
      let last = 0;
      for (let c = 0; c <= cycle && c < this.scene.cycles.length; c++) {
        const until = c < cycle ? F - 1 : Math.floor(part * (F - 1) + 1e-9);
        draw.strokeStyle = "#" + this.shade(c, 1).getHexString();
        draw.beginPath();
        for (let i = 0; i <= until; i++) { last = limb * this.view.frames + c * F + i; draw.lineTo(x(last), y(last)); }
        draw.stroke();
      }
      draw.fillStyle = this.arm.color;
      draw.beginPath(); draw.arc(x(last), y(last), 3, 0, 7); draw.fill();
    }
    draw.fillStyle = "#5c6875";
    draw.fillRect(8, height - 8, flat.bar * flat.scale, 2);
  }

  // Lay all cards' traces flat for the camera that looks along these axes, to one scale.
  static flatten(cards, right, up) {
    const boxes = cards.map((card) => {
      const { view } = card, points = new Float32Array(2 * view.limbs * view.frames), p = new MeshCat.THREE.Vector3();
      const box = [Infinity, -Infinity, Infinity, -Infinity];
      for (let j = 0; j < view.limbs * view.frames; j++) { // limb after limb
        view.point("elbow", Math.floor(j / view.frames), j % view.frames, 0, p);
        const a = (points[2 * j] = p.dot(right)), b = (points[2 * j + 1] = p.dot(up));
        box[0] = Math.min(box[0], a); box[1] = Math.max(box[1], a); box[2] = Math.min(box[2], b); box[3] = Math.max(box[3], b);
      }
      card.flat = { points, center: [(box[0] + box[1]) / 2, (box[2] + box[3]) / 2] };
      return box;
    });
    const wide = Math.max(...boxes.map((b) => b[1] - b[0]), 1e-6), tall = Math.max(...boxes.map((b) => b[3] - b[2]), 1e-6);
    const scale = Math.min(158 / wide, 62 / tall), bar = niceStep(40 / scale);
    for (const card of cards) {
      Object.assign(card.flat, { scale, bar });
      card.scaleNote.title = `The trace of ${card.arm.elbows.join(" and ") || "the elbow"}, what a self-motion moves most`;
      card.scaleNote.textContent = wide > 1e-5 || tall > 1e-5 ? `${elbows(card.arm)}; bar ${inMetres(bar)}` : "no elbow moves";
    }
  }
}
