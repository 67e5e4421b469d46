// Strain of the drawn surface: the larger principal stretch of each triangle in its own plane, the square root of the
// larger eigenvalue of C = FᵀF (Bonet & Wood 2008, section 4.5), minus 1. A node gets the mean over its triangles,
// weighted by their area at rest.

/** Holds for each triangle at rest its area and the inverse of its edge matrix in its plane. */
export class SurfaceStrain {
  private readonly inverse: Float32Array; // a, b, c of the upper triangular inverse
  private readonly area: Float32Array; // twice the area
  private readonly nodeArea: Float32Array; // of each node: the sum of `area` over its triangles

  constructor(rest: Float32Array, private readonly triangles: Uint32Array) {
    const count = triangles.length / 3;
    this.inverse = new Float32Array(3 * count);
    this.area = new Float32Array(count);
    this.nodeArea = new Float32Array(rest.length / 3);
    for (let t = 0; t < count; t++) {
      const a = 3 * triangles[3 * t], b = 3 * triangles[3 * t + 1], c = 3 * triangles[3 * t + 2];
      const ex = rest[b] - rest[a], ey = rest[b + 1] - rest[a + 1], ez = rest[b + 2] - rest[a + 2];
      const fx = rest[c] - rest[a], fy = rest[c + 1] - rest[a + 1], fz = rest[c + 2] - rest[a + 2];
      // Axes in the plane: along e and normal to it; e = (p, 0), f = (q, r).
      const p = Math.sqrt(ex * ex + ey * ey + ez * ez), q = (ex * fx + ey * fy + ez * fz) / p;
      const r = Math.sqrt(Math.max(fx * fx + fy * fy + fz * fz - q * q, 0));
      if (!(p * r > 1e-12)) continue; // degenerate at rest
      this.inverse.set([1 / p, -q / (p * r), 1 / r], 3 * t);
      this.area[t] = p * r;
      for (const node of [a, b, c]) this.nodeArea[node / 3] += p * r;
    }
  }

  /** Writes the largest principal stretch minus 1 of each node and returns the largest of all. */
  at(positions: Float32Array, out: Float32Array): number {
    const { triangles, inverse, area, nodeArea } = this;
    out.fill(0);
    for (let t = 0; t < area.length; t++) {
      const a = 3 * triangles[3 * t], b = 3 * triangles[3 * t + 1], c = 3 * triangles[3 * t + 2];
      const ex = positions[b] - positions[a], ey = positions[b + 1] - positions[a + 1], ez = positions[b + 2] - positions[a + 2];
      const fx = positions[c] - positions[a], fy = positions[c + 1] - positions[a + 1], fz = positions[c + 2] - positions[a + 2];
      const i = inverse[3 * t], j = inverse[3 * t + 1], k = inverse[3 * t + 2];
      // Columns of F: i e, and j e + k f.
      const gx = j * ex + k * fx, gy = j * ey + k * fy, gz = j * ez + k * fz;
      const uu = i * i * (ex * ex + ey * ey + ez * ez), uv = i * (ex * gx + ey * gy + ez * gz), vv = gx * gx + gy * gy + gz * gz;
      const half = 0.5 * (uu - vv);
      const stretch = Math.sqrt(0.5 * (uu + vv) + Math.sqrt(half * half + uv * uv)) - 1;
      const part = area[t] * stretch;
      out[a / 3] += part; out[b / 3] += part; out[c / 3] += part;
    }
    let largest = 0;
    for (let n = 0; n < out.length; n++) {
      out[n] = nodeArea[n] ? out[n] / nodeArea[n] : 0;
      if (out[n] > largest) largest = out[n];
    }
    return largest;
  }
}
