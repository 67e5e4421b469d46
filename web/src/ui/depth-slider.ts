// The slider of the selected tool: depth, lift, closing or insertion, mm.
import { element, write } from "./controls";
import { TOOL_KINDS, type ToolController, type ToolKind } from "../tools/tool-controller";
import type { Scene } from "../protocol/server-messages";
import type { OrganView } from "../rendering/organ-view";

const LABELS: Record<ToolKind, string> = { press: "Press by", pull: "Lift by", grasp: "Pinch by", needle: "Drive to", cut: "Cut to", measure: "", camera: "" };

export class DepthSlider {
  private readonly slider = element<HTMLInputElement>("amount");
  private readonly ranges: Record<ToolKind, [number, number]> = { press: [0, 1], pull: [0, 1], grasp: [0, 1], needle: [0, 1], cut: [0, 1], measure: [0, 0], camera: [0, 0] };
  private step = 1; // mm
  private shown: [ToolKind, number] | null = null;
  private first: Partial<Record<ToolKind, number>> = {}; // amounts, mm

  constructor(private readonly controller: ToolController) {
    this.slider.addEventListener("input", () => this.set(Number(this.slider.value)));
  }

  /** Sets the ranges for another organ: up to a third of its smallest side, beyond which no linear model is valid. Another
   * mesh of the same organ keeps the selected amounts. */
  setOrgan(scene: Scene, view: OrganView): void {
    const { smallestSide, size } = view, { radius, reach } = scene, first = this.shown === null;
    const ranges: Record<ToolKind, [number, number]> = {
      press: [0, 0.3 * smallestSide],
      pull: [-0.3 * smallestSide, 0.3 * smallestSide],
      grasp: [0, 1.2 * radius],
      needle: [0, Math.min(0.99 * reach, 1.6 * size)],
      cut: [this.step, this.controller.blade.greatestDepth],
      measure: [0, 0],
      camera: [0, 0],
    };
    Object.assign(this.ranges, ranges);
    this.step = 0.01 * size;
    const { amounts } = this.controller;
    this.first = { press: 0.1 * smallestSide, pull: 0, grasp: 0.5 * radius, needle: 0, cut: scene.depth };
    if (first) Object.assign(amounts, this.first);
    for (const kind of TOOL_KINDS) amounts[kind] = this.clamp(kind, amounts[kind]);
    this.update(true);
  }

  /** The amounts as they were at first. */
  reset(): void {
    for (const kind of TOOL_KINDS) this.controller.amounts[kind] = this.clamp(kind, this.first[kind] ?? 0);
    this.update(true);
  }

  private clamp(kind: ToolKind, mm: number): number {
    return Math.max(this.ranges[kind][0], Math.min(this.ranges[kind][1], mm));
  }

  /** Sets the amount of the selected tool, mm, as far as its range allows. */
  set(mm: number): void {
    this.controller.setAmount(this.controller.kind, this.clamp(this.controller.kind, mm));
    this.update();
  }

  /** Changes the amount by so many steps. */
  change(steps: number): void {
    const { kind, amounts } = this.controller, factor = kind === "needle" || kind === "pull" || kind === "cut" ? 2 : 1;
    this.set(amounts[kind] + factor * this.step * steps);
  }

  /** Shows the tool controller's amount. */
  update(always = false): void {
    const { kind, amounts } = this.controller, mm = amounts[kind];
    if (!always && this.shown?.[0] === kind && this.shown[1] === mm) return;
    if (always || this.shown?.[0] !== kind) {
      [this.slider.min, this.slider.max] = this.ranges[kind].map(String);
      this.slider.step = String(this.step / 10);
      write("amount-name", LABELS[kind]);
    }
    this.shown = [kind, mm];
    element("amount-row").hidden = kind === "measure" || kind === "camera";
    this.slider.value = String(mm);
    const text = kind === "cut" && this.controller.blade.goesThrough ? "through" : `${mm.toFixed(1).replace("-", "−")} mm`;
    this.slider.setAttribute("aria-valuetext", text);
    write("amount-set", text);
  }
}
