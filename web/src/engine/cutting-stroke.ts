// The way of a blade in the page's own session, from where it enters the tissue to where it leaves it.
import type { Vector } from "../protocol/server-messages";

const SPACING = 0.5; // mean edges between the points of a way
const PIECE = 1; // mean edges by which the way grows until the cut follows
const TOLERANCE = 0.1; // mean edges from the way of the hand: each point that is left costs time
const MOST_POINTS = 400;

export class CuttingStroke {
  readonly way: Vector[];
  ended = false;
  cut = 0; // how many points of the way the cut has followed

  /** edge: mm, of a mean element. depth: mm. direction: of the blade; (0, 0, 0): against the surface. */
  constructor(start: Vector, readonly depth: number, readonly direction: Vector, private readonly edge: number) {
    this.way = [start];
  }

  get end(): Vector {
    return this.way[this.way.length - 1];
  }

  add(point: Vector): void {
    if (distance(point, this.end) >= SPACING * this.edge && this.way.length < MOST_POINTS) this.way.push(point);
  }

  /** Whether the cut is to follow. */
  get due(): boolean {
    const { way, cut } = this, grown = distance(this.end, way[Math.max(cut - 1, 0)]);
    return way.length > Math.max(cut, 1) && (this.ended || grown >= PIECE * this.edge);
  }

  /** The way up to now, of two points or more; from now on the cut has followed it. */
  follow(): Vector[] {
    this.cut = this.way.length;
    return simplified(this.way, TOLERANCE * this.edge);
  }
}

const distance = (a: Vector, b: Vector): number => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

function fromSegment(x: Vector, a: Vector, b: Vector): number {
  const along = b.map((v, d) => v - a[d]), off = x.map((v, d) => v - a[d]);
  const dot = (p: number[], q: number[]) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
  const part = Math.min(1, Math.max(0, dot(off, along) / Math.max(dot(along, along), 1e-12)));
  return Math.hypot(...off.map((v, d) => v - part * along[d]));
}

/** Points of a way such that none that is left out is more than `tolerance` mm from the line between its neighbors:
 * D. H. Douglas & T. K. Peucker, Cartographica 10 (1973) 112. */
export function simplified(way: Vector[], tolerance: number): Vector[] {
  const first = way[0], last = way[way.length - 1];
  const far = way.map((x) => fromSegment(x, first, last)), middle = far.indexOf(Math.max(...far));
  if (way.length < 3 || !(far[middle] > tolerance)) return [first, last];
  return [...simplified(way.slice(0, middle + 1), tolerance), ...simplified(way.slice(middle), tolerance).slice(1)];
}
