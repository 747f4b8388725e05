// The document: its elements, what is packed inside it, colours, canvases.

// Do work that pauses without its pauses; gives what it returns.
export function finished(work) {
  for (;;) {
    const { done, value } = work.next();
    if (done) return value;
  }
}

export const byId = (id) => document.getElementById(id);

export function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

// Text and attributes that stay are not written again: a page lays out, and styles, what was
// written.
export function setText(node, words) {
  if (node.textContent !== words) node.textContent = words;
}
export function setColor(node, color) {
  if (node.style.color !== color) node.style.color = color;
}
export function setAttribute(node, name, value) {
  if (node.getAttribute(name) !== String(value)) node.setAttribute(name, value);
}

// Series of numbers from the bytes of their third differences: row after row of each series, which
// are [rows, columns].
export function summed(bytes, series, resolution) {
  const n = bytes.length / 4;
  const out = new Float64Array(n);
  let at = 0;
  for (const [rows, columns] of series) {
    const start = at;
    for (let column = 0; column < columns; column++)
      for (let row = 0, second = 0, first = 0, value = 0; row < rows; row++, at++) {
        const bits =
          bytes[at] | (bytes[at + n] << 8) | (bytes[at + 2 * n] << 16) | (bytes[at + 3 * n] << 24);
        second = (second + ((bits >>> 1) ^ -(bits & 1))) | 0;
        first = (first + second) | 0;
        value = (value + first) | 0;
        out[start + row * columns + column] = value * resolution;
      }
  }
  return out;
}

// A colour of the style sheet, as the light or the dark scheme has it.
const tones = new Map();
export function tone(name) {
  if (!tones.has(name))
    tones.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return tones.get(name);
}
const followers = [];
export function forgetTones() {
  tones.clear();
  for (const follow of followers) follow();
}

// Do `colour` now, and again in each other scheme.
export function inEachScheme(colour) {
  followers.push(colour);
  colour();
}

// Do this when a node gets another size. What is done may resize it again: that is seen in the next
// picture, as a browser reports it as an error in this one.
export function whenResized(node, does) {
  let before = "";
  const observer = new ResizeObserver(() => {
    const size = `${node.clientWidth} ${node.clientHeight}`;
    if (size === before) return;
    before = size;
    observer.disconnect();
    does();
    requestAnimationFrame(() => observer.observe(node));
  });
  observer.observe(node);
}

// The size of a canvas in CSS pixels, and em, the page's own measure of size: to ask lays the page
// out.
export function sizeOf(canvas) {
  return {
    width: canvas.clientWidth,
    height: canvas.clientHeight,
    em: parseFloat(getComputedStyle(document.documentElement).fontSize),
  };
}

// A canvas of this size, cleared and ready to draw, in CSS pixels.
export function sharp(canvas, { width, height }) {
  const scale = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * scale)) canvas.width = Math.round(width * scale);
  if (canvas.height !== Math.round(height * scale)) canvas.height = Math.round(height * scale);
  const draw = canvas.getContext("2d");
  draw.setTransform(scale, 0, 0, scale, 0, 0);
  draw.clearRect(0, 0, width, height);
  return draw;
}
