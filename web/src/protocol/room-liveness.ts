// Whether a room is heard, and how long its way is. In a room frames come all the time. When none has come for three times the
// way to the server and back, as long as that usually takes at most, and some more, the force is not that of now, and none is
// shown ("stale"). A hand goes on if it was a packet that came late; after MOST_SILENCE its tools let go ("lost"). After GIVEN_UP
// the page connects anew ("given up"): a host that lost its power closes nothing, and another one may have the room.
const MOST_SILENCE = 1500, LEAST_SILENCE = 100, GIVEN_UP = 4000; // ms

export type Liveness = "heard" | "stale" | "lost" | "given up";

export class RoomLiveness {
  private state: Liveness = "heard";
  private at = 0; // ms, when the server was heard last
  private asked: { serial: number; at: number } | null = null; // the command whose answer is being timed
  private mean = MOST_SILENCE; // ms, of the way there and back, smoothed
  private deviation = 0;

  /** changed: the state now, and the one before. */
  constructor(private readonly changed: (state: Liveness, before: Liveness) => void) {}

  /** A connection begins. */
  begin(): void {
    this.at = performance.now();
    [this.mean, this.deviation] = [MOST_SILENCE, 0];
    this.asked = null;
    this.state = "heard";
  }

  /** The server lets itself be heard. */
  hear(): void {
    this.at = performance.now();
    this.become("heard");
  }

  /** Looks whether it is silent. */
  watch(): void {
    const since = performance.now() - this.at, usual = 3 * (this.mean + 4 * this.deviation) + LEAST_SILENCE;
    if (since > GIVEN_UP) this.become("given up");
    else if (since > MOST_SILENCE) this.become("lost");
    else if (since > usual && this.state === "heard") this.become("stale");
  }

  /** A command is sent; the answer to the first of those that are under way is timed. */
  ask(serial: number): void {
    this.asked ??= { serial, at: performance.now() };
  }

  get asking(): boolean {
    return this.asked !== null;
  }

  /** A frame obeys a command. Returns the mean way there and back, ms, if that has been timed now; mean and deviation as of
   * TCP's round trip (RFC 6298). */
  answer(serial: number): number | null {
    if (!this.asked || serial < this.asked.serial) return null;
    const took = performance.now() - this.asked.at, { mean, deviation } = this, first = mean === MOST_SILENCE && deviation === 0;
    [this.mean, this.deviation] = first ? [took, took / 2] : [mean + (took - mean) / 8, deviation + (Math.abs(took - mean) - deviation) / 4];
    this.asked = null;
    return this.mean;
  }

  private become(state: Liveness): void {
    const before = this.state;
    this.state = state;
    if (state !== before) this.changed(state, before);
  }
}
