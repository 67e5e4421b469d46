// Noise in space, for the grain of tissue: read at the rest position, it moves with the tissue and has no seams.
import { Data3DTexture, LinearFilter, RedFormat, RepeatWrapping } from "three";

const SIDE = 32; // texels
/** Periods of the noise within the texture, which repeats itself. */
export const CELLS = 8;

const hash = (x: number, y: number, z: number, cells: number): number => {
  let h = Math.imul(x % cells, 374761393) ^ Math.imul(y % cells, 668265263) ^ Math.imul(z % cells, 2147483647) ^ cells;
  h = Math.imul(h ^ (h >>> 13), 1274126177);
  h = Math.imul(h ^ (h >>> 16), 668265263);
  return ((h ^ (h >>> 15)) >>> 0) / 4294967296;
};
const smooth = (x: number): number => x * x * x * (x * (6 * x - 15) + 10); // Perlin 2002: no creases between the cells

/** Value noise, 0..1; x, y, z in cells. */
function noise(x: number, y: number, z: number, cells: number): number {
  const [i, j, k] = [x, y, z].map(Math.floor), [u, v, w] = [x - i, y - j, z - k].map(smooth);
  const mix = (a: number, b: number, t: number) => a + t * (b - a);
  const along = (dj: number, dk: number) => mix(hash(i, j + dj, k + dk, cells), hash(i + 1, j + dj, k + dk, cells), u);
  return mix(mix(along(0, 0), along(1, 0), v), mix(along(0, 1), along(1, 1), v), w);
}

let made: Data3DTexture | null = null;

/** Two octaves; the same for every view and at every start. */
export function noiseTexture(): Data3DTexture {
  if (made) return made;
  const data = new Uint8Array(SIDE ** 3);
  for (let z = 0, n = 0; z < SIDE; z++)
    for (let y = 0; y < SIDE; y++)
      for (let x = 0; x < SIDE; x++) {
        const at = [x, y, z].map((c) => (CELLS * c) / SIDE) as [number, number, number];
        const fine = at.map((c) => 2 * c) as [number, number, number];
        data[n++] = 255 * (0.7 * noise(...at, CELLS) + 0.3 * noise(...fine, 2 * CELLS));
      }
  made = new Data3DTexture(data, SIDE, SIDE, SIDE);
  made.format = RedFormat;
  made.wrapS = made.wrapT = made.wrapR = RepeatWrapping;
  made.minFilter = made.magFilter = LinearFilter;
  made.unpackAlignment = 1;
  made.needsUpdate = true;
  return made;
}
