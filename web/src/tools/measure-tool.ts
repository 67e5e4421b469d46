// The tool Measure: points on the organ's surface, and what lies between them. The surface's triangles carry the points.
import { angle, CLOSING_DISTANCE, type Quantity } from "../organ/measurement";
import { MeasurementSet, type Measurement } from "../organ/measurement-set";
import { dot, interpolate, length, subtract, type Hit } from "../organ/mesh-geometry";
import { enclosedSurface } from "../organ/surface-area";
import { pathLength, sectionPath, SurfaceTopology, type PathPoint } from "../organ/surface-path";
import type { Organ } from "../protocol/worker-messages";
import type { OrganView } from "../rendering/organ-view";

const INSIDE = 1e-4; // least weight of a corner: a point stays inside its triangle, where a line through it has two edges to leave by

/** What a measurement tells of some positions of the nodes. line: on the surface. */
export interface Measured {
  quantities: Quantity[];
  line: PathPoint[];
}

export class MeasureTool extends MeasurementSet<Hit> {
  private surface: SurfaceTopology | null = null;

  /** note: called with a point that a note is to be written at. */
  constructor(private readonly view: OrganView, onChange: () => void, refuse: (why: string) => void, private readonly note: (hit: Hit) => void) {
    super(onChange, refuse);
  }

  /** Measures on another organ. again: the place of a point on it; null: it has none. */
  setOrgan(organ: Organ, again: (hit: Hit) => Hit | null): void {
    const outer = organ.scene.parts.find((part) => !part.inside)!;
    this.placing = false;
    this.list = this.list
      .map((each) => ({ ...each, points: each.points.map(again) }))
      .filter((each): each is Measurement<Hit> => !each.points.includes(null));
    this.surface = new SurfaceTopology(organ.triangles, outer.first, outer.count);
  }

  override begin(hit: Hit): void {
    super.begin(inside(hit), (first) => {
      const [a, b] = [hit, first].map((each) => this.view.toPixel(interpolate(each, this.view.positions, this.surface!.triangles)));
      return Math.hypot(a[0] - b[0], a[1] - b[1]) < CLOSING_DISTANCE;
    });
  }
  /** The point stays; of a note, its text is asked for. */
  override place(): void {
    const { unfinished } = this;
    super.place();
    if (unfinished?.kind !== "note" || !unfinished.complete) return;
    this.list.pop();
    this.note(unfinished.points[0]);
  }
  override moveTo(hit: Hit): void {
    super.moveTo(inside(hit));
  }

  /** What a measurement tells with the nodes at these positions. */
  evaluate({ kind, points: hits, complete }: Measurement<Hit>, positions: Float32Array): Measured {
    const surface = this.surface!, points = hits.map((hit) => interpolate(hit, positions, surface.triangles));
    if (kind === "note") return { quantities: [], line: [] };
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
    return dot(this.surface!.normal(triangle, this.view.positions), subtract(this.view.turntable.eye, at)) > 0;
  }
}

function inside(hit: Hit): Hit {
  const raised = hit.weights.map((weight) => Math.max(weight, INSIDE)), sum = raised[0] + raised[1] + raised[2];
  return { ...hit, weights: [raised[0] / sum, raised[1] / sum, raised[2] / sum] };
}
