// A stroke of the scalpel: where its blade goes over the organ's surface at rest, and past the organ's edge.
import { add, dot, interpolate, length, scale, subtract, unit, type Hit, type Ray } from "../organ/mesh-geometry";
import { CutStep, type Scalpel, type Vector } from "../protocol/server-messages";
import type { Organ } from "../protocol/worker-messages";
import type { OrganView } from "../rendering/organ-view";

const LEAST_DEPTH = 0.05; // mm
const BEYOND = 1.2; // of a cut's first depth, which is 2.5 mean edges: a cut may begin 4 edges off the surface
const HALVINGS = 10; // from a step of 1,000 pixels to one

export class BladeStroke {
  private hit: Hit | null = null; // on the surface at rest, of the stroke that goes on
  private from: Vector | null = null; // mm, where it begins, until it has a direction
  private sight: Vector | null = null; // of the ray that meets the surface there; null once the blade has left the organ
  private way: Vector | null = null; // unit vector, of its last step
  private sent: Vector = [0, 0, 0]; // mm, where the blade was said to be last

  /** depth: mm, as selected. pickRay: the point of the surface at rest on a ray. */
  constructor(
    private readonly view: OrganView, private readonly depth: () => number,
    private readonly pickRay: (origin: Vector, direction: Vector) => Hit | null, private readonly send: (scalpel: Scalpel) => void,
  ) {}

  get cutting(): boolean {
    return this.hit !== null;
  }

  /** A blade at its greatest depth goes through the organ along the line of sight, and not at right angles to the surface. */
  get goesThrough(): boolean {
    return this.depth() > 0.99 * this.greatestDepth;
  }

  /** mm. */
  get greatestDepth(): number {
    return 2 * this.view.size;
  }

  /** The stroke begins once it has a direction: beyond the organ's edge if it begins there. */
  begin(hit: Hit, sight: Vector, organ: Organ): void {
    this.hit = hit;
    this.sight = sight;
    this.way = null;
    this.from = interpolate(hit, organ.rest, organ.triangles);
    this.show(organ);
  }

  /** The blade goes to where a ray meets the surface, or leaves the organ: it goes to its edge, however far the last point
   * was from there (a fast hand, a slow machine), and on a little, so that the cut goes all the way. */
  move({ origin, direction }: Ray, organ: Organ): void {
    const hit = this.pickRay(origin, direction);
    if (hit) this.follow(hit, organ);
    else {
      const edge = this.sight && this.edge(origin, this.sight, direction);
      if (edge) this.follow(edge, organ);
      const last = interpolate(this.hit!, organ.rest, organ.triangles);
      if (!this.from && this.way) this.tell(CutStep.move, this.beyond(last, this.way, organ));
    }
    this.sight = hit && direction;
  }

  /** The last point of the surface between a ray that meets it and one that does not. */
  private edge(origin: Vector, on: Vector, off: Vector): Hit | null {
    let last: Hit | null = null;
    for (let k = 0; k < HALVINGS; k++) {
      const middle = unit(add(on, off)), hit = this.pickRay(origin, middle);
      if (hit) [last, on] = [hit, middle];
      else off = middle;
    }
    return last;
  }

  private follow(hit: Hit, organ: Organ): void {
    const last = interpolate(this.hit!, organ.rest, organ.triangles);
    const point = interpolate(hit, organ.rest, organ.triangles), step = subtract(point, last);
    if (length(step) === 0) return;
    this.hit = hit;
    this.way = unit(step);
    if (this.from) {
      const before = this.beyond(this.from, scale(this.way, -1), organ), { eye } = this.view.turntable;
      const atEdge = this.pickRay(eye, unit(subtract(before, eye))) === null;
      this.tell(CutStep.begin, atEdge ? before : this.from);
      this.from = null;
    }
    this.tell(CutStep.move, point);
    this.show(organ);
  }

  end(): void {
    if (!this.hit) return;
    if (!this.from) this.tell(CutStep.end, this.sent);
    this.hit = this.from = null;
    this.view.toolMeshes.moveBlade(null);
    this.view.requestRedraw();
  }

  /** Takes the last cut back. */
  undo(): void {
    if (!this.hit) this.send({ step: CutStep.undo, depth: 0, point: [0, 0, 0], direction: [0, 0, 0] });
  }

  /** The organ was cut: the blade is where it was on the new one. */
  relocate(again: (hit: Hit) => Hit): void {
    if (this.hit) this.hit = again(this.hit);
  }

  /** Where the blade goes on that leaves the organ's outline at a point. */
  private beyond(point: Vector, way: Vector, organ: Organ): Vector {
    const sight = unit(subtract(point, this.view.turntable.eye)), across = subtract(way, scale(sight, dot(way, sight)));
    return add(point, scale(unit(across), BEYOND * organ.scene.depth));
  }

  private tell(step: number, point: Vector): void {
    this.sent = point;
    const direction: Vector = this.goesThrough ? unit(subtract(point, this.view.turntable.eye)) : [0, 0, 0];
    this.send({ step, depth: Math.max(this.depth(), LEAST_DEPTH), point, direction });
  }

  private show({ normals, triangles }: Organ): void {
    const hit = this.hit!;
    this.view.toolMeshes.moveBlade(interpolate(hit, this.view.positions, triangles), unit(interpolate(hit, normals, triangles)), this.depth());
    this.view.requestRedraw();
  }
}
