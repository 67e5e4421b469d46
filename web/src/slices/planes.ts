// The three orthogonal planes through a volume, and slabs of them.
import type { Image } from "../protocol/server-messages";
import type { Index, ImageSource } from "./image-source";

export type PlaneName = "axial" | "coronal" | "sagittal";
export type SlabMode = "mean" | "max";

/** Axes are numbered (z, y, x). cut: normal to the plane; down, across: along the screen. up: `down` is drawn upwards. */
export interface Plane {
  name: PlaneName;
  cut: number;
  down: number;
  across: number;
  up: boolean;
}

// Radiological convention: the patient's right on the left, anterior or superior at the top.
export const PLANES: Record<PlaneName, Plane> = {
  axial: { name: "axial", cut: 0, down: 1, across: 2, up: false },
  coronal: { name: "coronal", cut: 1, down: 0, across: 2, up: true },
  sagittal: { name: "sagittal", cut: 2, down: 0, across: 1, up: true },
};
export const NAMES = Object.keys(PLANES) as PlaneName[];

const PATIENT = [["I", "S"], ["A", "P"], ["R", "L"]]; // lowest and highest end of z, y, x
const WORLD = [["−z", "+z"], ["−y", "+y"], ["−x", "+x"]];

/** Orientation labels at the left, right, top and bottom of the picture. */
export function orientationLabels(image: Image, plane: Plane): [string, string, string, string] {
  if (image.scan) return ["", "", "", ""];
  const ends = image.patient ? PATIENT : WORLD;
  const [top, bottom] = plane.up ? [ends[plane.down][1], ends[plane.down][0]] : ends[plane.down];
  return [ends[plane.across][0], ends[plane.across][1], top, bottom];
}

/** Name of a plane: anatomical if the patient's axes are known, otherwise by its normal. */
export function title(image: Image, plane: Plane): string {
  if (image.scan) return "Projection";
  return image.patient ? plane.name[0].toUpperCase() + plane.name.slice(1) : `${"zyx"[plane.cut]} plane`;
}

/** First and last slice of a slab about `mm` thick: an odd number of slices, with slice k in the middle. */
export function slab(source: ImageSource, cut: number, k: number, mm: number): [number, number] {
  const half = Math.floor(mm / 2 / source.spacing[cut] + 1e-6);
  return [Math.max(0, k - half), Math.min(source.shape[cut] - 1, k + half)];
}

/** Values (rows, columns) of slices first..last of a plane, their mean or their maximum; rows by growing index. */
export function extract(source: ImageSource, plane: Plane, first: number, last: number, mode: SlabMode): Float32Array<ArrayBuffer> {
  const { shape, values } = source;
  const strides: Index = [shape[1] * shape[2], shape[2], 1];
  const [rows, columns, count] = [shape[plane.down], shape[plane.across], last - first + 1];
  const [down, across, cut] = [strides[plane.down], strides[plane.across], strides[plane.cut]];
  const out = new Float32Array(rows * columns);
  const most = mode === "max";
  // The axis that lies closest in memory is the innermost loop.
  if (plane.cut === 2)
    for (let i = 0, at = 0; i < rows; i++)
      for (let j = 0; j < columns; j++, at++) {
        const start = i * down + j * across + first;
        let sum = values[start];
        for (let k = 1; k < count; k++) sum = most ? Math.max(sum, values[start + k]) : sum + values[start + k];
        out[at] = most ? sum : sum / count;
      }
  else
    for (let k = 0; k < count; k++)
      for (let i = 0, at = 0; i < rows; i++) {
        const start = (first + k) * cut + i * down;
        for (let j = 0; j < columns; j++, at++) {
          const value = values[start + j];
          if (k === 0) out[at] = value;
          else if (most) out[at] = Math.max(out[at], value);
          else out[at] += value;
        }
      }
  if (plane.cut !== 2 && !most && count > 1) for (let at = 0; at < out.length; at++) out[at] /= count;
  return out;
}
