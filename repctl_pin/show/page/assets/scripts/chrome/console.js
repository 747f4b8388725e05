// For tests, and for anyone at the browser's console: window.repctl.

import { byId } from "../dom.js";
import { motionCsv, record, seen } from "./save.js";

export function openConsole(api, { viewer, clock, view, arms, panes, still, own, scene }) {
  Object.defineProperties(api, {
    time: { get: () => clock.time },
    playing: { get: () => clock.playing },
  });
  const place = (k, name) =>
    arms[k].moving.find((node) => node.name === name) ||
    arms[k].still.find((node) => node.name === name);
  Object.assign(api, {
    viewer,
    own,
    cycles: clock.cycles,
    seek: (time) => clock.seek(time),
    set: view.set,
    turn: view.turn,
    play: () => clock.play(true),
    pause: () => clock.play(false),
    meshes: (k) => arms[k].meshes.length,
    placement: (k, name) => {
      place(k, name).updateMatrix();
      return place(k, name).matrix.toArray();
    },
    picture: () => {
      viewer.render();
      return viewer.renderer.domElement.toDataURL();
    },
    still,
    csv: () => motionCsv(arms, scene, clock.seconds),
    seen: () => seen(viewer).toDataURL(),
    record: (seconds) => record(viewer, clock, seconds),
    // where a pane is in the picture: left, top, width, height, in parts of the whole
    pane: (k) => {
      const { clientWidth: w, clientHeight: h } = byId("panes");
      const { left: a, top: b, width: c, height: d } = panes.place(k);
      return [a / w, b / h, c / w, d / h];
    },
    // how far a body is off where it was in cycle 1, m, and its colour
    drift: (k, name) => [
      arms[k].off[arms[k].moving.indexOf(place(k, name))],
      "#" + [place(k, name).children[0].material].flat()[0].color.getHexString(),
    ],
    materials: (change) => {
      for (const arm of arms)
        for (const mesh of [...arm.meshes, ...arm.bodies.meshes])
          [mesh.material].flat().forEach((m) => {
            change(m);
            m.needsUpdate = true;
          });
      viewer.set_dirty();
    },
  });
}
