// The centre line of a lumen: its branches, how long they are, and the place and direction at each millimetre.
import { add, length, scale, subtract, unit } from "../organ/mesh-geometry";
import type { Scene, Vector } from "../protocol/server-messages";

export interface Station {
  point: Vector;
  radius: number; // mm, of the lumen there
}

const AHEAD = 1; // radii: so far ahead lies what one looks at

export class LumenCenterline {
  readonly branches: Station[][] = [];

  constructor(scene: Scene) {
    for (let i = 0; i < scene.lumen.length; i += 5) {
      const [x, y, z, radius, branch] = scene.lumen.slice(i, i + 5);
      (this.branches[branch] ??= []).push({ point: [x, y, z], radius });
    }
  }

  get isThere(): boolean {
    return this.branches.length > 0;
  }

  /** mm. */
  lengthOf(branch: number): number {
    return this.steps(branch).reduce((sum, step) => sum + step, 0);
  }

  private steps(branch: number): number[] {
    const line = this.branches[branch];
    return line.slice(1).map(({ point }, i) => length(subtract(point, line[i].point)));
  }

  /** Where a branch is after so many mm. */
  at(branch: number, mm: number): Station {
    const line = this.branches[branch];
    let left = mm;
    for (const [i, step] of this.steps(branch).entries()) {
      if (left <= step) {
        const share = step ? Math.max(0, left) / step : 0, a = line[i], b = line[i + 1];
        return { point: add(a.point, scale(subtract(b.point, a.point), share)), radius: a.radius + share * (b.radius - a.radius) };
      }
      left -= step;
    }
    return line[line.length - 1];
  }

  /** The direction in which a branch goes on there, of unit length. */
  direction(branch: number, mm: number): Vector {
    const end = this.lengthOf(branch), { radius } = this.at(branch, mm), ahead = Math.max(AHEAD * radius, 1e-3);
    const from = this.at(branch, Math.min(mm, end - ahead)).point;
    return unit(subtract(this.at(branch, Math.min(mm, end - ahead) + ahead).point, from));
  }

  /** The branch and the mm along it that are nearest to a place; of equal ones the branch that is preferred. */
  nearest(place: Vector, preferred: number): { branch: number; mm: number; distance: number } {
    let best = { branch: preferred, mm: 0, distance: Infinity };
    for (const branch of [preferred, ...this.branches.keys()]) {
      let mm = 0;
      const line = this.branches[branch], steps = this.steps(branch);
      line.forEach(({ point }, i) => {
        const distance = length(subtract(point, place));
        if (distance < best.distance - (branch === best.branch ? 0 : 1e-9)) best = { branch, mm, distance };
        mm += steps[i] ?? 0;
      });
    }
    return best;
  }

  get largestRadius(): number {
    return Math.max(...this.branches.flat().map(({ radius }) => radius));
  }
  get medianRadius(): number {
    const sorted = this.branches.flat().map(({ radius }) => radius).sort((a, b) => a - b);
    return sorted[Math.floor(sorted.length / 2)];
  }
}
