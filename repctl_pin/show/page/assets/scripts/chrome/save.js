// What is seen, as a file: a PNG, or a film of it.

import { byId, element, tone } from "../dom.js";

const LEFT_OUT = "#tools, .track, #play, #notice, #own, .ring, #keys, #paper, .unseen";

// Draw the page without its buttons on a canvas.
export function seen(viewer, canvas = element("canvas"), scale = window.devicePixelRatio || 1) {
  const { left, bottom } = byId("chart").getBoundingClientRect();
  const foot = byId("stage").getBoundingClientRect().bottom;
  const width = window.innerWidth;
  const height = Math.max(bottom, foot) + (bottom > foot ? 4 : 0);
  const draw = canvas.getContext("2d");
  for (const [side, size] of [
    ["width", width],
    ["height", height],
  ]) {
    const pixels = 2 * Math.round((size * scale) / 2); // films want even numbers
    if (canvas[side] !== pixels) canvas[side] = pixels;
  }
  draw.setTransform(scale, 0, 0, scale, 0, 0);
  draw.fillStyle = tone("--paper");
  draw.fillRect(0, 0, width, height);
  if (!Number.isFinite(left)) return canvas;
  viewer.render();
  drawNode(draw, document.body);
  return canvas;
}

// An element, its ground, its picture or its words, and what is inside it.
function drawNode(draw, node) {
  if (node.nodeType === Node.TEXT_NODE) {
    drawWords(draw, node);
    return;
  }
  if (
    node.nodeType !== Node.ELEMENT_NODE ||
    node.matches(LEFT_OUT) ||
    node.matches("script, style, dialog")
  )
    return;
  const style = getComputedStyle(node);
  const box = node.getBoundingClientRect();
  if (style.display === "none" || style.visibility === "hidden") return;
  if (node.matches(".leader")) {
    drawRule(draw, node, style);
    return;
  }
  if (node.tagName === "CANVAS") {
    draw.drawImage(node, box.left, box.top, box.width, box.height);
    return;
  }
  drawGround(draw, style, box, node === document.body);
  for (const child of node.childNodes) drawNode(draw, child);
}

function drawGround(draw, style, { left, top, width, height }, whole) {
  const empty = (colour) => colour === "transparent" || /^rgba.*, 0\)$/.test(colour);
  if (whole || !width || !height) return;
  draw.beginPath();
  draw.roundRect(
    left,
    top,
    width,
    height,
    Math.min(parseFloat(style.borderRadius) || 0, height / 2),
  );
  if (style.backgroundImage.startsWith("linear-gradient")) {
    const [from, to] = style.backgroundImage.match(/rgba?\([^)]*\)/g);
    const fill = draw.createLinearGradient(left, 0, left + width, 0);
    fill.addColorStop(0, from);
    fill.addColorStop(1, to);
    draw.fillStyle = fill;
    draw.fill();
  } else if (!empty(style.backgroundColor)) {
    draw.fillStyle = style.backgroundColor;
    draw.fill();
  }
  const edge = parseFloat(style.borderLeftWidth);
  if (edge > 1) {
    draw.fillStyle = style.borderLeftColor;
    draw.fillRect(left, top, edge, height);
  }
}

// The line from a callout to what it speaks of.
function drawRule(draw, { line, hidden, parentElement }, style) {
  if (hidden || !line) return;
  const { left, top } = parentElement.getBoundingClientRect();
  const [x, y, toX, toY] = line;
  draw.strokeStyle = style.color;
  draw.lineWidth = 1.5;
  draw.beginPath();
  draw.moveTo(left + x, top + y);
  draw.lineTo(left + toX, top + toY);
  draw.stroke();
}

// Words, each where the page has it.
function drawWords(draw, text) {
  if (!text.data.trim()) return;
  const style = getComputedStyle(text.parentElement);
  const range = document.createRange();
  draw.font = `${style.fontStyle} ${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
  draw.letterSpacing = style.letterSpacing === "normal" ? "0px" : style.letterSpacing;
  draw.fillStyle = style.color;
  draw.textBaseline = "alphabetic";
  for (const { 0: word, index } of text.data.matchAll(/\S+/g)) {
    range.setStart(text, index);
    range.setEnd(text, index + word.length);
    const { left, top, height } = range.getBoundingClientRect();
    const { fontBoundingBoxAscent: up, fontBoundingBoxDescent: down } = draw.measureText(word);
    if (height) draw.fillText(word, left, top + (height - up - down) / 2 + up);
  }
}

// A film from now on, for at most `seconds`, or until `stop`: {stop, done}, done a promise of what
// was filmed.
export function record(viewer, clock, seconds = Infinity) {
  const canvas = seen(viewer, undefined, 1);
  const stream = canvas.captureStream(30);
  const kept = [];
  const kind = ["video/webm", "video/mp4"].find((one) => MediaRecorder.isTypeSupported(one));
  const recorder = new MediaRecorder(stream, { mimeType: kind, videoBitsPerSecond: 8e6 });
  const end = performance.now() + 1000 * seconds;
  recorder.addEventListener("dataavailable", ({ data }) => kept.push(data));
  const done = new Promise((tell) => {
    recorder.addEventListener("stop", () => {
      for (const track of stream.getTracks()) track.stop();
      tell(new Blob(kept, { type: kind }));
    });
  });
  const stop = () => {
    if (recorder.state !== "inactive") recorder.stop();
  };
  recorder.start(500);
  (function next() {
    if (recorder.state === "inactive") return;
    seen(viewer, canvas, 1);
    if (performance.now() > end) stop();
    else requestAnimationFrame(next);
  })();
  return { stop, done };
}

export function download(blob, name) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// The motions of all arms as the text of a CSV file, as a study's motion.csv has them: a row for
// each sample of the joints, as far as it is known.
export function motionCsv(arms, { cycles, joints }, seconds) {
  const round = (v) => Number(v.toFixed(6));
  const text = (v) => (/[",\n]/.test(v) ? `"${v.replaceAll('"', '""')}"` : v);
  const rows = [["strategy", "cycle", "time", ...joints.names].map(text)];
  for (const { data, run } of arms) {
    const { at, n, values } = run.joints;
    cycles.forEach((number, c) =>
      at.forEach((part, i) => {
        const cycle = number - 1 + part;
        // the end of a cycle is the start of the next
        const again = i === 0 && c > 0 && cycles[c - 1] === number - 1;
        if (again || cycle > data.lost) return;
        const first = (c * at.length + i) * n;
        const q = Array.from(values.subarray(first, first + n), round);
        rows.push([text(data.strategy), round(cycle), round(cycle * seconds), ...q]);
      }),
    );
  }
  return `${rows.map((row) => row.join(",")).join("\n")}\n`;
}

// The buttons: a picture, a film of the motion once through, or until it is pressed again, and the
// motion in numbers.
export function savable(viewer, clock, scene, arms) {
  const { live } = scene;
  const picture = byId("save-picture");
  const film = byId("save-film");
  const words = film.textContent;
  const name = () =>
    byId("title")
      .textContent.replace(/[^\w.]+/g, "-")
      .replace(/^-|-$/g, "") || "repctl";
  let filming = null;
  picture.addEventListener("click", () =>
    seen(viewer).toBlob((blob) => download(blob, `${name()}.png`)),
  );
  if (scene.joints)
    byId("save-motion").addEventListener("click", () => {
      const text = motionCsv(arms, scene, clock.seconds);
      download(new Blob([text], { type: "text/csv" }), `${name()}.csv`);
    });
  if (typeof MediaRecorder === "undefined") {
    film.hidden = true;
    return;
  }
  film.addEventListener("click", async () => {
    if (filming) {
      filming.stop();
      return;
    }
    if (!live) {
      clock.hold();
      clock.seek(0);
      clock.play(true);
    }
    filming = record(viewer, clock);
    film.textContent = "Stop and save";
    const over = live
      ? 0
      : setInterval(() => {
          if (clock.time >= clock.cycles || !clock.playing) filming.stop();
        }, 200);
    const blob = await filming.done;
    clearInterval(over);
    filming = null;
    film.textContent = words;
    download(blob, `${name()}.${blob.type.endsWith("mp4") ? "mp4" : "webm"}`);
  });
}
