// Which triangles are near a point: a grid of cubes, each with the numbers of the triangles that reach into it.
import { add, dot, length, scale, subtract } from "./mesh-geometry";
import type { Vector } from "../protocol/server-messages";

/** The nearest point of a triangle, and its distance. */
export interface Near {
  point: Vector;
  distance: number;
}

export class NearTriangles {
  private readonly cells = new Map<number, number[]>();
  private readonly low: Vector = [Infinity, Infinity, Infinity];

  /** Triangles first..first + count. reach: mm, the largest distance that will be asked for. */
  constructor(private readonly positions: Float32Array, private readonly triangles: Uint32Array, first: number, count: number, private readonly reach: number) {
    for (let i = 0; i < positions.length; i++) this.low[i % 3] = Math.min(this.low[i % 3], positions[i]);
    for (let t = first; t < first + count; t++) {
      const corners = [0, 1, 2].map((c) => this.corner(t, c));
      const from = this.cell(corners.reduce((a, b) => a.map((x, k) => Math.min(x, b[k])) as Vector));
      const to = this.cell(corners.reduce((a, b) => a.map((x, k) => Math.max(x, b[k])) as Vector));
      this.each(from, to, (key) => {
        const there = this.cells.get(key);
        if (there) there.push(t);
        else this.cells.set(key, [t]);
      });
    }
  }

  private corner(triangle: number, c: number): Vector {
    const n = 3 * this.triangles[3 * triangle + c];
    return [this.positions[n], this.positions[n + 1], this.positions[n + 2]];
  }

  private cell(point: Vector): Vector {
    return point.map((x, k) => Math.floor((x - this.low[k]) / this.reach)) as Vector;
  }

  private each(from: Vector, to: Vector, called: (key: number) => void): void {
    for (let i = from[0]; i <= to[0]; i++)
      for (let j = from[1]; j <= to[1]; j++)
        for (let k = from[2]; k <= to[2]; k++) called(((i + 512) * 2048 + j + 512) * 2048 + k + 512);
  }

  /** The nearest point of each triangle within `distance` (mm, at most `reach`), the nearest first. */
  within(distance: number, of: Vector): Near[] {
    const found = new Map<number, Near>();
    const around = (sign: number) => this.cell(of.map((x) => x + sign * distance) as Vector);
    this.each(around(-1), around(1), (key) => {
      for (const t of this.cells.get(key) ?? []) {
        if (found.has(t)) continue;
        const point = nearestOf(of, this.corner(t, 0), this.corner(t, 1), this.corner(t, 2));
        found.set(t, { point, distance: length(subtract(of, point)) });
      }
    });
    return [...found.values()].filter((near) => near.distance < distance).sort((a, b) => a.distance - b.distance);
  }
}

/** The point of a triangle that is nearest to another: of its inside, an edge or a corner (C. Ericson 2005, 5.1.5). */
export function nearestOf(p: Vector, a: Vector, b: Vector, c: Vector): Vector {
  const ab = subtract(b, a), ac = subtract(c, a);
  const [d1, d2] = [dot(ab, subtract(p, a)), dot(ac, subtract(p, a))];
  if (d1 <= 0 && d2 <= 0) return a;
  const [d3, d4] = [dot(ab, subtract(p, b)), dot(ac, subtract(p, b))];
  if (d3 >= 0 && d4 <= d3) return b;
  const vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return add(a, scale(ab, d1 / (d1 - d3)));
  const [d5, d6] = [dot(ab, subtract(p, c)), dot(ac, subtract(p, c))];
  if (d6 >= 0 && d5 <= d6) return c;
  const vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return add(a, scale(ac, d2 / (d2 - d6)));
  const va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return add(b, scale(subtract(c, b), (d4 - d3) / (d4 - d3 + d5 - d6)));
  const sum = va + vb + vc;
  return add(a, add(scale(ab, vb / sum), scale(ac, vc / sum)));
}
