// The color scale: its ends, the largest value of now, and what lies beyond the model. Its ends stay until the user sets them.
import { UNITS, VIRIDIS } from "../organ/color-map";
import type { ColorMode, Ends, Scale } from "../protocol/worker-messages";
import { element, write } from "./controls";

export class ColorLegend {
  scale: Scale = null; // of the colors that are shown
  private mode: ColorMode = "plain";
  private most = 0; // the largest value since the scale was fitted: no hand is free for a button while it presses
  private readonly upperEnd = element<HTMLInputElement>("scale-high");

  constructor(onEnds: (mode: ColorMode, ends: Ends) => void) {
    element("colors").style.background = `linear-gradient(90deg, ${VIRIDIS.map((rgb) => `rgb(${rgb})`)})`;
    this.upperEnd.addEventListener("change", () => {
      const high = Number(this.upperEnd.value), low = this.scale?.ends[0] ?? 0;
      if (high > low) onEnds(this.mode, [low, high]);
    });
    element("scale-fit").addEventListener("click", () => {
      const low = this.scale?.range[0] ?? 0, high = this.most;
      this.most = 0;
      if (high > low) onEnds(this.mode, [low, roundUp(high)]);
    });
  }

  /** model: the name of the one that moves the organ. */
  update(scale: Scale, mode: ColorMode, model: string): void {
    if (mode !== this.mode) this.most = 0;
    this.scale = scale;
    this.mode = mode;
    element("scale").hidden = element("largest").hidden = element("scale-row").hidden = !scale;
    element("legend").hidden = !scale && mode !== "error";
    element("beyond").hidden = !scale || scale.limit === null || scale.range[1] <= scale.limit;
    if (!scale) return;
    const { ends, range, limit } = scale, unit = UNITS[mode];
    write("low", text(ends[0]));
    write("high", `${text(ends[1])} ${unit}`);
    write("scale-unit", unit);
    if (document.activeElement !== this.upperEnd) this.upperEnd.value = text(ends[1]);
    this.most = Math.max(this.most, range[1]);
    const told = (value: number) => (value > ends[1] / 1e4 ? text(value) : "0"); // rounding is no strain
    write("largest", `Largest now: ${told(range[1])} ${unit}, so far: ${told(this.most)}`);
    if (limit !== null) write("beyond", `Pink: over ${limit} ${unit}, more than the model ${model} can mean`);
  }
}

const text = (value: number): string => String(Number(value.toPrecision(2)));

/** The next number of two digits. */
function roundUp(value: number): number {
  const digit = 10 ** (Math.floor(Math.log10(value)) - 1);
  return Number((Math.ceil(value / digit - 1e-6) * digit).toPrecision(2));
}
