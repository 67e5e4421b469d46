// Commands to the loop, numbered, and how long each takes until a picture obeys it.
import type { Tool, Vector } from "./messages";

/** Numbers of `KINDS` in palpate.server.messages. */
export const AWAY = 0, HOLD = 1, NEEDLES = 2, FREE = 3;

const KEPT = 1024; // delays

export class Commands {
  private serial = 0;
  private readonly kinds = [AWAY, AWAY, AWAY, AWAY];
  private readonly pending: { serial: number; stamp: number }[] = [];
  private readonly delays: number[] = []; // ms

  constructor(private readonly post: (tool: Tool) => void) {}

  /** What one tool wants; stamp: when the hand moved, ms of the page's clock. */
  send(tool: number, kind: number, point: Vector, displacement: Vector, stamp: number): void {
    this.kinds[tool] = kind;
    this.post({ tool, kind, serial: ++this.serial, point, displacement });
    this.pending.push({ serial: this.serial, stamp });
    if (this.pending.length > KEPT) this.pending.shift();
  }

  /** One tool lets go, if it was anywhere. */
  away(tool: number): void {
    if (this.kinds[tool] === AWAY) return;
    this.kinds[tool] = AWAY;
    this.post({ tool, kind: AWAY, serial: ++this.serial, point: [0, 0, 0], displacement: [0, 0, 0] });
  }

  /** Serial of the newest command. */
  get sent(): number {
    return this.serial;
  }

  /** Is a tool of ours anywhere? */
  out(tool: number): boolean {
    return this.kinds[tool] !== AWAY;
  }

  /** A picture was drawn of a frame that obeys all up to a serial. */
  drawn(serial: number, now: number): void {
    while (this.pending.length && this.pending[0].serial <= serial) {
      this.delays.push(now - this.pending.shift()!.stamp);
      if (this.delays.length > KEPT) this.delays.shift();
    }
  }

  /** Forgets what no picture will obey: the server has changed. */
  forget(): void {
    this.pending.length = 0;
  }

  /** ms from the hand's move to the picture: of the last ones, the median and the 99th percentile. */
  latency(last = 200): { median: number; p99: number; count: number } {
    const sorted = this.delays.slice(-last).sort((a, b) => a - b), count = sorted.length;
    const at = (share: number) => (count ? sorted[Math.min(count - 1, Math.floor(share * count))] : NaN);
    return { median: at(0.5), p99: at(0.99), count };
  }
}
