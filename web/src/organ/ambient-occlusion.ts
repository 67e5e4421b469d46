// How much of the sky each node of the outer surface sees at rest. It is computed in the worker, not in Python: so nothing more
// travels, and a page that holds everything needs no server for it. A closed form takes a fraction of the time of rays.
import { normals } from "./mesh-geometry";

const MOST_PAIRS = 1.2e7; // node and disc, each pass: about 0.1 s

/** 0 (buried) to 255 (open) of each node. Of the outer surface alone, so that it does not tell what is inside.
 *
 * Each node stands for a disc. Its part of the cosine-weighted hemisphere over another node is A cos cos / (pi r^2 + A)
 * (Wallace, Elmquist & Haines, SIGGRAPH 1989). Discs that are hidden themselves count less in a second pass (Bunnell, GPU
 * Gems 2, chapter 14, 2005). */
export function openness(rest: Float32Array, surface: Uint32Array): Uint8Array<ArrayBuffer> {
  const count = rest.length / 3, area = new Float32Array(rest.length), open = new Float32Array(count).fill(1);
  normals(rest, surface, area); // of twice the size of three discs
  const nodes = [...new Set(surface)];
  const stride = Math.max(1, Math.ceil((nodes.length * nodes.length) / MOST_PAIRS));
  const discs = nodes.filter((_, i) => i % stride === 0);
  for (let pass = 0; pass < 2; pass++) {
    const before = open.slice();
    for (const a of nodes) open[a] = 1 - Math.min(1, hidden(a, discs, stride, rest, area, before));
  }
  return Uint8Array.from(open, (x) => Math.round(255 * x));
}

function hidden(a: number, discs: number[], stride: number, rest: Float32Array, area: Float32Array, open: Float32Array): number {
  const x = rest[3 * a], y = rest[3 * a + 1], z = rest[3 * a + 2];
  const nx = area[3 * a], ny = area[3 * a + 1], nz = area[3 * a + 2], size = Math.sqrt(nx * nx + ny * ny + nz * nz) || 1;
  let sum = 0;
  for (const b of discs) {
    const dx = rest[3 * b] - x, dy = rest[3 * b + 1] - y, dz = rest[3 * b + 2] - z;
    const above = nx * dx + ny * dy + nz * dz; // r cos, here
    if (above <= 0) continue;
    const ex = area[3 * b], ey = area[3 * b + 1], ez = area[3 * b + 2];
    const facing = -(ex * dx + ey * dy + ez * dz); // r cos of the disc, times six discs of this node
    if (facing <= 0) continue;
    const square = dx * dx + dy * dy + dz * dz, disc = (stride * Math.sqrt(ex * ex + ey * ey + ez * ez)) / 6;
    sum += (((open[b] * above) / size) * facing * stride) / 6 / (square * (Math.PI * square + disc));
  }
  return sum;
}
