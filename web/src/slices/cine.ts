// Projections as a loop.
import type { State } from "./state";

export const SPEEDS = [1, 2, 4, 6, 8, 12, 16, 24, 30]; // views a second

export class Cine {
  playing = false;
  sweeping = true; // back and forth, as the source moves; else round and round
  speed = 6;
  private way = 1;
  private last = 0;

  constructor(private readonly state: State) {}

  toggle(): void {
    this.playing = !this.playing;
    this.last = performance.now();
    this.state.changed();
  }

  faster(by: number): void {
    const at = SPEEDS.indexOf(this.speed);
    this.speed = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, at + by))];
    this.state.changed();
  }

  /** Shows the next view when its time has come. */
  turn(now: number): void {
    if (!this.playing || now - this.last < 1000 / this.speed) return;
    this.last = Math.max(this.last + 1000 / this.speed, now - 1000); // a hidden page does not catch up
    const { side } = this.state;
    const count = side.stored.shape[0], view = this.state.slice(side, "axial");
    if (count < 2) return;
    if (this.sweeping && (view + this.way < 0 || view + this.way >= count)) this.way = -this.way;
    this.state.toSlice(side, "axial", this.sweeping ? view + this.way : (view + 1) % count);
  }
}
