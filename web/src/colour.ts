// Colours of nodes: plain, by displacement, by the surface's strain, by the stiffness that was felt, or by how far they
// are from where finite elements have them.
import { Felt } from "./felt";
import type { Organ, Scale } from "./link";
import type { Frame } from "./messages";
import { Strain } from "./strain";

export type Colouring = "plain" | "moved" | "strain" | "felt" | "error";
export const UNITS: Record<Colouring, string> = { plain: "", moved: "mm", strain: "% stretch", felt: "N/mm", error: "mm" };

const FLESH = [143, 51, 43, 255]; // linear light
const NOTHING = { moved: 1e-3, strain: 1e-3 }; // mm, share: less is not shown
const SMALL = 0.01; // mm, where the scale of errors ends at least: what is less does not look like something

// Steps of viridis (Smith & van der Walt 2015), from low to high: also readable in grey and by the colour-blind.
const STEPS = [
  [0.192, 0.408, 0.557],
  [0.129, 0.569, 0.549],
  [0.369, 0.788, 0.384],
  [0.992, 0.906, 0.145],
];
const RAMP = new Uint8Array(256 * 4);
for (let i = 0; i < 256; i++) {
  const x = (i / 255) * (STEPS.length - 1), low = Math.min(Math.floor(x), STEPS.length - 2);
  const mixed = STEPS[low].map((c, k) => Math.round(255 * (c + (x - low) * (STEPS[low + 1][k] - c)) ** 2.2));
  RAMP.set([...mixed, 255], 4 * i); // linear light, as the renderer wants it
}

/** Paints an organ. */
export class Painter {
  colouring: Colouring = "plain";
  error: { values: Float32Array; most: number } | null = null; // mm, of each node, the newest; null: not known
  private readonly felt: Felt;
  private readonly values: Float32Array;
  private strain: Strain | null = null; // made when first asked for

  constructor(private readonly organ: Organ, private readonly skin: Uint32Array) {
    this.felt = new Felt(organ);
    this.values = new Float32Array(organ.scene.nodes);
  }

  /** The first tool presses: what it feels is kept. */
  feel(frame: Frame): void {
    this.felt.add(frame);
  }

  /** Colours of all nodes of a shape; gives the ends of the scale. */
  paint(positions: Float32Array, out: Uint8Array<ArrayBuffer>): Scale {
    const { colouring, values } = this;
    if (colouring === "felt") {
      const range = this.felt.range;
      fill(this.felt.stiffness, ...(range ?? [0, 1]), out);
      return range;
    }
    if (colouring === "error" && this.error) {
      const most = Math.max(this.error.most, SMALL);
      fill(this.error.values, 0, most, out);
      return [0, most];
    }
    if (colouring === "plain" || colouring === "error") return bare(out);
    let most: number;
    if (colouring === "moved") most = moved(this.organ.rest, positions, values);
    else most = (this.strain ??= new Strain(this.organ.rest, this.skin)).at(positions, values);
    if (most < NOTHING[colouring]) return bare(out);
    fill(values, 0, most, out);
    return [0, colouring === "strain" ? 100 * most : most];
  }
}

const BARE = new Uint32Array(Uint8Array.from(FLESH).buffer)[0];
const LADDER = new Uint32Array(RAMP.buffer);

function bare(out: Uint8Array<ArrayBuffer>): null {
  new Uint32Array(out.buffer).fill(BARE);
  return null;
}

/** Values from low to high along the ramp; NaN stays bare. */
function fill(values: Float32Array, low: number, high: number, out: Uint8Array<ArrayBuffer>): void {
  const gain = high > low ? 255 / (high - low) : 0, colours = new Uint32Array(out.buffer);
  for (let i = 0; i < values.length; i++) {
    const value = values[i];
    colours[i] = value === value ? LADDER[Math.max(0, Math.min(255, Math.round((value - low) * gain)))] : BARE;
  }
}

/** Displacement of all nodes, mm; gives the biggest. */
function moved(rest: Float32Array, positions: Float32Array, out: Float32Array): number {
  let most = 0;
  for (let i = 0, j = 0; i < out.length; i++, j += 3) {
    const x = positions[j] - rest[j], y = positions[j + 1] - rest[j + 1], z = positions[j + 2] - rest[j + 2];
    const far = Math.sqrt(x * x + y * y + z * z);
    out[i] = far;
    if (far > most) most = far;
  }
  return most;
}
