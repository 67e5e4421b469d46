// Cine loop over the projections of a scan.
import type { ViewState } from "./view-state";

export const SPEEDS = [1, 2, 4, 6, 8, 12, 16, 24, 30]; // views a second

export class Cine {
  playing = false;
  sweeping = true; // back and forth, as the source moves; otherwise from the first again
  speed = 6;
  private direction = 1;
  private last = 0;

  constructor(private readonly state: ViewState) {}

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

  /** Called once a frame: shows the next view when it is due. */
  update(now: number): void {
    if (!this.playing || now - this.last < 1000 / this.speed) return;
    this.last = Math.max(this.last + 1000 / this.speed, now - 1000); // a hidden page does not catch up
    const { side } = this.state;
    const count = side.source.shape[0], view = this.state.slice(side, "axial");
    if (count < 2) return;
    if (this.sweeping && (view + this.direction < 0 || view + this.direction >= count)) this.direction = -this.direction;
    this.state.goToSlice(side, "axial", this.sweeping ? view + this.direction : (view + 1) % count);
  }
}
