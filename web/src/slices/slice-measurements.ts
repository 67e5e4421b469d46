// Measurements in slices, in mm: an image's spacing is that of its file, which may differ between the axes.
import type { Vector } from "../protocol/server-messages";
import { angle, crossesItself, quantitiesText, signedArea, type Quantity } from "../organ/measurement";
import { MeasurementSet, progressText, type Measurement } from "../organ/measurement-set";
import type { PlaneName } from "./planes";

/** A point of a slice: its position and where it lies in the slice, mm. side: index of the image. */
export interface SlicePoint {
  at: Vector;
  flat: [number, number];
  side: number;
  plane: PlaneName;
  slice: number;
}

export const sameSlice = (a: SlicePoint, b: SlicePoint): boolean => a.side === b.side && a.plane === b.plane && a.slice === b.slice;

export class SliceMeasurements extends MeasurementSet<SlicePoint> {
  override begin(point: SlicePoint, closes?: (first: SlicePoint) => boolean): void {
    const { unfinished } = this;
    if (unfinished?.kind === this.kind && !sameSlice(unfinished.points[0], point))
      return this.refuse("The other points are in another slice: go back to it, or press Escape.");
    super.begin(point, closes);
  }

  override moveTo(point: SlicePoint): void {
    if (this.unfinished && sameSlice(this.unfinished.points[0], point)) super.moveTo(point);
  }
}

/** What a measurement tells. */
export function sliceQuantities({ kind, points, complete }: Measurement<SlicePoint>): Quantity[] {
  const flat = points.map((point) => point.flat);
  const around = (closed: number) => flat.slice(0, flat.length - 1 + closed).reduce((sum, [x, y], i) => {
    const [u, v] = flat[(i + 1) % flat.length];
    return sum + Math.hypot(u - x, v - y);
  }, 0);
  if (kind === "distance" && points.length > 1) return [{ name: "", value: around(0), unit: "mm" }];
  if (kind === "angle" && complete) return [{ name: "", value: angle(flat.map(([x, y]) => [x, y, 0])), unit: "°" }];
  if (kind !== "area" || !complete) return [];
  const value = crossesItself(flat) ? null : Math.abs(signedArea(flat));
  return [{ name: "", value, unit: "mm²" }, { name: "outline", value: around(1), unit: "mm" }];
}

/** The lines of a measurement in the list. where: the slice that it is in. */
export const listedLines = (measurement: Measurement<SlicePoint>, where: string): string[] => [
  measurement.complete ? quantitiesText(sliceQuantities(measurement)) : progressText(measurement), where,
];
