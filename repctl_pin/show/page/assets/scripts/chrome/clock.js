// Time, in shown cycles: running, or from one cycle's end to the next, when the hand stands still
// and the elbow walks. It opens on the end for three seconds, goes through the cycles' ends once,
// stays at the last, where the drift is, and invites to draw.

const END = 3;
const HOLD = 1.4; // s

export class Clock {
  constructor(cycles, seconds, changed) {
    Object.assign(this, {
      cycles,
      seconds,
      changed,
      time: cycles,
      playing: false,
      stepping: false,
      opening: false,
      speed: 1,
      rest: 0,
      done: null,
      whole: true, // whether any cycle is whole
      invite() {},
    });
  }

  open() {
    Object.assign(this, { opening: true, stepping: true, playing: true });
    this.changed();
  }

  // A hand is on it: the opening is over.
  hold() {
    if (this.opening) Object.assign(this, { opening: false, stepping: false });
  }

  // Go from here to the end, by the cycles' ends, and stay there.
  finish(done) {
    Object.assign(this, { opening: false, stepping: true, playing: true, rest: 0, done });
    this.changed();
  }

  seek(time) {
    this.time = Math.min(Math.max(Number(time) || 0, 0), this.cycles);
    this.rest = 0;
    this.changed();
  }

  // Whether nothing moves at the end: what is pressed there plays anew.
  get ended() {
    return this.time >= this.cycles && (this.opening || !this.playing);
  }

  // Play from here, or at the end from the start; or pause.
  press() {
    if (!this.ended || !this.playing) return this.play(!this.playing);
    this.hold();
    this.seek(0);
  }

  play(on) {
    if (on === this.playing) return;
    if (!on) this.hold();
    else if (this.time >= this.cycles) this.time = 0;
    if (this.done) Object.assign(this, { done: null, stepping: false });
    this.playing = on;
    this.changed();
  }

  step(on) {
    Object.assign(this, { opening: false, stepping: on });
    if (on) this.time = Math.round(this.time);
    this.seek(this.time);
  }

  // Let this many seconds pass, however few pictures are drawn of them.
  pass(seconds) {
    if (!this.playing) return;
    if (this.time >= this.cycles && this.done) {
      const { done } = this;
      this.play(false);
      done();
    } else if (this.time >= this.cycles) {
      this.rest += seconds;
      if (this.rest < (this.opening ? END : HOLD)) return;
      this.seek(0);
    } else if (this.stepping) {
      this.rest += seconds * this.speed;
      const hold = Math.min(Math.max(4 / this.cycles, 0.2), 0.5);
      const count = Math.floor(this.rest / hold);
      const left = this.rest - count * hold;
      if (!count) return;
      this.seek(Math.floor(this.time) + count);
      this.rest = left;
      if (this.opening && this.time >= this.cycles) {
        this.play(false);
        this.invite();
      }
    } else this.seek(this.time + (this.speed * seconds) / this.seconds);
  }
}
