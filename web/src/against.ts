// What is said of the error that colours the organ: against what, how much at most, and of the force.
import { element, write } from "./controls";
import { NEEDLE } from "./instruments";
import type { Difference, Frame, Scene } from "./messages";

const STEPS = 65535; // of the biggest distance
const WORDS_EVERY = 250; // ms

/** By `Difference.state`. */
const WITHOUT = [
  "The reference is being prepared…",
  "",
  "This mesh has no reference: its stiffness cannot be factored.",
  "No reference: the tools press the same nodes.",
];

export class Against {
  private newest: Difference | null = null;
  private writtenAt = -Infinity;

  /** A difference has come. */
  take(difference: Difference): void {
    this.newest = difference;
  }

  /** Another organ: what is known is of the last one. */
  forget(): void {
    this.newest = null;
    this.writtenAt = -Infinity;
  }

  show(on: boolean): void {
    element("against").hidden = !on;
    this.forget();
  }

  /** Writes, not with every frame: nobody reads so fast. */
  write(scene: Scene | null, frame: Frame | null, now = performance.now()): void {
    if (now - this.writtenAt < WORDS_EVERY) return;
    this.writtenAt = now;
    write("against-what", `from linear finite elements, same mesh${aside(scene, frame)}`);
    write("against-figures", figures(this.newest));
  }
}

function figures(newest: Difference | null): string {
  if (!newest || newest.state !== 1) return WITHOUT[newest?.state ?? 0];
  const most = newest.count ? STEPS * newest.step : 0;
  const told = [`At most ${most.toFixed(3)} mm`];
  if (newest.force.some((x) => x !== 0)) told.push(`force ${(100 * newest.off).toFixed(1)} % off`);
  return told.join(" · ");
}

/** What the reference does not know. */
function aside(scene: Scene | null, frame: Frame | null): string {
  const notes: string[] = [];
  if (frame && scene?.models[frame.model] === "neo-hookean") notes.push("this model is of finite strain");
  if (frame && frame.inside[NEEDLE] > 0) notes.push("of a needle only the pull at its entry");
  return notes.map((note) => `; ${note}`).join("");
}
