// A running loop: its poses come over a socket, sixty times a second; keys move its target.

import { byId } from "./dom.js";

const STEP = 0.01; // m a key press

// `shown`: draws the arms once they stand
export function follow(arms, shown) {
  const socket = new WebSocket(`ws://${location.host}/poses`), api = window.repctl;
  socket.binaryType = "arraybuffer";
  api.received = 0;
  socket.addEventListener("message", ({ data }) => {
    const poses = new Float32Array(data);
    let at = 0;
    for (const arm of arms) { arm.standAs(poses, at); at += arm.stride; }
    api.received += 1;
    shown();
  });
  socket.addEventListener("close", () => { byId("notice-text").textContent = "The program has ended."; byId("notice").hidden = false; });
  const moves = { ArrowLeft: [0, STEP, 0], ArrowRight: [0, -STEP, 0], ArrowUp: [0, 0, STEP], ArrowDown: [0, 0, -STEP], PageUp: [STEP, 0, 0], PageDown: [-STEP, 0, 0], Home: "home" };
  document.addEventListener("keydown", (event) => {
    const move = moves[event.key];
    if (!move || event.shiftKey || socket.readyState !== 1) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    socket.send(JSON.stringify(move));
  }, true);
}
