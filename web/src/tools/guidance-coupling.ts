// One end of the coupling between a guiding hand and a guided one: a spring with a damper from the tool of this hand to where
// the other's tool was last said to be. No force crosses the network; each end makes its own. Two layers (M. Franken,
// S. Stramigioli, S. Misra, C. Secchi & A. Macchelli, IEEE Trans. Robot. 27 (2011) 741): the spring says what force should be
// there, and a tank of energy how much of it may be. The hand fills the tank when it moves against the force, and the
// force empties it when it moves the hand. What one end does not need it gives to the other one, as a count that only grows.
// What was given cannot be spent here again, and is there after it was given: however late it comes, both hands together
// never get more than they put in and the tanks held at first.
import type { Vector } from "../protocol/server-messages";

export const STIFFNESS = 0.1; // N/mm, of the spring
export const YIELD = 5; // mm/N: the force does not move a hand without motors, so its tool gives way, as a loose hand would
export const FIRST = 0.8; // N mm, mJ, in the tank of each end at first
const ENOUGH = 0.4; // mJ: with less in the tank, less of the force is shown
const AHEAD = 25; // ticks: the share falls in time for what the hand will get in these, since it may not fall at once
const SHARE_CHANGE = 0.025, FORCE_CHANGE = 0.01; // of the share, and N of the force, a tick at most: a hand feels no step
const DAMPER = 0.05, SLACK = 50; // N/mm, ticks: the damper is in series with a spring, so that it needs no speed
const RISE = 500, FALL = 250; // ticks in which the force begins, and ends
const SLOW = 50; // ticks in which the tool gives way

export class GuidanceCoupling {
  given = 0; // mJ, to the other end so far
  readonly force: Vector = [0, 0, 0]; // N, on this hand
  readonly offset: Vector = [0, 0, 0]; // mm that the tool has given way
  private readonly led: boolean;
  private readonly compliance: number;
  private readonly limit: number;
  private readonly first: number;
  private received = 0; // mJ, from the other end so far
  private gained = 0; // mJ that this hand got, less what it put in
  private before = 0; // the same a tick ago
  private on = false; // the other end is heard
  private share = 1; // of the force that the tank allows
  private gain = 0; // 0 to 1: it begins and ends slowly
  private position: Vector | null = null; // mm, of this hand; its tool is there, and `offset` beyond
  private normal: Vector | null = null; // the tool presses a surface, and gives way along it alone
  private anchor: Vector | null = null; // mm, of the other's tool
  private readonly slow: Vector = [0, 0, 0]; // mm, the damper's end of its spring
  private readonly wanted: Vector = [0, 0, 0]; // N, before the tank

  /** led: whether this hand is guided. compliance: mm/N, YIELD, or 0 for a hand that the force moves. limit: N. first: mJ, in the tank. */
  constructor(led: boolean, compliance: number, limit: number, first = FIRST) {
    this.led = led;
    this.compliance = compliance;
    this.limit = limit;
    this.first = first;
  }

  /** The hand has moved; null: it has let go, and feels no more. normal: of the surface that it presses. */
  move(position: Vector | null, normal: Vector | null = null): void {
    const { force, position: before } = this;
    if (before && position) for (let k = 0; k < 3; k++) this.gained += force[k] * (position[k] - before[k]);
    if (!position) this.clear();
    this.position = position && [...position];
    this.normal = normal;
  }

  /** What is known of the other end: where its tool is, mm, and how much it has given, mJ. */
  hear(anchor: Vector, received: number): void {
    if (!this.on && this.gain === 0) this.stretch(anchor, this.slow);
    this.on = true;
    this.anchor = [...anchor];
    this.received = Math.max(this.received, received);
  }

  /** The guidance is over, or nothing is heard of the other end. */
  end(): void {
    this.on = false;
  }

  /** Nothing is felt, and the tool is where the hand has it. */
  get still(): boolean {
    return this.gain === 0 && this.force.every((f) => f === 0) && this.offset.every((o) => o === 0);
  }

  /** One tick of 1 ms. */
  tick(): void {
    const { force, offset, wanted } = this;
    this.gain = this.on ? Math.min(1, this.gain + 1 / RISE) : Math.max(0, this.gain - 1 / FALL);
    const stored = this.pull();
    const level = this.first + this.received - this.given - this.gained;
    const soon = level - AHEAD * Math.max(0, this.gained - this.before), allowed = Math.max(0, Math.min(1, soon / ENOUGH));
    this.before = this.gained;
    this.share += limited(allowed - this.share, SHARE_CHANGE);
    for (let k = 0; k < 3; k++) force[k] = this.share * wanted[k];
    for (let k = 0; k < 3; k++) {
      const moved = (this.compliance * force[k] - offset[k]) / SLOW;
      offset[k] = Math.abs(offset[k] + moved) < 1e-6 && force[k] === 0 ? 0 : offset[k] + moved;
    }
    const { normal } = this, out = normal ? offset.reduce((sum, x, k) => sum + x * normal[k], 0) : 0;
    if (normal) for (let k = 0; k < 3; k++) offset[k] -= out * normal[k];
    // The hand that guides gives all that it puts in; the guided one keeps what its spring needs to draw it back.
    const spare = level - this.first - (this.led ? stored : 0);
    if (spare > 0) this.given += spare;
  }

  /** Moves `wanted` towards the spring's force. Returns what the spring has stored, mJ. */
  private pull(): number {
    const { wanted, slow } = this, stretch: Vector = [0, 0, 0], spring: Vector = [0, 0, 0];
    if (this.position && this.anchor) this.stretch(this.anchor, stretch);
    for (let k = 0; k < 3; k++) {
      slow[k] += (stretch[k] - slow[k]) / SLACK;
      spring[k] = this.gain * (STIFFNESS * stretch[k] + DAMPER * (stretch[k] - slow[k]));
    }
    const size = Math.hypot(...spring), most = Math.min(1, this.limit / Math.max(size, 1e-12));
    const change = spring.map((s, k) => most * s - wanted[k]), step = Math.hypot(...change);
    for (let k = 0; k < 3; k++) wanted[k] += change[k] * Math.min(1, FORCE_CHANGE / Math.max(step, 1e-12));
    const long = Math.hypot(...stretch), linear = Math.min(long, this.limit / STIFFNESS);
    return this.gain * STIFFNESS * linear * (long - linear / 2);
  }

  private stretch(anchor: Vector, out: Vector): void {
    const at = this.position ?? anchor;
    for (let k = 0; k < 3; k++) out[k] = anchor[k] - at[k] - this.offset[k];
  }

  private clear(): void {
    this.gain = 0;
    for (const vector of [this.force, this.offset, this.wanted, this.slow]) vector.fill(0);
  }
}

const limited = (change: number, most: number): number => Math.max(-most, Math.min(most, change));
