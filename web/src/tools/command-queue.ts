// Sends numbered commands to the loop and measures how long each takes until a drawn frame obeys it.
import { CommandKind, TOOLS, type ToolCommand, type Vector } from "../protocol/server-messages";

const CAPACITY = 1024; // commands, delays

export class CommandQueue {
  private serial = 0;
  private readonly kinds: number[] = Array(TOOLS).fill(CommandKind.away); // of the last command of each tool
  private readonly pending: { serial: number; stamp: number }[] = [];
  private readonly delays: number[] = []; // ms

  constructor(private readonly post: (command: ToolCommand) => void) {}

  /** Commands one tool. stamp: time of the user's input, ms of the page's clock. */
  send(tool: number, kind: number, point: Vector, displacement: Vector, stamp: number): void {
    this.kinds[tool] = kind;
    this.post({ tool, kind, serial: ++this.serial, point, displacement });
    this.pending.push({ serial: this.serial, stamp });
    if (this.pending.length > CAPACITY) this.pending.shift();
  }

  /** Lets one tool go, if its last command was another. always: even so. */
  release(tool: number, always = false): void {
    if (this.kinds[tool] === CommandKind.away && !always) return;
    this.kinds[tool] = CommandKind.away;
    this.post({ tool, kind: CommandKind.away, serial: ++this.serial, point: [0, 0, 0], displacement: [0, 0, 0] });
  }

  /** Serial number of the newest command. */
  get lastSerial(): number {
    return this.serial;
  }

  /** A frame was drawn that obeys all commands up to a serial number. */
  frameDrawn(serial: number, now: number): void {
    while (this.pending.length && this.pending[0].serial <= serial) {
      this.delays.push(now - this.pending.shift()!.stamp);
      if (this.delays.length > CAPACITY) this.delays.shift();
    }
  }

  /** Forgets commands that no frame will obey, since the server has changed the scene. */
  clearPending(): void {
    this.pending.length = 0;
  }

  /** Delay from input to drawn frame, ms: median and 99th percentile of the last ones. */
  latency(last = 200): { median: number; p99: number; count: number } {
    const sorted = this.delays.slice(-last).sort((a, b) => a - b), count = sorted.length;
    const quantile = (share: number) => (count ? sorted[Math.min(count - 1, Math.floor(share * count))] : NaN);
    return { median: quantile(0.5), p99: quantile(0.99), count };
  }
}
