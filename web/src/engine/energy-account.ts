// An account of the energy between a hand and the organ that a page computes. What others do to the tissue could give the hand
// energy that it has not put in. It may have some of that in one contact; beyond, less of the force is shown, so little in
// the end that it never gets more than `MOST`. Its books are those of a passivity observer (B. Hannaford & J.-H. Ryu, IEEE
// Trans. Robot. Autom. 18 (2002) 1). In place of their damper it shows a share of the force: one that depends on the
// balance alone, and smoothly. A share that came back when the hand rests would move the hand again, to and fro.
import type { Vector } from "../protocol/server-messages";

const FREE = 0.8, MOST = 1.6; // N mm, mJ, in a contact: up to FREE the whole force is shown
const CHANGE = 0.025; // of the share, a tick at most: a hand feels no step

export class EnergyAccount {
  share = 1; // of the force that is shown
  private balance = 0; // N mm that the hand has put in and not got back, in this contact
  private position: Vector | null = null;
  private readonly force: Vector = [0, 0, 0]; // N, shown when the hand was there

  /** A new contact. */
  begin(): void {
    this.balance = 0;
    this.share = 1;
    this.position = null;
    this.force.fill(0);
  }

  /** The hand is at a position, mm, and feels a force of the tissue on it, N. */
  move(position: Vector, force: Vector): void {
    const { position: before, force: felt } = this;
    if (before) for (let k = 0; k < 3; k++) this.balance -= 0.5 * (felt[k] + force[k]) * (position[k] - before[k]);
    this.position = [...position];
    for (let k = 0; k < 3; k++) felt[k] = force[k];
  }

  /** A tick has passed. */
  advance(): void {
    const wanted = Math.max(0, Math.min(1, (MOST + this.balance) / (MOST - FREE)));
    this.share += Math.max(-CHANGE, Math.min(CHANGE, wanted - this.share));
  }
}
