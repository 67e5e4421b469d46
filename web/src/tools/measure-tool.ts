// The tool Measure: points on the organ's surface, and what lies between them. The surface's triangles carry the points.
import {
  angle, CLOSING_DISTANCE, COMPLETE, MEASURE_NAMES, MOST_MEASUREMENTS, MOST_POINTS, type MeasureKind, type Quantity,
} from "../organ/measurement";
import { interpolate, length, subtract, type Hit } from "../organ/mesh-geometry";
import { enclosedSurface } from "../organ/surface-area";
import { pathLength, sectionPath, SurfaceTopology, type PathPoint } from "../organ/surface-path";
import type { Organ } from "../protocol/worker-messages";
import type { OrganView } from "../rendering/organ-view";

const INSIDE = 1e-4; // least weight of a corner: a point stays inside its triangle, where a line through it has two edges to leave by

export interface Measurement {
  name: string;
  kind: MeasureKind;
  hits: Hit[];
  complete: boolean;
}
/** What a measurement tells of some positions of the nodes. line: on the surface. */
export interface Measured {
  quantities: Quantity[];
  line: PathPoint[];
}

export class MeasureTool {
  kind: MeasureKind = "distance";
  list: Measurement[] = [];
  placing = false; // the newest point follows the pointer
  private surface: SurfaceTopology | null = null;
  private numbers: Record<MeasureKind, number> = { distance: 0, angle: 0, area: 0 };

  /** onChange: called after every change. refuse: tells the user why there is no point. */
  constructor(private readonly view: OrganView, private readonly onChange: () => void, private readonly refuse: (why: string) => void) {}

  private get unfinished(): Measurement | null {
    const last = this.list.at(-1);
    return last && !last.complete ? last : null;
  }

  /** Measures on another organ. again: the place of a point on it; null: it has none. */
  setOrgan(organ: Organ, again: (hit: Hit) => Hit | null): void {
    const outer = organ.scene.parts.find((part) => !part.inside)!;
    this.placing = false;
    this.list = this.list
      .map((each) => ({ ...each, hits: each.hits.map(again) }))
      .filter((each): each is Measurement => !each.hits.includes(null));
    this.surface = new SurfaceTopology(organ.triangles, outer.first, outer.count);
  }

  /** Sets a point; it follows the pointer until `place`. */
  begin(hit: Hit): void {
    let { unfinished } = this;
    if (unfinished && unfinished.kind !== this.kind) this.abandon(), (unfinished = null);
    if (!unfinished) {
      if (this.list.length >= MOST_MEASUREMENTS) return this.refuse(`There are ${MOST_MEASUREMENTS} measurements: remove one first.`);
      const name = `${MEASURE_NAMES[this.kind]} ${++this.numbers[this.kind]}`;
      this.list.push((unfinished = { name, kind: this.kind, hits: [], complete: false }));
    }
    if (this.kind === "area" && unfinished.hits.length > 2 && this.nearFirst(hit)) return this.finish();
    if (unfinished.hits.length >= MOST_POINTS) return this.refuse(`An area has ${MOST_POINTS} points at most: close it.`);
    unfinished.hits.push(inside(hit));
    this.placing = true;
    this.onChange();
  }

  private nearFirst(hit: Hit): boolean {
    const [a, b] = [hit, this.unfinished!.hits[0]].map((each) => this.view.toPixel(interpolate(each, this.view.positions, this.surface!.triangles)));
    return Math.hypot(a[0] - b[0], a[1] - b[1]) < CLOSING_DISTANCE;
  }

  moveTo(hit: Hit | null): void {
    if (!hit || !this.unfinished) return;
    this.unfinished.hits[this.unfinished.hits.length - 1] = inside(hit);
    this.onChange();
  }

  /** The point stays. */
  place(): void {
    this.placing = false;
    const { unfinished } = this;
    if (unfinished && unfinished.hits.length >= COMPLETE[unfinished.kind]) unfinished.complete = true;
    this.onChange();
  }

  /** Closes an area. */
  finish(): void {
    const { unfinished } = this;
    if (unfinished?.kind !== "area" || unfinished.hits.length < 3) return this.refuse("An area needs three points.");
    unfinished.complete = true;
    this.onChange();
  }

  /** Takes the newest point back, or the newest measurement. */
  undo(): void {
    const last = this.list.at(-1);
    if (!last) return this.refuse("There is no measurement to take back.");
    if (!last.complete && last.hits.length > 1) last.hits.pop();
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
    this.numbers = { distance: 0, angle: 0, area: 0 };
    this.onChange();
  }

  /** What a measurement tells with the nodes at these positions. */
  evaluate({ kind, hits, complete }: Measurement, positions: Float32Array): Measured {
    const surface = this.surface!, points = hits.map((hit) => interpolate(hit, positions, surface.triangles));
    const straight = points.map((at, i) => ({ at, triangle: hits[i].triangle }));
    if (kind === "angle") return { quantities: complete ? [{ name: "", value: angle(points), unit: "°" }] : [], line: straight };
    if (kind === "distance") {
      if (hits.length < 2) return { quantities: [], line: straight };
      const path = sectionPath(surface, positions, hits[0], hits[1]);
      const quantities = [
        { name: "", value: length(subtract(points[1], points[0])), unit: "mm" },
        { name: "along the surface", value: path && pathLength(path), unit: "mm" },
      ];
      return { quantities, line: path ?? straight };
    }
    if (!complete) return { quantities: [], line: straight };
    const enclosed = enclosedSurface(surface, positions, hits);
    const quantities = [
      { name: "", value: enclosed && enclosed.area, unit: "mm²" },
      { name: "outline", value: enclosed && pathLength(enclosed.outline), unit: "mm" },
    ];
    return { quantities, line: enclosed?.outline ?? [...straight, straight[0]] };
  }

  /** Does the surface face the eye at this point of a line? */
  facesEye({ at, triangle }: PathPoint): boolean {
    const normal = this.surface!.normal(triangle, this.view.positions), toEye = subtract(this.view.turntable.eye, at);
    return normal[0] * toEye[0] + normal[1] * toEye[1] + normal[2] * toEye[2] > 0;
  }
}

function inside(hit: Hit): Hit {
  const raised = hit.weights.map((weight) => Math.max(weight, INSIDE)), sum = raised[0] + raised[1] + raised[2];
  return { ...hit, weights: [raised[0] / sum, raised[1] / sum, raised[2] / sum] };
}
