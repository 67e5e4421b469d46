// The camera in a lumen as a ball that the wall holds back. It may press the wall outwards by a part of its radius. Its
// middle keeps the rest of the radius from the wall at rest: a step is shorter than that, and so is each correction of it,
// so that the middle never goes through. Planes close the openings of the lumen.
import { add, dot, length, limitLength, scale, subtract } from "../organ/mesh-geometry";
import { NearTriangles } from "../organ/near-triangles";
import type { Vector } from "../protocol/server-messages";
import type { Organ } from "../protocol/worker-messages";

const GIVE = 0.5; // of the radius: how far it presses the wall at most
const CORRECTIONS = 12; // of a step
const SLACK = 1e-3; // of the distance that is kept
const BESIDE = 0.3; // cosine between two places of the wall that are pressed at once
const NEAR_OPENING = 3; // radii of the lumen: the plane of an opening counts only there

/** Where the ball presses: a point of the wall at rest, and how far that is moved, mm. */
export interface Press {
  point: Vector;
  displacement: Vector;
}

export class CollisionSphere {
  private readonly wall: NearTriangles;
  private readonly kept: number; // mm, from the wall at rest
  private readonly openings: { point: Vector; out: Vector }[] = [];

  /** position: in the lumen, where it begins. radius: mm. lumen: mm, largest radius of the lumen. */
  constructor(organ: Organ, public position: Vector, readonly radius: number, private readonly lumen: number) {
    const surface = organ.scene.parts.find((p) => !p.inside)!, { openings } = organ.scene;
    this.wall = new NearTriangles(organ.rest, organ.triangles, surface.first, surface.count, radius);
    this.kept = (1 - GIVE) * radius;
    for (let i = 0; i < openings.length; i += 6)
      this.openings.push({ point: openings.slice(i, i + 3) as Vector, out: openings.slice(i + 3, i + 6) as Vector });
  }

  /** Goes towards a place, as far as the wall lets it. */
  moveTo(wanted: Vector): void {
    const steps = Math.ceil(length(subtract(wanted, this.position)) / (0.5 * this.kept));
    for (let i = steps; i > 0; i--) { // a step is never longer, also where the wall has held it back
      const allowed = this.corrected(add(this.position, limitLength(scale(subtract(wanted, this.position), 1 / i), 0.5 * this.kept)));
      if (!allowed) return;
      this.position = allowed;
    }
  }

  /** A place that a step led to, moved away from the wall; null if there is no room near it. */
  private corrected(place: Vector): Vector | null {
    for (let i = 0; i < CORRECTIONS; i++) {
      place = this.behindOpenings(place);
      const [nearest] = this.wall.within(this.kept, place);
      if (!nearest) return place;
      if (nearest.distance < 1e-9) return null;
      // A ball of the nearest distance around the place is free: half of it can go through no wall.
      const away = Math.min((1 + SLACK) * this.kept - nearest.distance, 0.5 * nearest.distance);
      place = add(place, scale(subtract(place, nearest.point), away / nearest.distance));
    }
    return this.wall.within(this.kept, place).length ? null : place;
  }

  private behindOpenings(place: Vector): Vector {
    for (const { point, out } of this.openings) {
      const from = subtract(place, point), beyond = dot(from, out) + this.kept;
      if (beyond > 0 && length(from) < NEAR_OPENING * this.lumen) place = subtract(place, scale(out, beyond));
    }
    return place;
  }

  /** Where it presses the wall: the nearest place, and the nearest in another direction. */
  presses(): Press[] {
    const near = this.wall.within(this.radius, this.position), [first] = near;
    if (!first) return [];
    const towards = (one: { point: Vector; distance: number }) => scale(subtract(one.point, this.position), 1 / one.distance);
    const second = near.find((other) => dot(towards(other), towards(first)) < BESIDE);
    return [first, ...(second ? [second] : [])].map((one) => ({ point: one.point, displacement: scale(towards(one), this.radius - one.distance) }));
  }
}
