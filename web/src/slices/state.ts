// What is looked at, and how. Everything that changes it says so, and the page draws once a frame.
import type { Image, Vector, Window } from "../messages";
import { NAMES, PLANES, type PlaneName, type SlabMode } from "./planes";
import type { Index, Stored } from "./stored";

export type Layout = "all" | PlaneName | "render";
export type Tool = "cross" | "window" | "pan" | "profile";

/** One image of the one or two. centre: mm, what the middle of each plane's pane shows; zoom: 1 fits. */
export interface Side {
  image: Image;
  stored: Stored;
  cross: Vector;
  centre: Record<PlaneName, Vector>;
  zoom: Record<PlaneName, number>;
  low: number;
  high: number;
  preset: string;
}

export const DEEPEST = 40; // mm of a slab

export class State {
  linked = true;
  layout: Layout = "all";
  active: PlaneName = "axial";
  chosen = 0; // the side that was touched last
  slab = 0; // mm
  mode: SlabMode = "mean";
  tool: Tool = "cross";
  inverted = false;
  smooth = true;
  crossed = true;
  profile: { start: Vector; end: Vector } | null = null;
  mark: Vector | null = null; // where a profile starts that has no end yet

  constructor(readonly sides: Side[], private readonly told: () => void) {}

  changed(): void {
    this.told();
  }

  get scan(): boolean {
    return this.sides[0].image.scan;
  }
  get side(): Side {
    return this.sides[this.chosen];
  }
  get planes(): PlaneName[] {
    return this.scan ? ["axial"] : NAMES;
  }

  /** `side`, and the others too if they are linked. */
  together(side: Side): Side[] {
    return this.linked ? this.sides : [side];
  }

  /** The crosshair to the nearest voxel of `side`; linked sides to the same place in mm. */
  cross(side: Side, point: Vector): void {
    const at = side.stored.point(side.stored.nearest(side.stored.index(point)));
    for (const each of this.together(side)) each.cross = [...at];
    this.changed();
  }

  /** Moves the crosshair by voxels along z, y, x. */
  step(side: Side, by: Index): void {
    const index = side.stored.nearest(side.stored.index(side.cross));
    this.cross(side, side.stored.point(index.map((i, a) => i + by[a]) as Index));
  }

  /** The slice of a plane in which the crosshair is. */
  slice(side: Side, name: PlaneName): number {
    return side.stored.nearest(side.stored.index(side.cross))[PLANES[name].cut];
  }

  toSlice(side: Side, name: PlaneName, k: number): void {
    const by: Index = [0, 0, 0], { cut } = PLANES[name];
    by[cut] = Math.max(0, Math.min(side.stored.shape[cut] - 1, k)) - this.slice(side, name);
    this.step(side, by);
  }

  /** Grey from low to high; a linked side follows if its values are of the same kind. */
  window(side: Side, low: number, high: number, preset = ""): void {
    if (!(high > low)) return;
    for (const each of this.together(side))
      if (each.stored.stack.unit === side.stored.stack.unit) Object.assign(each, { low, high, preset });
    this.changed();
  }

  /** A preset by name: each linked side takes its own, but of "Data" and "Full" they share the chosen side's. */
  preset(side: Side, name: string): void {
    const own = (each: Side) => each.stored.stack.windows.find((w) => w.name === name);
    const mine: Window | undefined = own(side);
    if (!mine) return;
    for (const each of this.together(side)) {
      const window = each.stored.stack.unit === side.stored.stack.unit ? mine : own(each);
      if (window) Object.assign(each, { low: window.low, high: window.high, preset: name });
    }
    this.changed();
  }

  nextPreset(by: number): void {
    const names = this.side.stored.stack.windows.map((w) => w.name);
    const at = names.indexOf(this.side.preset);
    this.preset(this.side, names[(Math.max(at, by > 0 ? -1 : 0) + by + names.length) % names.length]);
  }

  /** Widens the window by a factor and shifts it by a share of its width. */
  turnWindow(side: Side, factor: number, shift: number): void {
    const width = side.high - side.low, level = (side.low + side.high) / 2 + shift * width;
    this.window(side, level - (factor * width) / 2, level + (factor * width) / 2);
  }

  zoomBy(side: Side, name: PlaneName, factor: number): void {
    const zoom = Math.max(0.25, Math.min(64, side.zoom[name] * factor));
    for (const each of this.together(side)) each.zoom[name] = zoom;
    this.changed();
  }

  look(side: Side, name: PlaneName, centre: Vector): void {
    for (const each of this.together(side)) each.centre[name] = [...centre];
    this.changed();
  }

  thicker(by: number): void {
    this.slab = Math.max(0, Math.min(DEEPEST, this.slab + by));
    this.changed();
  }

  /** A profile's start, then its end. */
  markProfile(point: Vector): void {
    if (this.mark) this.profile = { start: this.mark, end: point };
    this.mark = this.mark ? null : point;
    this.changed();
  }

  /** Everything as it was when the page opened, but for the tool. */
  reset(): void {
    for (const side of this.sides) Object.assign(side, fresh(side.image, side.stored));
    if (this.linked) for (const side of this.sides) side.cross = [...this.sides[0].cross];
    this.slab = 0;
    this.profile = this.mark = null;
    this.changed();
  }
}

/** A side as it is first seen: crosshair in the middle, everything fitted. */
export function fresh(image: Image, stored: Stored): Side {
  const middle = stored.shape.map((n) => Math.floor(n / 2)) as Index;
  const cross = stored.point(middle);
  const centre = stored.point(stored.shape.map((n) => (n - 1) / 2) as Index);
  const first = stored.stack.windows[0];
  const every = <T>(make: () => T) => ({ axial: make(), coronal: make(), sagittal: make() });
  return {
    image, stored, cross,
    centre: every<Vector>(() => [...centre]),
    zoom: every(() => 1),
    low: first.low, high: first.high, preset: first.name,
  };
}
