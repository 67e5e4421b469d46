// Measurements that a user makes point by point, wherever the points are: on an organ or in a slice.
import { COMPLETE, MEASURE_NAMES, MOST_MEASUREMENTS, MOST_POINTS, type MeasureKind } from "./measurement";

export interface Measurement<Point> {
  name: string;
  kind: MeasureKind;
  points: Point[];
  complete: boolean;
}

export class MeasurementSet<Point> {
  kind: MeasureKind = "distance";
  list: Measurement<Point>[] = [];
  placing = false; // the newest point follows the pointer
  private numbers: Record<MeasureKind, number> = { distance: 0, angle: 0, area: 0, note: 0 };

  /** onChange: called after every change. refuse: tells the user why there is no point. */
  constructor(protected readonly onChange: () => void, protected readonly refuse: (why: string) => void) {}

  /** The one that lacks points. */
  get unfinished(): Measurement<Point> | null {
    const last = this.list.at(-1);
    return last && !last.complete ? last : null;
  }

  /** Sets a point; it follows the pointer until `place`. closes: whether it is at the first one of an area. */
  begin(point: Point, closes: (first: Point) => boolean = () => false): void {
    if (this.unfinished && this.unfinished.kind !== this.kind) this.abandon();
    let { unfinished } = this;
    if (!unfinished) {
      if (this.list.length >= MOST_MEASUREMENTS) return this.refuse(`There are ${MOST_MEASUREMENTS} measurements: remove one first.`);
      unfinished = { name: `${MEASURE_NAMES[this.kind]} ${++this.numbers[this.kind]}`, kind: this.kind, points: [], complete: false };
      this.list.push(unfinished);
    }
    if (this.kind === "area" && unfinished.points.length > 2 && closes(unfinished.points[0])) return this.finish();
    if (unfinished.points.length >= MOST_POINTS) return this.refuse(`An area has ${MOST_POINTS} points at most: close it.`);
    unfinished.points.push(point);
    this.placing = true;
    this.onChange();
  }

  moveTo(point: Point): void {
    if (!this.placing || !this.unfinished) return;
    this.unfinished.points[this.unfinished.points.length - 1] = point;
    this.onChange();
  }

  /** The point stays. */
  place(): void {
    if (!this.placing) return;
    this.placing = false;
    const { unfinished } = this;
    if (unfinished && unfinished.points.length >= COMPLETE[unfinished.kind]) unfinished.complete = true;
    this.onChange();
  }

  /** Closes an area. */
  finish(): void {
    const { unfinished } = this;
    if (unfinished?.kind !== "area" || unfinished.points.length < 3) return this.refuse("An area needs three points.");
    unfinished.complete = true;
    this.onChange();
  }

  /** Takes the newest point back, or the newest measurement. */
  undo(): void {
    const last = this.list.at(-1);
    if (!last) return this.refuse("There is no measurement to take back.");
    if (!last.complete && last.points.length > 1) last.points.pop();
    else this.list.pop();
    this.placing = false;
    this.onChange();
  }

  /** Forgets a measurement that is not complete. */
  abandon(): void {
    if (!this.unfinished) return;
    this.list.pop();
    this.placing = false;
    this.onChange();
  }

  remove(index: number): void {
    this.list.splice(index, 1);
    this.placing = false;
    this.onChange();
  }

  clear(): void {
    this.list = [];
    this.placing = false;
    this.numbers = { distance: 0, angle: 0, area: 0, note: 0 };
    this.onChange();
  }
}

/** How many points a measurement has that is not complete. */
export function progressText({ kind, points }: Measurement<unknown>): string {
  const set = `${points.length} point${points.length > 1 ? "s" : ""}`;
  return kind === "area" ? `${set}; close it at the first one` : `${set} of ${COMPLETE[kind]}`;
}
