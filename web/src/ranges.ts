// How deep, how far, how tight: one slider, which means another length for each tool.
import { element, write } from "./controls";
import { KINDS, type Hand, type Kind } from "./hand";
import type { Scene } from "./messages";
import type { View } from "./view";

const NAMES: Record<Kind, string> = { press: "Press by", pull: "Lift by", grasp: "Pinch by", needle: "Drive to" };

export class Ranges {
  private readonly slider = element<HTMLInputElement>("amount");
  private readonly ends: Record<Kind, [number, number]> = { press: [0, 1], pull: [0, 1], grasp: [0, 1], needle: [0, 1] };
  private notch = 1; // mm
  private drawn: [Kind, number] | null = null;

  constructor(private readonly hand: Hand) {
    this.slider.addEventListener("input", () => this.set(Number(this.slider.value)));
  }

  /** Another organ. Beyond a third of its smallest side no linear model is right. A finer mesh keeps what was chosen. */
  show(scene: Scene, view: View): void {
    const { thin, size } = view, { radius, reach } = scene, first = this.drawn === null;
    const ends: Record<Kind, [number, number]> = {
      press: [0, 0.3 * thin],
      pull: [-0.3 * thin, 0.3 * thin],
      grasp: [0, 1.2 * radius],
      needle: [0, Math.min(0.99 * reach, 1.6 * size)],
    };
    Object.assign(this.ends, ends);
    this.notch = 0.01 * size;
    if (first) Object.assign(this.hand.amounts, { press: 0.1 * thin, pull: 0, grasp: 0.5 * radius, needle: 0 });
    for (const kind of KINDS) this.hand.amounts[kind] = this.within(kind, this.hand.amounts[kind]);
    this.draw(true);
  }

  private within(kind: Kind, mm: number): number {
    return Math.max(this.ends[kind][0], Math.min(this.ends[kind][1], mm));
  }

  private set(mm: number): void {
    this.hand.amount(this.hand.kind, this.within(this.hand.kind, mm));
    this.draw();
  }

  drive(notches: number): void {
    const { kind, amounts } = this.hand, step = kind === "needle" || kind === "pull" ? 2 : 1;
    this.set(amounts[kind] + step * this.notch * notches);
  }

  /** Brings the slider up to date. */
  draw(always = false): void {
    const { kind, amounts } = this.hand, mm = amounts[kind];
    if (!always && this.drawn?.[0] === kind && this.drawn[1] === mm) return;
    if (always || this.drawn?.[0] !== kind) {
      [this.slider.min, this.slider.max] = this.ends[kind].map(String);
      this.slider.step = String(this.notch / 10);
      write("amount-name", NAMES[kind]);
    }
    this.drawn = [kind, mm];
    this.slider.value = String(mm);
    const text = `${mm.toFixed(1).replace("-", "−")} mm`;
    this.slider.setAttribute("aria-valuetext", text);
    write("amount-set", text);
  }
}
