// Colors of nodes: plain, by displacement, by the surface's strain, by the stiffness that was measured, or by the distance
// from a finite element solution. A scale keeps its ends until the user changes them: moments can be compared.
import { StiffnessMap } from "./stiffness-map";
import type { ColorMode, Ends, Organ, Scale } from "../protocol/worker-messages";
import type { Frame } from "../protocol/server-messages";
import { SurfaceStrain } from "./surface-strain";

export const UNITS: Record<ColorMode, string> = { plain: "", displacement: "mm", strain: "% stretch", stiffness: "N/mm", error: "mm" };
/** Ends of each scale, in its unit, at first. That of the stiffness is what was measured. */
export const FIRST_ENDS: Readonly<Partial<Record<ColorMode, Ends>>> = { displacement: [0, 10], strain: [0, 10], error: [0, 1] };

/** Largest stretch, %, that a model means. Small strain differs there from Green and Lagrange's by 5 %. That of the
 * neo-Hookean law is a choice, not a measurement. Of other models nothing is known. */
const VALID_STRAIN: Record<string, number> = { springs: 10, blocks: 10, multigrid: 10, compliance: 10, "compliance-P1": 10, "neo-hookean": 50 };

const PLAIN_RGBA = [143, 51, 43, 255]; // linear light
const LIP_RGBA = [115, 9, 11, 255]; // linear light: fresh tissue on the lips of cuts
/** Of the regions inside, in their order. */
export const INNER_COLORS = [0x5a3fc0, 0x0a7f6a, 0xb8860b];
/** Of organs beside each other, in their order. */
export const ORGAN_COLORS = [0x9a4a3c, 0xb98a4e, 0x7d4a73, 0xc07a86, 0x8a8a4a, 0xcbbfa6, 0x5f7f8c, 0xa86a3a];
const BEYOND_RGBA = [255, 0, 110, 255]; // linear light: a pink that the scale does not hold

// Samples of viridis (Smith & van der Walt 2015), from low to high: readable in gray and by the color-blind.
export const VIRIDIS = [
  0x440154, 0x48186a, 0x472d7b, 0x424086, 0x3b528b, 0x33638d, 0x2c728e, 0x26828e, 0x21918c, 0x1fa088, 0x28ae80, 0x3fbc73,
  0x5ec962, 0x84d44b, 0xaddc30, 0xd8e219, 0xfde725,
].map((color) => [color >> 16, (color >> 8) & 255, color & 255]);
const VIRIDIS_RGBA = new Uint8Array(256 * 4);
for (let i = 0; i < 256; i++) {
  const x = (i / 255) * (VIRIDIS.length - 1), low = Math.min(Math.floor(x), VIRIDIS.length - 2);
  const rgb = VIRIDIS[low].map((c, k) => Math.round(255 * ((c + (x - low) * (VIRIDIS[low + 1][k] - c)) / 255) ** 2.2));
  VIRIDIS_RGBA.set([...rgb, 255], 4 * i); // linear light, as the renderer expects
}

/** Assigns a color to each node of an organ. */
export class ColorMap {
  mode: ColorMode = "plain";
  error: { values: Float32Array; largest: number } | null = null; // mm, of each node, the newest; null: unknown
  private readonly stiffness: StiffnessMap;
  private readonly values: Float32Array;
  private strain: SurfaceStrain | null = null; // made on first use

  /** surface: triangles of the outer surface. ends: of the scales, which the user may change. */
  constructor(
    private readonly organ: Organ, private readonly surface: Uint32Array, private readonly ends: Partial<Record<ColorMode, Ends>>,
  ) {
    this.stiffness = new StiffnessMap(organ);
    this.values = new Float32Array(organ.scene.nodes);
  }

  /** Adds the stiffness that the first tool measures in this frame. */
  addStiffness(frame: Frame): void {
    this.stiffness.add(frame);
  }

  /** Writes the colors of all nodes and returns the scale. model: the name of the one that moves them. */
  apply(positions: Float32Array, model: string, out: Uint8Array<ArrayBuffer>): Scale {
    const { mode } = this, found = this.evaluate(positions);
    if (!found) return fillPlain(out, this.organ);
    const { values, range } = found, unit = mode === "strain" ? 0.01 : 1; // strains are ratios, but shown in %
    const ends = this.ends[mode] ?? range, limit = mode === "strain" ? (VALID_STRAIN[model] ?? null) : null;
    mapColors(values, unit * ends[0], unit * ends[1], unit * (limit ?? Infinity), out);
    return { ends, range, limit };
  }

  /** The values of the nodes, and their range in the unit of the scale; null if there are none. */
  private evaluate(positions: Float32Array): { values: Float32Array; range: Ends } | null {
    const { mode, values, stiffness, error } = this;
    if (mode === "stiffness") return stiffness.range && { values: stiffness.values, range: stiffness.range };
    if (mode === "error") return error && { values: error.values, range: [0, error.largest] };
    if (mode === "displacement") return { values, range: [0, displacements(this.organ.open, positions, values)] };
    if (mode === "plain") return null;
    this.strain ??= new SurfaceStrain(this.organ.open, this.surface);
    return { values, range: [0, 100 * this.strain.at(positions, values)] };
  }
}

const PLAIN = new Uint32Array(Uint8Array.from(PLAIN_RGBA).buffer)[0];
const linear = (color: number): number[] => [color >> 16, (color >> 8) & 255, color & 255].map((c) => Math.round(255 * (c / 255) ** 2.2));
/** Of the lips of cuts: in the organ, then in the regions inside. */
const LIPS = [LIP_RGBA, ...INNER_COLORS.map((color) => [...linear(color), 255])].map((rgba) => new Uint32Array(Uint8Array.from(rgba).buffer)[0]);
const ORGANS = ORGAN_COLORS.map((color) => new Uint32Array(Uint8Array.from([...linear(color), 255]).buffer)[0]);
const BEYOND = new Uint32Array(Uint8Array.from(BEYOND_RGBA).buffer)[0];
const TABLE = new Uint32Array(VIRIDIS_RGBA.buffer);

function fillPlain(out: Uint8Array<ArrayBuffer>, { beside, scene: { lips } }: Organ): null {
  const colors = new Uint32Array(out.buffer);
  if (beside) beside.forEach((organ, i) => (colors[i] = ORGANS[organ % ORGANS.length]));
  else colors.fill(PLAIN);
  lips.forEach((first, i) => colors.fill(LIPS[i === 0 ? 0 : 1 + ((i - 1) % INNER_COLORS.length)], first));
  return null;
}

/** Maps values from low..high to colors; values beyond the limit get one that the scale does not hold, NaN the plain color. */
function mapColors(values: Float32Array, low: number, high: number, limit: number, out: Uint8Array<ArrayBuffer>): void {
  const gain = high > low ? 255 / (high - low) : 0, colors = new Uint32Array(out.buffer);
  for (let i = 0; i < values.length; i++) {
    const value = values[i];
    if (value > limit) colors[i] = BEYOND;
    else colors[i] = value === value ? TABLE[Math.max(0, Math.min(255, Math.round((value - low) * gain)))] : PLAIN;
  }
}

/** Writes the displacement of all nodes, mm, and returns the largest. */
function displacements(rest: Float32Array, positions: Float32Array, out: Float32Array): number {
  let largest = 0;
  for (let i = 0, j = 0; i < out.length; i++, j += 3) {
    const x = positions[j] - rest[j], y = positions[j + 1] - rest[j + 1], z = positions[j + 2] - rest[j + 2];
    const length = Math.sqrt(x * x + y * y + z * z);
    out[i] = length;
    if (length > largest) largest = length;
  }
  return largest;
}
