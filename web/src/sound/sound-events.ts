// What can be heard of a frame: a tool touches or lets go, a needle pierces the surface, a blade cuts, the force passes its
// limit.
import { length, subtract, toolVector } from "../organ/mesh-geometry";
import { ContactState, TOOLS, type Frame, type Vector } from "../protocol/server-messages";

export type SoundEvent = "contact" | "release" | "pierced" | "cut" | "limit";

const CUT = 1; // mm of a blade's way, for each of which it is heard
const REARMED = 0.9; // of the limit: the force must have been below it before it is told again

/** N, the largest force of a tool. */
export function largestForce(frame: Frame): number {
  return Math.max(...Array.from({ length: TOOLS }, (_, tool) => length(toolVector(frame.force, tool))));
}

/** Finds the events between one frame and the next. */
export class EventDetector {
  private before: Frame | null = null;
  private overLimit = false;
  private cutTo: (Vector | null)[] = Array(TOOLS).fill(null); // where each blade was heard last, mm

  /** The events since the last call. limit: N. */
  add(frame: Frame, limit: number): SoundEvent[] {
    const { before } = this, events = new Set<SoundEvent>(), force = largestForce(frame);
    this.before = frame;
    for (let tool = 0; before && frame.tick > before.tick && tool < TOOLS; tool++) {
      const was = before.contact[tool] === ContactState.closed, is = frame.contact[tool] === ContactState.closed;
      if (is && !was) events.add("contact");
      if (was && !is) events.add("release");
      if (frame.insertion[tool] > 0 && !(before.insertion[tool] > 0)) events.add("pierced");
      if (this.cuts(frame, tool)) events.add("cut");
    }
    if (force > limit && !this.overLimit) events.add("limit");
    if (force > limit || force < REARMED * limit) this.overLimit = force > limit;
    return [...events];
  }

  /** Whether a blade has gone on by a step. */
  private cuts(frame: Frame, tool: number): boolean {
    if (frame.contact[tool] !== ContactState.cutting) return (this.cutTo[tool] = null), false;
    const at = toolVector(frame.point, tool), last = (this.cutTo[tool] ??= at);
    if (length(subtract(at, last)) < CUT) return false;
    this.cutTo[tool] = at;
    return true;
  }

  /** Another organ or session: nothing has happened yet. */
  clear(): void {
    this.before = null;
    this.overLimit = false;
    this.cutTo.fill(null);
  }
}
