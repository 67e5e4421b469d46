// Lines on a triangle mesh: where a plane through two of its points cuts it. On a plane and on a sphere that is the
// shortest way between them. Elsewhere it is the way of a tape laid straight across, never shorter than the shortest one.
import { add, dot, interpolate, length, scale, subtract, unit, type Hit } from "./mesh-geometry";
import type { Vector } from "../protocol/server-messages";

export interface PathPoint {
  at: Vector;
  triangle: number;
}

/** Which triangle lies beyond each edge of triangles first..first + count of a mesh; -1: none, as at a cut. */
export class SurfaceTopology {
  private readonly beyond: Int32Array;

  constructor(readonly triangles: Uint32Array, readonly first: number, readonly count: number) {
    this.beyond = new Int32Array(3 * count).fill(-1);
    const open = new Map<number, number>(); // directed edge -> its place
    for (let i = 0; i < 3 * count; i++) {
      const corner = 3 * first + i, next = i % 3 === 2 ? corner - 2 : corner + 1;
      const a = triangles[corner], b = triangles[next], other = open.get(b * 67108864 + a);
      if (other === undefined) open.set(a * 67108864 + b, i);
      else {
        this.beyond[i] = first + Math.floor(other / 3);
        this.beyond[other] = first + Math.floor(i / 3);
      }
    }
  }

  /** The triangle beyond the edge from corner `c` of triangle `t` to the next corner. */
  neighbor(t: number, c: number): number {
    return this.beyond[3 * (t - this.first) + c];
  }
  /** Positions of the corners of a triangle. */
  corners(t: number, positions: Float32Array): Vector[] {
    return [0, 1, 2].map((c) => {
      const n = 3 * this.triangles[3 * t + c];
      return [positions[n], positions[n + 1], positions[n + 2]];
    });
  }
  /** Normal of a triangle, outwards; its length is twice the area. */
  normal(t: number, positions: Float32Array): Vector {
    const [a, b, c] = this.corners(t, positions);
    return cross(subtract(b, a), subtract(c, a));
  }
}

export const cross = (a: Vector, b: Vector): Vector => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

export const pathLength = (path: PathPoint[]): number => path.slice(1).reduce((sum, point, i) => sum + length(subtract(point.at, path[i].at)), 0);

/** The line from one point of a surface to another in the plane through both that holds `upright`; by default the mean of
 * the normals there. null: the plane's cut of the surface does not lead from one to the other. */
export function sectionPath(surface: SurfaceTopology, positions: Float32Array, from: Hit, to: Hit, upright?: Vector): PathPoint[] | null {
  const { triangles } = surface;
  const start = { at: interpolate(from, positions, triangles), triangle: from.triangle };
  const end = { at: interpolate(to, positions, triangles), triangle: to.triangle };
  if (from.triangle === to.triangle) return [start, end];
  const up = upright ?? add(unit(surface.normal(from.triangle, positions)), unit(surface.normal(to.triangle, positions)));
  const across = cross(subtract(end.at, start.at), up), size = length(across);
  if (size < 1e-9 * length(up)) return null;
  const normal = scale(across, 1 / size);
  const heights = (t: number) => surface.corners(t, positions).map((corner) => dot(subtract(corner, start.at), normal));
  // A corner on the plane counts as above it, so that the cut enters and leaves every triangle by an edge.
  const crossed = (h: number[], c: number) => h[c] >= 0 !== h[(c + 1) % 3] >= 0;

  const walk = (firstEdge: number): PathPoint[] | null => {
    const path = [start];
    for (let t = from.triangle, edge = firstEdge, steps = 0; steps < surface.count; steps++) {
      const h = heights(t), corners = surface.corners(t, positions), next = (edge + 1) % 3, share = h[edge] / (h[edge] - h[next]);
      const beyond = surface.neighbor(t, edge);
      if (beyond < 0) return null;
      path.push({ at: add(corners[edge], scale(subtract(corners[next], corners[edge]), share)), triangle: beyond });
      if (beyond === to.triangle) return [...path, end];
      if (beyond === from.triangle) return null;
      const ahead = heights(beyond), came = [0, 1, 2].find((c) => surface.neighbor(beyond, c) === t);
      const exit = [0, 1, 2].find((c) => c !== came && crossed(ahead, c));
      if (exit === undefined) return null;
      [t, edge] = [beyond, exit];
    }
    return null;
  };
  const here = heights(from.triangle);
  const ways = [0, 1, 2].filter((c) => crossed(here, c)).map(walk).filter((path) => path !== null);
  return ways.length ? ways.reduce((a, b) => (pathLength(b) < pathLength(a) ? b : a)) : null;
}
