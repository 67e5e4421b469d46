// Geometry of triangle meshes: plain loops over typed arrays, several times faster than three.js on a deforming mesh.
import type { Vector } from "../protocol/server-messages";

/** A point of a triangle mesh: its triangle and barycentric weights, and its distance along the ray that found it. */
export interface Hit {
  triangle: number;
  weights: Vector;
  distance: number;
}

/** direction: unit vector. */
export interface Ray {
  origin: Vector;
  direction: Vector;
}

// Tolerance of the barycentric weights, so that a ray through an edge or a corner meets one of the triangles there.
const TOLERANCE = 1e-6;

/** The first of triangles first..first + count that a ray meets, from either side (Möller & Trumbore 1997). */
export function pick(
  origin: Vector, direction: Vector, positions: Float32Array, triangles: Uint32Array, first: number, count: number,
): Hit | null {
  const [ox, oy, oz] = origin;
  const [dx, dy, dz] = direction;
  let best: Hit | null = null;
  for (let t = first; t < first + count; t++) {
    const a = 3 * triangles[3 * t], b = 3 * triangles[3 * t + 1], c = 3 * triangles[3 * t + 2];
    const ax = positions[a], ay = positions[a + 1], az = positions[a + 2];
    const ex = positions[b] - ax, ey = positions[b + 1] - ay, ez = positions[b + 2] - az;
    const fx = positions[c] - ax, fy = positions[c + 1] - ay, fz = positions[c + 2] - az;
    const px = dy * fz - dz * fy, py = dz * fx - dx * fz, pz = dx * fy - dy * fx;
    const determinant = ex * px + ey * py + ez * pz;
    if (Math.abs(determinant) < 1e-12) continue;
    const sx = ox - ax, sy = oy - ay, sz = oz - az;
    const u = (sx * px + sy * py + sz * pz) / determinant;
    if (u < -TOLERANCE || u > 1 + TOLERANCE) continue;
    const qx = sy * ez - sz * ey, qy = sz * ex - sx * ez, qz = sx * ey - sy * ex;
    const v = (dx * qx + dy * qy + dz * qz) / determinant;
    if (v < -TOLERANCE || u + v > 1 + TOLERANCE) continue;
    const distance = (fx * qx + fy * qy + fz * qz) / determinant;
    if (distance > 0 && (!best || distance < best.distance)) best = { triangle: t, weights: [1 - u - v, u, v], distance };
  }
  return best;
}

/** The place of a point on a surface at rest. Exact where the point lies on it; off an edge the weights are cut to 0..1,
 * which is not the nearest point but near. */
export function locate(point: Vector, rest: Float32Array, triangles: Uint32Array, first: number, count: number): Hit {
  let best: Hit = { triangle: first, weights: [1, 0, 0], distance: Infinity };
  const at = (t: number, c: number): Vector => {
    const n = 3 * triangles[3 * t + c];
    return [rest[n], rest[n + 1], rest[n + 2]];
  };
  for (let t = first; t < first + count; t++) {
    const a = at(t, 0), e = subtract(at(t, 1), a), f = subtract(at(t, 2), a), d = subtract(point, a);
    const ee = dot(e, e), ef = dot(e, f), ff = dot(f, f), ed = dot(e, d), fd = dot(f, d);
    const determinant = ee * ff - ef * ef || 1;
    const raw = [(ff * ed - ef * fd) / determinant, (ee * fd - ef * ed) / determinant].map((x) => Math.max(0, Math.min(1, x)));
    const sum = Math.max(1, raw[0] + raw[1]), [u, v] = raw.map((x) => x / sum);
    const distance = length(subtract(d, add(scale(e, u), scale(f, v))));
    if (distance < best.distance) best = { triangle: t, weights: [1 - u - v, u, v], distance };
  }
  return best;
}

/** The node of triangles first..first + count that is nearest to a position. */
export function nearestNode(position: Vector, positions: Float32Array, triangles: Uint32Array, first: number, count: number): Hit {
  let nearest = 0, least = Infinity;
  for (let corner = 3 * first; corner < 3 * (first + count); corner++) {
    const n = 3 * triangles[corner];
    const square = (positions[n] - position[0]) ** 2 + (positions[n + 1] - position[1]) ** 2 + (positions[n + 2] - position[2]) ** 2;
    if (square < least) (least = square), (nearest = corner);
  }
  const weights: Vector = [0, 0, 0];
  weights[nearest % 3] = 1;
  return { triangle: Math.floor(nearest / 3), weights, distance: 0 };
}

/** Vectors given at the nodes, interpolated at a hit. */
export function interpolate(hit: Hit, values: Float32Array, triangles: Uint32Array): Vector {
  const out: Vector = [0, 0, 0];
  for (let c = 0; c < 3; c++) {
    const node = 3 * triangles[3 * hit.triangle + c];
    for (let k = 0; k < 3; k++) out[k] += hit.weights[c] * values[node + k];
  }
  return out;
}

/** Normals of nodes: the sum of the normals of the adjacent triangles, weighted by area; not of unit length. */
export function normals(positions: Float32Array, triangles: Uint32Array, out: Float32Array): void {
  out.fill(0);
  for (let t = 0; t < triangles.length; t += 3) {
    const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
    const ex = positions[b] - positions[a], ey = positions[b + 1] - positions[a + 1], ez = positions[b + 2] - positions[a + 2];
    const fx = positions[c] - positions[a], fy = positions[c + 1] - positions[a + 1], fz = positions[c + 2] - positions[a + 2];
    const nx = ey * fz - ez * fy, ny = ez * fx - ex * fz, nz = ex * fy - ey * fx;
    out[a] += nx; out[a + 1] += ny; out[a + 2] += nz;
    out[b] += nx; out[b + 1] += ny; out[b + 2] += nz;
    out[c] += nx; out[c + 1] += ny; out[c + 2] += nz;
  }
}

/** Scales vectors of three numbers to length 1. */
export function normalize(vectors: Float32Array): void {
  for (let i = 0; i < vectors.length; i += 3) {
    const x = vectors[i], y = vectors[i + 1], z = vectors[i + 2];
    const factor = 1 / (Math.sqrt(x * x + y * y + z * z) || 1);
    vectors[i] = x * factor; vectors[i + 1] = y * factor; vectors[i + 2] = z * factor;
  }
}

/** Writes unit vectors of four 16-bit numbers, 32767 is 1: a third less data for the graphics card than float32. */
export function packNormals(vectors: Float32Array, out: Int16Array): void {
  for (let i = 0, j = 0; i < vectors.length; i += 3, j += 4) {
    const x = vectors[i], y = vectors[i + 1], z = vectors[i + 2];
    const factor = 32767 / (Math.sqrt(x * x + y * y + z * z) || 1);
    out[j] = x * factor; out[j + 1] = y * factor; out[j + 2] = z * factor;
  }
}

/** The edges of triangles first..first + count as pairs of nodes, each once. */
export function uniqueEdges(triangles: Uint32Array, first: number, count: number): Uint32Array<ArrayBuffer> {
  const seen = new Set<number>();
  const pairs: number[] = [];
  for (let t = first; t < first + count; t++)
    for (let c = 0; c < 3; c++) {
      const a = triangles[3 * t + c], b = triangles[3 * t + ((c + 1) % 3)];
      const key = Math.min(a, b) * 67108864 + Math.max(a, b);
      if (!seen.has(key)) {
        seen.add(key);
        pairs.push(a, b);
      }
    }
  return Uint32Array.from(pairs);
}

/** The edges of the triangles of nodes from `first` on that only one of these triangles has, as pairs of nodes. */
export function borderEdges(triangles: Uint32Array, first: number): Uint32Array<ArrayBuffer> {
  const seen = new Map<number, [number, number] | null>();
  for (let t = 0; t < triangles.length; t += 3) {
    if (triangles[t] < first) continue;
    for (let c = 0; c < 3; c++) {
      const a = triangles[t + c], b = triangles[t + ((c + 1) % 3)], key = Math.min(a, b) * 67108864 + Math.max(a, b);
      seen.set(key, seen.has(key) ? null : [a, b]);
    }
  }
  return Uint32Array.from([...seen.values()].filter((pair) => pair !== null).flat());
}

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vector, s: number): Vector => [s * a[0], s * a[1], s * a[2]];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a: Vector): number => Math.hypot(a[0], a[1], a[2]);
/** `a`, shortened to the length `longest` if it is longer. */
export const limitLength = (a: Vector, longest: number): Vector => (length(a) > longest ? scale(a, longest / length(a)) : a);
/** `a` scaled to length 1. */
export const unit = (a: Vector): Vector => scale(a, 1 / (length(a) || 1));
/** The vector of one tool out of those of all. */
export const toolVector = (values: number[], tool: number): Vector => [values[3 * tool], values[3 * tool + 1], values[3 * tool + 2]];
