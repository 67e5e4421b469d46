// A tool that the page does not move itself: it goes where the room says that it is, without steps.
import type { Vector } from "../protocol/server-messages";

const CATCH_UP = 60; // ticks until it is where the newest frame has it: frames come some 16 ms apart, and later when one is lost
const LETTING_GO = 0.04; // of the force, that goes in a tick
const GONE = 0.01; // of the largest force that it had
const LONGEST = 1000; // ticks of letting go

export class FollowedTool {
  private ticks = 0; // until it is there
  private targetPoint: Vector;
  private target: Vector;
  private largest = 0; // N, force on it so far
  private compliance = 0; // mm/N, of the tissue there: its displacement over its force when that was largest
  private leaving = -1; // ticks since it has let go at the room

  /** point, displacement: mm, where it begins; that of the tissue there, so that nothing moves at first. */
  constructor(readonly point: Vector, readonly displacement: Vector) {
    this.targetPoint = [...point];
    this.target = [...displacement];
  }

  /** Where it is at the room. */
  follow(point: Vector, displacement: Vector): void {
    this.targetPoint = point;
    this.target = displacement;
    this.ticks = CATCH_UP;
    this.leaving = -1;
  }

  /** It has let go at the room. Here its force goes to zero first. */
  leave(): void {
    this.leaving = Math.max(this.leaving, 0);
  }

  /** One tick. force: N, of the tissue on it after the last one. False: it has let go. */
  advance(force: Vector): boolean {
    const { point, displacement } = this, size = Math.hypot(...force);
    if (this.leaving >= 0) {
      // The tissue pulls it back: so far each tick, that its force is less by its part in the next one.
      for (let k = 0; k < 3; k++) displacement[k] += LETTING_GO * this.compliance * force[k];
      return this.leaving++ < LONGEST && size > GONE * this.largest;
    }
    if (size > this.largest) (this.largest = size), (this.compliance = Math.hypot(...displacement) / size);
    if (this.ticks > 0) {
      for (let k = 0; k < 3; k++) {
        point[k] += (this.targetPoint[k] - point[k]) / this.ticks;
        displacement[k] += (this.target[k] - displacement[k]) / this.ticks;
      }
      this.ticks--;
    }
    return true;
  }
}
