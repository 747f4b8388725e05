// A running loop: its poses come over a socket, sixty times a second; keys move its target.

import { byId } from "./dom.js";
import { inWords } from "./numbers.js";

const STEP = 0.01; // m a key press

// `shown`: draws the arms once they stand; `camera`: whose axes the keys go by
export function follow(arms, camera, shown) {
  const socket = new WebSocket(`ws://${location.host}/poses`), api = window.repctl;
  socket.binaryType = "arraybuffer";
  api.received = 0;
  let newest = null;
  function draw() {
    const numbers = new Float32Array(newest), stride = arms[0].stride, count = arms.length;
    const waiting = numbers[2 * count * (stride + 1)] ? ", target out of reach" : "";
    arms.forEach((arm, k) => {
      arm.standAs(numbers, k * stride, (count + k) * stride);
      const drift = numbers[2 * count * stride + k], past = numbers[2 * count * stride + count + k];
      arm.notice.textContent = `${inWords(drift)} ${arm.data.unit} off cycle 1${past ? ", past a limit" : ""}${waiting}`;
    });
    newest = null;
    api.received += 1;
    shown();
  }
  socket.addEventListener("message", ({ data }) => {
    if (newest === null) requestAnimationFrame(draw); // of what comes between two pictures, the last is drawn
    newest = data;
  });
  socket.addEventListener("close", () => { byId("notice-text").textContent = "The program has ended."; byId("notice").hidden = false; });
  document.addEventListener("keydown", (event) => {
    const move = event.shiftKey || event.ctrlKey || event.metaKey || event.altKey ? null : moved(event.key, camera);
    if (!move || socket.readyState !== 1) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    socket.send(JSON.stringify(move));
  }, true);
}

// Which way a key moves the target, m: along the robot's axis that lies most as the key says on the screen.
function moved(key, camera) {
  if (key === "Home") return "home";
  const way = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowUp: [1, 1], ArrowDown: [1, -1], PageUp: [2, -1], PageDown: [2, 1] }[key];
  if (!way) return null;
  const taken = [];
  const axes = [0, 1, 2].map((column) => {
    const v = new MeshCat.THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, column), robot = [v.x, -v.z, v.y]; // three's y is up
    const axis = robot.map((size, k) => (taken.includes(k) ? -1 : Math.abs(size))).reduce((best, size, k, all) => (size > all[best] ? k : best), 0);
    taken.push(axis);
    return [axis, Math.sign(robot[axis])];
  });
  const [axis, sign] = axes[way[0]], move = [0, 0, 0];
  move[axis] = STEP * way[1] * sign;
  return move;
}
