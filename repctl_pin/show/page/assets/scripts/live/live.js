// A running loop: its poses come over a socket, sixty times a second; keys move its target.

import { wordColour } from "../chrome/chart.js";
import { byId, element } from "../dom.js";
import { formatLength, formatNumber } from "../numbers.js";
import { cleared, Marker, Trail } from "../arm/traces.js";

const KEY_STEP = 0.01; // m a key press
const MAX_MOVE = 0.1; // m a message

// `shown`: draws the arms once they stand; `panes`: whose camera's axes the keys and the pointer go
// by
export function follow(arms, panes, scene, extent, shown) {
  const { camera } = panes.viewer;
  const targetBalls = arms.map((arm) => new TargetBall(arm, extent));
  for (const arm of arms) arm.traces = cleared(arm.group, arm.traces);
  const trails = arms.map((arm) =>
    ["tip", "elbow"].map(() => new Trail(arm.traces, arm.data.color)),
  );
  const socket = new WebSocket(`ws://${location.host}/poses`);
  const api = window.repctl;
  socket.binaryType = "arraybuffer";
  byId("verdict").textContent = "Waiting for the first configurations of the control loop.";
  api.received = 0;
  let newest = null;
  function draw() {
    const numbers = new Float32Array(newest);
    const stride = arms[0].stride;
    const count = arms.length;
    const flag = 2 * count * (stride + 1);
    const waiting = numbers[flag] ? ", target out of reach" : "";
    const cycles = numbers[flag + 4];
    const rest = flag + 5;
    const at = (k) => new MeshCat.THREE.Vector3().fromArray(numbers, rest + 3 * k);
    const hands = arms.map((arm, k) => at(k).distanceTo(at(count + k)));
    targetBalls.forEach((goal) => goal.show(numbers, flag + 1, Boolean(waiting)));
    trails.forEach(([tip, elbow], k) => {
      tip.add(at(k));
      elbow.add(at(2 * count + k));
    });
    byId("clock").textContent = `cycle ${cycles + 1}`;
    arms.forEach((arm, k) => {
      arm.setPoses(numbers, k * stride, (count + k) * stride);
      const drift = numbers[2 * count * stride + k];
      const past = numbers[2 * count * stride + count + k];
      const limit = past ? ", past a limit" : "";
      const size = `${drift < 1e-6 ? 0 : formatNumber(drift)} ${arm.data.unit}`;
      arm.notice.textContent = `joints ${size} from cycle 1${limit}${waiting}`;
    });
    const target = targetBalls.some(({ place }) => place);
    if (cycles) writeVerdict(arms, scene, { hand: Math.max(...hands), cycles, target });
    else byId("verdict").textContent = waitingFor(target);
    newest = null;
    api.received += 1;
    shown();
  }
  socket.addEventListener("message", ({ data }) => {
    // of what comes between two pictures, the last is drawn
    if (newest === null) requestAnimationFrame(draw);
    newest = data;
  });
  socket.addEventListener("close", () => {
    byId("notice-text").textContent = "The program has ended.";
    byId("notice").hidden = false;
  });
  const send = (move) => {
    if (socket.readyState === 1) socket.send(JSON.stringify(move));
  };
  draggable(arms, targetBalls, panes, send);
  document.addEventListener(
    "keydown",
    (event) => {
      const move =
        event.shiftKey || event.ctrlKey || event.metaKey || event.altKey
          ? null
          : moveOfKey(event.key, camera);
      if (!move || socket.readyState !== 1) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      send(move);
    },
    true,
  );
}

// Which way a key moves the target, m: along the robot's axis that lies most as the key says on the
// screen.
function moveOfKey(key, camera) {
  if (key === "Home") return "home";
  const direction = {
    ArrowRight: [0, 1],
    ArrowLeft: [0, -1],
    ArrowUp: [1, 1],
    ArrowDown: [1, -1],
    PageUp: [2, -1],
    PageDown: [2, 1],
  }[key];
  if (!direction) return null;
  const taken = [];
  const axes = [0, 1, 2].map((column) => {
    const v = new MeshCat.THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, column);
    const robot = [v.x, -v.z, v.y]; // three's y is up
    const axis = robot
      .map((size, k) => (taken.includes(k) ? -1 : Math.abs(size)))
      .reduce((best, size, k, all) => (size > all[best] ? k : best), 0);
    taken.push(axis);
    return [axis, Math.sign(robot[axis])];
  });
  const [axis, sign] = axes[direction[0]];
  const move = [0, 0, 0];
  move[axis] = KEY_STEP * direction[1] * sign;
  return move;
}

// What is said before the first cycle has ended; how to move the target, where there is one.
function waitingFor(target) {
  const keys =
    "Drag the target, or move it by the arrow keys, Page Up and Page Down; Home brings it back. ";
  return `${target ? keys : ""}After each cycle this line says what has moved since cycle 1.`;
}

// The verdict so far: what is off where the hand was in cycle 1.
function writeVerdict(arms, scene, { hand, cycles, target }) {
  const largest = arms.map((arm) =>
    arm.off.reduce((best, off, k) => (off > best[0] ? [off, arm.moving[k].name] : best), [0, ""]),
  );
  const [, worst] = largest.reduce((a, b) => (b[0] > a[0] ? b : a));
  const name = scene.names[worst] || worst;
  const times = cycles === 1 ? "1 cycle" : `${cycles} cycles`;
  const off = arms.flatMap((arm, k) => [
    k ? ", " : "",
    element("b", { style: `color: ${wordColour(arm.data.color)}` }, formatLength(largest[k][0])),
    k ? "" : " from there",
    ` under ${arm.data.under}`,
  ]);
  const article = /\d$/.test(name) ? "" : "the ";
  const words =
    hand < 1e-3
      ? [`After ${times} the hand is where it was in cycle 1; ${article}${name} is `, ...off, "."]
      : [
          `The hand is ${formatLength(hand)} from where it was in cycle 1`,
          target ? ": bring the target back (Home) to compare." : ".",
        ];
  if (!byId("verdict")) return;
  byId("verdict").replaceChildren(...words);
}

// The target: a ball that can be taken, red while it is out of reach.
class TargetBall {
  constructor(arm, extent) {
    this.balls = ["#3c4a59", "#e00020"].map(
      (color) => new Marker(arm.group, 0.02 * extent, color, 0.75),
    );
    this.place = null;
    this.balls.forEach(({ node }) => {
      node.visible = false;
    });
  }

  show(numbers, start, outOfReach) {
    if (!Number.isFinite(numbers[start])) return;
    this.place = this.balls[0].node.position.fromArray(numbers, start);
    this.balls[1].node.position.copy(this.place);
    this.balls.forEach(({ node }, k) => {
      node.visible = Boolean(k) === outOfReach;
    });
  }
}

// A finger or the mouse takes the target where it is seen, in any pane, and moves it across the
// screen.
function draggable(arms, targetBalls, panes, send) {
  const stage = byId("picture");
  const { camera } = panes.viewer;
  let held = null;
  const inside = (event) => {
    const { left, top } = stage.getBoundingClientRect();
    const x = event.clientX - left;
    const y = event.clientY - top;
    const k = arms.findIndex((arm, i) => {
      const p = panes.place(i);
      return x >= p.left && x < p.left + p.width && y >= p.top && y < p.top + p.height;
    });
    return k < 0
      ? null
      : { k, pane: panes.place(k), x: x - panes.place(k).left, y: y - panes.place(k).top };
  };
  const seen = (p) => new MeshCat.THREE.Vector3(p.x, p.z, -p.y).project(camera); // three's y is up
  stage.addEventListener(
    "pointerdown",
    (event) => {
      const at = inside(event);
      if (!at || !targetBalls[at.k].place) return;
      const v = seen(targetBalls[at.k].place);
      const distance = Math.hypot(
        ((v.x + 1) / 2) * at.pane.width - at.x,
        ((1 - v.y) / 2) * at.pane.height - at.y,
      );
      if (distance > (event.pointerType === "mouse" ? 22 : 36)) return;
      event.stopPropagation();
      event.preventDefault();
      held = { ...at, id: event.pointerId, depth: v.z };
      panes.viewer.controls.enabled = false;
    },
    true,
  );
  window.addEventListener("pointermove", (event) => {
    const at = held && event.pointerId === held.id ? inside(event) : null;
    if (!at || at.k !== held.k) return;
    const world = ({ x, y }) =>
      new MeshCat.THREE.Vector3(
        (2 * x) / at.pane.width - 1,
        1 - (2 * y) / at.pane.height,
        held.depth,
      ).unproject(camera);
    const direction = world(at).sub(world(held));
    const move = [direction.x, -direction.z, direction.y].map((v) =>
      Math.max(-MAX_MOVE, Math.min(MAX_MOVE, Number(v.toFixed(5)))),
    );
    Object.assign(held, { x: at.x, y: at.y });
    if (move.some(Boolean)) send(move);
  });
  for (const end of ["pointerup", "pointercancel"])
    window.addEventListener(end, () => {
      if (held) panes.viewer.controls.enabled = true;
      held = null;
    });
}
