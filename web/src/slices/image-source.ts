// The values of a volume or a scan, their geometry, and how they are fetched.
import type { Image, Stack, Vector } from "../protocol/server-messages";

export type Values = Int16Array<ArrayBuffer> | Uint16Array<ArrayBuffer> | Float32Array<ArrayBuffer>;
/** (z, y, x), fractional or not. */
export type Index = [number, number, number];

const KINDS = { int16: Int16Array, uint16: Uint16Array, float32: Float32Array } as const;

export class ImageSource {
  readonly shape: Index;
  readonly spacing: Index;

  constructor(readonly image: Image, readonly stack: Stack, readonly values: Values) {
    this.shape = image.shape as Index;
    this.spacing = image.spacing as Index;
  }

  /** Position of an index, mm: origin + direction · (spacing · index). */
  point([z, y, x]: Index): Vector {
    const { origin, direction: d } = this.image;
    const step = [x * this.spacing[2], y * this.spacing[1], z * this.spacing[0]];
    return [0, 1, 2].map((i) => origin[i] + d[3 * i] * step[0] + d[3 * i + 1] * step[1] + d[3 * i + 2] * step[2]) as Vector;
  }

  /** Fractional index of a position: the inverse of `point`. */
  index(point: Vector): Index {
    const { origin, direction: d } = this.image;
    const far = point.map((p, i) => p - origin[i]);
    const step = [0, 1, 2].map((i) => d[i] * far[0] + d[3 + i] * far[1] + d[6 + i] * far[2]);
    return [step[2] / this.spacing[0], step[1] / this.spacing[1], step[0] / this.spacing[2]];
  }

  /** The index in the array of the file, which may be finer or have other axes. */
  fileIndex(index: Index): Index {
    const { file } = this.image;
    return [0, 1, 2].map((i) => Math.round(index.reduce((sum, v, a) => sum + file[4 * i + a] * v, file[4 * i + 3]))) as Index;
  }

  /** The nearest voxel of the array. */
  nearest(index: Index): Index {
    return index.map((i, a) => Math.max(0, Math.min(this.shape[a] - 1, Math.round(i)))) as Index;
  }

  /** Is the index inside the array? */
  contains(index: Index): boolean {
    return index.every((i, a) => i >= -0.5 && i <= this.shape[a] - 0.5);
  }

  /** The value of the voxel that holds the position; NaN outside. */
  at(index: Index): number {
    if (!this.contains(index)) return NaN;
    const [z, y, x] = this.nearest(index);
    return this.values[(z * this.shape[1] + y) * this.shape[2] + x];
  }

  /** Trilinear interpolation, constant beyond the outermost voxel centers; NaN outside. */
  interpolate(index: Index): number {
    if (!this.contains(index)) return NaN;
    const held = index.map((i, a) => Math.max(0, Math.min(this.shape[a] - 1, i)));
    const low = held.map((i, a) => Math.max(0, Math.min(this.shape[a] - 2, Math.floor(i))));
    let sum = 0;
    for (let corner = 0; corner < 8; corner++) {
      let weight = 1, at = 0;
      for (let a = 0; a < 3; a++) {
        const up = (corner >> a) & 1;
        weight *= up ? held[a] - low[a] : 1 - held[a] + low[a];
        at = at * this.shape[a] + Math.min(low[a] + up, this.shape[a] - 1);
      }
      if (weight) sum += weight * this.values[at];
    }
    return sum;
  }
}

/** The values of one stack, of bytes. */
export const asValues = (bytes: ArrayBuffer, stack: Stack): Values => new KINDS[stack.kind as keyof typeof KINDS](bytes);

/** Fetches one stack of values. onProgress: called with the fraction received. Throws an error with a text for the user. */
export async function fetchValues(url: string, image: Image, stack: Stack, onProgress: (share: number) => void): Promise<Values> {
  const Kind = KINDS[stack.kind as keyof typeof KINDS];
  const bytes = new Uint8Array(image.shape.reduce((a, b) => a * b) * Kind.BYTES_PER_ELEMENT);
  const answer = await fetch(url);
  if (!answer.ok || !answer.body) throw new Error(await answer.text());
  const reader = answer.body.getReader();
  let at = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    if (at + value.length > bytes.length) throw new Error("the server sent more values than the image has; reload the page");
    bytes.set(value, at);
    onProgress((at += value.length) / bytes.length);
  }
  if (at < bytes.length) throw new Error("the transfer of the values was interrupted; reload the page");
  return asValues(bytes.buffer, stack);
}
