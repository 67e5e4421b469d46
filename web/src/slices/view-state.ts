// The state of the viewer. Every change calls `changed`, and the page draws once a frame.
import type { Image, Vector, Window } from "../protocol/server-messages";
import { NAMES, PLANES, type PlaneName, type SlabMode } from "./planes";
import type { Index, ImageSource } from "./image-source";
import { SliceMeasurements } from "./slice-measurements";

export type Layout = "all" | PlaneName | "render";
export type Tool = "crosshair" | "window" | "pan" | "profile" | "measure";

/** One of the one or two images. center: mm, in the middle of each plane's pane; zoom: 1 fits the pane. */
export interface Side {
  image: Image;
  source: ImageSource;
  crosshair: Vector;
  center: Record<PlaneName, Vector>;
  zoom: Record<PlaneName, number>;
  low: number;
  high: number;
  preset: string;
}

const THICKEST_SLAB = 40; // mm

export class ViewState {
  linked = true;
  layout: Layout = "all";
  active: PlaneName = "axial";
  activeSide = 0; // index of the side last used
  slab = 0; // mm
  mode: SlabMode = "mean";
  tool: Tool = "crosshair";
  inverted = false;
  smooth = true;
  crosshairShown = true;
  profile: { start: Vector; end: Vector } | null = null;
  mark: Vector | null = null; // start of a profile without an end

  readonly measurements: SliceMeasurements;

  /** refuse: tells the user why something is not done. */
  constructor(readonly sides: Side[], private readonly onChange: () => void, refuse: (why: string) => void = () => {}) {
    this.measurements = new SliceMeasurements(onChange, refuse);
  }

  changed(): void {
    this.onChange();
  }

  get scan(): boolean {
    return this.sides[0].image.scan;
  }
  get side(): Side {
    return this.sides[this.activeSide];
  }
  get planes(): PlaneName[] {
    return this.scan ? ["axial"] : NAMES;
  }

  /** All sides if they are linked, otherwise only `side`. */
  linkedSides(side: Side): Side[] {
    return this.linked ? this.sides : [side];
  }

  /** Moves the crosshair to the nearest voxel of `side`; linked sides to the same position in mm. */
  moveCrosshair(side: Side, point: Vector): void {
    const at = side.source.point(side.source.nearest(side.source.index(point)));
    for (const each of this.linkedSides(side)) each.crosshair = [...at];
    this.changed();
  }

  /** Moves the crosshair by voxels along z, y, x. */
  step(side: Side, by: Index): void {
    const index = side.source.nearest(side.source.index(side.crosshair));
    this.moveCrosshair(side, side.source.point(index.map((i, a) => i + by[a]) as Index));
  }

  /** Index of the slice through the crosshair. */
  slice(side: Side, name: PlaneName): number {
    return side.source.nearest(side.source.index(side.crosshair))[PLANES[name].cut];
  }

  goToSlice(side: Side, name: PlaneName, k: number): void {
    const by: Index = [0, 0, 0], { cut } = PLANES[name];
    by[cut] = Math.max(0, Math.min(side.source.shape[cut] - 1, k)) - this.slice(side, name);
    this.step(side, by);
  }

  /** Sets the display window; linked sides follow if their unit is the same. */
  window(side: Side, low: number, high: number, preset = ""): void {
    if (!(high > low)) return;
    for (const each of this.linkedSides(side))
      if (each.source.stack.unit === side.source.stack.unit) Object.assign(each, { low, high, preset });
    this.changed();
  }

  /** A preset by name: each linked side takes its own, but of "Data" and "Full" they share the activeSide side's. */
  preset(side: Side, name: string): void {
    const own = (each: Side) => each.source.stack.windows.find((w) => w.name === name);
    const mine: Window | undefined = own(side);
    if (!mine) return;
    for (const each of this.linkedSides(side)) {
      const window = each.source.stack.unit === side.source.stack.unit ? mine : own(each);
      if (window) Object.assign(each, { low: window.low, high: window.high, preset: name });
    }
    this.changed();
  }

  nextPreset(by: number): void {
    const names = this.side.source.stack.windows.map((w) => w.name);
    const at = names.indexOf(this.side.preset);
    this.preset(this.side, names[(Math.max(at, by > 0 ? -1 : 0) + by + names.length) % names.length]);
  }

  /** Scales the width of the window and shifts it by a fraction of its width. */
  adjustWindow(side: Side, factor: number, shift: number): void {
    const width = side.high - side.low, level = (side.low + side.high) / 2 + shift * width;
    this.window(side, level - (factor * width) / 2, level + (factor * width) / 2);
  }

  zoomBy(side: Side, name: PlaneName, factor: number): void {
    const zoom = Math.max(0.25, Math.min(64, side.zoom[name] * factor));
    for (const each of this.linkedSides(side)) each.zoom[name] = zoom;
    this.changed();
  }

  setCenter(side: Side, name: PlaneName, center: Vector): void {
    for (const each of this.linkedSides(side)) each.center[name] = [...center];
    this.changed();
  }

  changeSlab(by: number): void {
    this.slab = Math.max(0, Math.min(THICKEST_SLAB, this.slab + by));
    this.changed();
  }

  /** Sets the start of a profile at the first call, its end at the second. */
  addProfilePoint(point: Vector): void {
    if (this.mark) this.profile = { start: this.mark, end: point };
    this.mark = this.mark ? null : point;
    this.changed();
  }

  /** The state at the start, but for the tool. */
  reset(): void {
    for (const side of this.sides) Object.assign(side, initialSide(side.image, side.source));
    if (this.linked) for (const side of this.sides) side.crosshair = [...this.sides[0].crosshair];
    this.slab = 0;
    this.profile = this.mark = null;
    this.measurements.clear();
    this.changed();
  }
}

/** The initial state of a side: crosshair in the middle, the image fitted to the pane. */
export function initialSide(image: Image, source: ImageSource): Side {
  const middle = source.shape.map((n) => Math.floor(n / 2)) as Index;
  const crosshair = source.point(middle);
  const center = source.point(source.shape.map((n) => (n - 1) / 2) as Index);
  const first = source.stack.windows[0];
  const every = <T>(make: () => T) => ({ axial: make(), coronal: make(), sagittal: make() });
  return {
    image, source, crosshair,
    center: every<Vector>(() => [...center]),
    zoom: every(() => 1),
    low: first.low, high: first.high, preset: first.name,
  };
}
