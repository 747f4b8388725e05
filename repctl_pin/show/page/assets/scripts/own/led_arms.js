// Both arms while a hand or the elbow's slider leads them: time stands still, and they stand where
// they are led.

import { byId } from "../dom.js";
import { drawnAt } from "./run.js";

export class LedArms {
  // `parts`: {arms, chain, clock, player, scene}, and what is done when it has {begun(), ended()}
  constructor(parts) {
    Object.assign(this, parts, { lead: null });
  }

  // Stop time, and show both arms as `lead` says from now on: {qs} of each, {hands} where they are,
  // {slides} by the slider, {ghost} if it stays there. `lines`: what else is drawn.
  begin(lead, lines) {
    const { scene, player } = this;
    this.clock.play(false);
    player.plain();
    this.lead = lead;
    for (const arm of this.arms) {
      const data = { ...arm.study.run.data, broken: null, lost: Infinity };
      const motion = new Float64Array(2 * (arm.stride + 6 * arm.chains));
      const { joints } = arm.study.run;
      arm.use({ data, motion, frames: 2, perCycle: 1, joints, most: arm.mostOff() });
      // the slider shows how far the arm is from the start, in both panes
      if (lead.slides) arm.reference = null;
      arm.notice.textContent = "";
    }
    player.clear(lines);
    Object.assign(scene, { failure: null, idle: false });
    byId("lines").hidden = true;
    document.body.classList.add("leading", "own");
    scene.leading = lead.slides ? "slides" : "leads";
    this.begun();
  }

  // Put both arms where they have been led; the ghost is the last of them, or as `lead` says.
  draw() {
    const { chain, lead } = this;
    this.arms.forEach((arm, k) => {
      // a ghost that stays is drawn once
      if (!lead.ghostDrawn) drawnAt(chain, arm, lead.ghost || lead.qs.at(-1), arm.run, 0);
      drawnAt(chain, arm, lead.qs[k], arm.run, 1);
    });
    lead.ghostDrawn = Boolean(lead.ghost);
  }

  // Nothing leads the arms any more.
  end() {
    if (!this.lead) return;
    this.scene.leading = "";
    this.lead = null;
    document.body.classList.remove("leading");
    this.ended();
  }
}
