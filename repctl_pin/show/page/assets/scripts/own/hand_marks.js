// What is drawn around a hand that is led: its trail and that of the arm, the dotted line that
// closes the loop, the disc within which closing is proved, and the edge of F.

import { EdgeLine } from "../arm/cover.js";
import { dots, Trail } from "../arm/traces.js";
import { tone } from "../dom.js";
import { gap, vector } from "./loops.js";
import { spotAt } from "./run.js";

const DOTS = 200; // of that line, at most

export class HandMarks {
  // `normal`: of the plane in which the hand is led; `apart`: between two dots, m
  constructor({ chain, arms, piece, cover }, normal, apart) {
    const T = MeshCat.THREE;
    const home = chain.homes[chain.led];
    Object.assign(this, { chain, arms, piece, home, apart });
    this.panes = arms.map((arm) => {
      const { color } = arm.data;
      const positions = new T.Float32BufferAttribute(3 * DOTS, 3);
      const line = dots(new T.BufferGeometry().setAttribute("position", positions), color);
      // a loop stays on a workpiece that moves
      const group = arm.carrier ? arm.paths : arm.traces;
      group.add(line);
      if (chain.proved) group.add(disc(piece.drawn(home), piece.direction(normal), chain.proved));
      const tips = chain.frames.map(() => new Trail(group, color));
      const trails = [new Trail(arm.traces, color), ...tips];
      const edge = cover && new EdgeLine(group, cover);
      return { line, trails, edge };
    });
  }

  // Lengthen the trails to where the hands and the arms have been led.
  extend({ hands, qs }) {
    const { chain, piece } = this;
    this.arms.forEach((arm, k) => {
      const [behind, ...tips] = this.panes[k].trails;
      tips.forEach((tip, f) => tip.add(piece.drawn(hands[f])));
      if (arm.spot) behind.add(vector(spotAt(chain, arm, qs[k])));
    });
  }

  // Dot the line from the hand home, and show the edge of F where the hand is.
  show(hand) {
    const { home, piece } = this;
    for (const { line, edge } of this.panes) {
      if (edge) edge.show(piece.drawn(hand));
      const { geometry } = line;
      const { position } = geometry.attributes;
      const count = Math.min(DOTS, Math.floor(gap(hand, home) / this.apart));
      for (let i = 0; i < count; i++) {
        const share = (i + 0.5) / count;
        const dot = hand.map((v, c) => v + share * (home[c] - v));
        position.setXYZ(i, ...piece.drawn(dot).toArray());
      }
      geometry.setDrawRange(0, count);
      position.needsUpdate = true;
    }
  }
}

// A pale disc around the start, within which a proof holds.
function disc(home, normal, radius) {
  const T = MeshCat.THREE;
  const pale = new T.Group();
  const material = (opacity) =>
    new T.MeshBasicMaterial({
      color: tone("--good"),
      transparent: true,
      opacity,
      side: T.DoubleSide,
      depthWrite: false,
    });
  const edge = new T.Mesh(
    new T.RingGeometry(0.94 * radius, radius, 72),
    Object.assign(material(0.8), { depthTest: false }),
  ); // seen through the arm
  edge.renderOrder = 7;
  pale.add(new T.Mesh(new T.RingGeometry(0, radius, 72), material(0.12)), edge);
  pale.quaternion.setFromUnitVectors(new T.Vector3(0, 0, 1), normal.clone().normalize());
  pale.position.copy(home);
  return pale;
}
