// Sends numbered commands to the loop and measures how long each takes until a drawn frame obeys it.
import { add, limitLength, unit } from "../organ/mesh-geometry";
import { CommandKind, TOOLS, type ToolCommand, type Vector } from "../protocol/server-messages";

const CAPACITY = 1024; // commands, delays

/** Where a hand has a tool. slides: it presses the surface, along `displacement`, and may be shifted along it alone. */
interface Held {
  kind: number;
  point: Vector;
  displacement: Vector;
  slides: boolean;
}

/** Where a hand has a tool, mm, and the normal of the surface that it presses. */
export interface HandPlace {
  at: Vector;
  normal: Vector | null;
}

export class CommandQueue {
  reach = Infinity; // mm, the longest displacement
  private serial = 0;
  private offset: Vector = [0, 0, 0]; // mm, of all tools from where the hand has them
  private readonly held: (Held | null)[] = Array(TOOLS).fill(null);
  private readonly kinds: number[] = Array(TOOLS).fill(CommandKind.away); // of the last command of each tool
  private readonly pending: { serial: number; stamp: number }[] = [];
  private readonly delays: number[] = []; // ms

  /** post: sends a command. hand: null: it has let go. */
  constructor(private readonly post: (command: ToolCommand, hand: HandPlace | null) => void) {}

  /** Commands one tool. stamp: time of the user's input, ms of the page's clock. slides: it presses the surface. */
  send(tool: number, kind: number, point: Vector, displacement: Vector, stamp: number, slides = false): void {
    this.kinds[tool] = kind;
    this.held[tool] = { kind, point, displacement, slides };
    this.sendShifted(tool);
    this.pending.push({ serial: this.serial, stamp });
    if (this.pending.length > CAPACITY) this.pending.shift();
  }

  /** From now on all tools are so far, mm, from where the hand has them. */
  shift(offset: Vector): void {
    if (offset.every((x, k) => x === this.offset[k])) return;
    this.offset = [...offset];
    this.held.forEach((held, tool) => held && this.sendShifted(tool));
  }
  get shifted(): boolean {
    return this.offset.some((x) => x !== 0);
  }

  private sendShifted(tool: number): void {
    const { kind, point, displacement, slides } = this.held[tool]!, { offset } = this, command = { tool, kind, serial: ++this.serial, point, displacement };
    if (this.shifted) {
      if (slides || kind === CommandKind.free) command.point = add(point, offset);
      else command.displacement = limitLength(add(displacement, offset), this.reach);
    }
    this.post(command, { at: add(point, displacement), normal: slides ? unit(displacement) : null });
  }

  /** Lets one tool go, if its last command was another. always: even so. */
  release(tool: number, always = false): void {
    if (this.kinds[tool] === CommandKind.away && !always) return;
    this.kinds[tool] = CommandKind.away;
    this.held[tool] = null;
    this.post({ tool, kind: CommandKind.away, serial: ++this.serial, point: [0, 0, 0], displacement: [0, 0, 0] }, null);
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
