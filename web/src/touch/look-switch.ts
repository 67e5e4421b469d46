// How the organ is drawn: as tissue, plainly, or as a wireframe. Tissue or plain is remembered.
import { selector } from "../ui/controls";
import type { Appearance, Look } from "../rendering/appearance";

export class LookSwitch {
  private readonly select: (value: Look | "wire") => void;
  private wired = false;

  /** drawWires: shows edges alone, or not. */
  constructor(private readonly appearance: Appearance, drawWires: (on: boolean) => void) {
    this.select = selector<Look | "wire">("shading", (value) => {
      this.wired = value === "wire";
      if (value !== "wire") appearance.look = value;
      drawWires(this.wired);
    });
    this.reset();
  }

  /** No wireframe; the look stays. */
  reset(): void {
    this.select(this.appearance.look);
  }
  toggleWires(): void {
    this.select(this.wired ? this.appearance.look : "wire");
  }
  toggleLook(): void {
    this.select(this.appearance.look === "plain" ? "tissue" : "plain");
  }
}
