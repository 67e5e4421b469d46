// The area of a surface within a polygon on it, and the volume within a closed surface.
import { add, dot, interpolate, length, scale, unit, type Hit } from "./mesh-geometry";
import { crossesItself, signedArea } from "./measurement";
import { cross, sectionPath, type PathPoint, type SurfaceTopology } from "./surface-path";
import type { Vector } from "../protocol/server-messages";

const STEEPEST = 1e-6; // cosine of a triangle's slope: a steeper one is seen edge-on

/** What a polygon on a surface encloses. outline: its edges on the surface. */
export interface Enclosed {
  area: number; // mm²
  outline: PathPoint[];
}

/** The polygon's edges are cuts of the surface by planes that hold the polygon's mean normal; what it encloses is what is
 * seen within it along that normal, as far as it hangs together and faces that way. null: an edge leaves the surface, or
 * the polygon crosses itself. */
export function enclosedSurface(surface: SurfaceTopology, positions: Float32Array, hits: Hit[]): Enclosed | null {
  const points = hits.map((hit) => interpolate(hit, positions, surface.triangles));
  let vectorArea: Vector = [0, 0, 0];
  points.forEach((p, i) => (vectorArea = add(vectorArea, scale(cross(p, points[(i + 1) % points.length]), 0.5))));
  if (length(vectorArea) < 1e-9) return null;
  // The side that is seen, whichever way round the points were set.
  const facing = hits.reduce((sum, hit) => sum + dot(unit(surface.normal(hit.triangle, positions)), vectorArea), 0);
  const normal = scale(unit(vectorArea), Math.sign(facing) || 1);
  const axis: Vector = Math.abs(normal[0]) < 0.6 ? [1, 0, 0] : [0, 1, 0], e = unit(cross(normal, axis)), f = cross(normal, e);
  const flat = (p: Vector): [number, number] => [dot(p, e), dot(p, f)];
  const polygon = points.map(flat);
  if (crossesItself(polygon)) return null;
  const outline: PathPoint[] = [];
  for (let i = 0; i < hits.length; i++) {
    const edge = sectionPath(surface, positions, hits[i], hits[(i + 1) % hits.length], normal);
    if (!edge) return null;
    outline.push(...edge);
  }
  return { area: floodArea(surface, positions, hits, normal, polygon, flat), outline };
}

/** Sums the parts of triangles within the polygon, from the triangles of its corners on. */
function floodArea(
  surface: SurfaceTopology, positions: Float32Array, hits: Hit[], normal: Vector, polygon: [number, number][], flat: (p: Vector) => [number, number],
): number {
  const waiting = [...new Set(hits.map((hit) => hit.triangle))], seen = new Set(waiting), corners = new Set(waiting);
  let sum = 0;
  for (let t = waiting.pop(); t !== undefined; t = waiting.pop()) {
    const twice = surface.normal(t, positions), slope = dot(twice, normal) / (length(twice) || 1);
    if (slope < STEEPEST) continue;
    const inside = Math.abs(signedArea(clip(polygon, surface.corners(t, positions).map(flat))));
    sum += inside / slope;
    if (inside < 1e-9 && !corners.has(t)) continue;
    for (let c = 0; c < 3; c++) {
      const next = surface.neighbor(t, c);
      if (next >= 0 && !seen.has(next)) seen.add(next), waiting.push(next);
    }
  }
  return sum;
}

/** The part of a polygon within a triangle that runs counterclockwise (Sutherland & Hodgman 1974). */
function clip(polygon: [number, number][], triangle: [number, number][]): [number, number][] {
  let part = polygon;
  for (let c = 0; c < 3 && part.length; c++) {
    const [ax, ay] = triangle[c], [bx, by] = triangle[(c + 1) % 3];
    const height = ([x, y]: [number, number]) => (bx - ax) * (y - ay) - (by - ay) * (x - ax);
    const next: [number, number][] = [];
    part.forEach((p, i) => {
      const q = part[(i + 1) % part.length], h = height(p), k = height(q);
      if (h >= 0) next.push(p);
      if (h >= 0 !== k >= 0) next.push([p[0] + ((q[0] - p[0]) * h) / (h - k), p[1] + ((q[1] - p[1]) * h) / (h - k)]);
    });
    part = next;
  }
  return part;
}

const OPEN = 1e-4; // of the area: a larger sum of directed areas is that of an open surface

/** Volume within triangles, mm³, by the divergence theorem; null if they do not close. `chosen`: those that count. */
export function enclosedVolume(
  positions: Float32Array, triangles: Uint32Array, first: number, count: number, chosen: (node: number) => boolean = () => true,
): number | null {
  let volume = 0, area = 0, x = 0, y = 0, z = 0;
  const [ox, oy, oz] = positions.subarray(3 * triangles[3 * first]); // near: sums keep their digits
  for (let i = 3 * first; i < 3 * (first + count); i += 3) {
    if (!chosen(triangles[i])) continue;
    const a = 3 * triangles[i], b = 3 * triangles[i + 1], c = 3 * triangles[i + 2];
    const ax = positions[a] - ox, ay = positions[a + 1] - oy, az = positions[a + 2] - oz;
    const bx = positions[b] - ox, by = positions[b + 1] - oy, bz = positions[b + 2] - oz;
    const cx = positions[c] - ox, cy = positions[c + 1] - oy, cz = positions[c + 2] - oz;
    const nx = (by - ay) * (cz - az) - (bz - az) * (cy - ay);
    const ny = (bz - az) * (cx - ax) - (bx - ax) * (cz - az);
    const nz = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    volume += (ax * nx + ay * ny + az * nz) / 6;
    area += Math.hypot(nx, ny, nz);
    x += nx, y += ny, z += nz;
  }
  return area && Math.hypot(x, y, z) < OPEN * area ? Math.abs(volume) : null;
}
