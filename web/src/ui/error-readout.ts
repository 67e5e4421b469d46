// The text below the error scale: what the model is compared with, the largest distance, and the error of the force.
import { element, write } from "./controls";
import { NEEDLE } from "../rendering/tool-meshes";
import { ComparisonState, DISTANCE_STEPS, type Difference, type Frame, type Scene } from "../protocol/server-messages";

const UPDATE_INTERVAL = 250; // ms

/** Text for each state without a result. */
const MESSAGES: Record<number, string> = {
  [ComparisonState.preparing]: "Preparing the reference…",
  [ComparisonState.no_reference]: "No reference: the stiffness matrix of this mesh cannot be factored.",
  [ComparisonState.contacts_overlap]: "No reference: the tools press the same nodes.",
};

export class ErrorReadout {
  private newest: Difference | null = null;
  private updated = -Infinity; // ms

  setDifference(difference: Difference): void {
    this.newest = difference;
  }

  /** Forgets the last difference, since another organ is shown. */
  clear(): void {
    this.newest = null;
    this.updated = -Infinity;
  }

  show(on: boolean): void {
    element("error-readout").hidden = !on;
    this.clear();
  }

  /** Updates the text, a few times a second. */
  update(scene: Scene | null, frame: Frame | null, now = performance.now()): void {
    if (now - this.updated < UPDATE_INTERVAL) return;
    this.updated = now;
    write("error-reference", `from linear finite elements, same mesh${caveats(scene, frame)}`);
    write("error-values", values(this.newest));
  }
}

function values(newest: Difference | null): string {
  if (newest?.state !== ComparisonState.compared) return MESSAGES[newest?.state ?? ComparisonState.preparing];
  const largest = newest.count ? DISTANCE_STEPS * newest.step : 0;
  const parts = [`At most ${largest.toFixed(3)} mm`];
  if (newest.force.some((x) => x !== 0)) parts.push(`force ${(100 * newest.force_error).toFixed(1)} % off`);
  return parts.join(" · ");
}

/** What the reference leaves out. */
function caveats(scene: Scene | null, frame: Frame | null): string {
  const notes: string[] = [];
  if (frame && scene?.models[frame.model] === "neo-hookean") notes.push("this model is of finite strain");
  if (frame && frame.insertion[NEEDLE] > 0) notes.push("of a needle only the pull at its entry");
  return notes.map((note) => `; ${note}`).join("");
}
