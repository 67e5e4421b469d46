// Colours of nodes: by displacement, or by the stiffness that was felt where the tool has pressed.
import type { Organ } from "./link";
import type { Frame, Vector } from "./messages";
import { length } from "./geometry";

export type Colouring = "plain" | "moved" | "felt";

// Steps of viridis (Smith & van der Walt 2015), from low to high: also readable in grey and by the colour-blind.
const RAMP: Vector[] = [
  [0.192, 0.408, 0.557],
  [0.129, 0.569, 0.549],
  [0.369, 0.788, 0.384],
  [0.992, 0.906, 0.145],
];

/** Colour of a value in 0..1, linear light as the renderer wants it. */
function ramp(value: number, out: Float32Array, i: number): void {
  const x = Math.max(0, Math.min(1, value)) * (RAMP.length - 1);
  const low = Math.min(Math.floor(x), RAMP.length - 2);
  for (let k = 0; k < 3; k++) {
    const c = RAMP[low][k] + (x - low) * (RAMP[low + 1][k] - RAMP[low][k]);
    out[i + k] = c ** 2.2;
  }
}

/** What the tool has felt so far: N/mm at each node it pressed, NaN elsewhere. */
export class Felt {
  private stiffness: Float32Array;
  private weight: Float32Array;

  constructor(private readonly organ: Organ) {
    this.stiffness = new Float32Array(organ.scene.nodes).fill(NaN);
    this.weight = new Float32Array(organ.scene.nodes);
  }

  /** Takes one frame in: a node near the contact's middle believes it more. */
  add(frame: Frame): void {
    const depth = length(frame.displacement);
    if (frame.grip !== 1 || depth < 0.5) return;
    const here = length(frame.force) / depth;
    const { rest, scene } = this.organ;
    const reach = 0.6 * scene.radius;
    for (let i = 0; i < scene.nodes; i++) {
      const far = Math.hypot(rest[3 * i] - frame.point[0], rest[3 * i + 1] - frame.point[1], rest[3 * i + 2] - frame.point[2]);
      if (far > reach) continue;
      const believe = (1 - far / reach) ** 2;
      const old = this.weight[i];
      this.stiffness[i] = old ? (old * this.stiffness[i] + believe * here) / (old + believe) : here;
      this.weight[i] = Math.min(old + believe, 4);
    }
  }

  /** Colours of all nodes; gives the lowest and highest stiffness, or null if nothing was felt. */
  colours(bare: Vector, out: Float32Array): [number, number] | null {
    let low = Infinity, high = -Infinity;
    for (const s of this.stiffness) if (s === s) (low = Math.min(low, s)), (high = Math.max(high, s));
    for (let i = 0; i < this.stiffness.length; i++) {
      if (this.weight[i]) ramp(high > low ? (this.stiffness[i] - low) / (high - low) : 0, out, 3 * i);
      else out.set(bare, 3 * i);
    }
    return low <= high ? [low, high] : null;
  }
}

/** Colours of all nodes by displacement; gives the biggest, mm. */
export function moved(rest: Float32Array, positions: Float32Array, bare: Vector, out: Float32Array): number {
  let most = 0;
  for (let i = 0; i < rest.length; i += 3)
    most = Math.max(most, Math.hypot(positions[i] - rest[i], positions[i + 1] - rest[i + 1], positions[i + 2] - rest[i + 2]));
  for (let i = 0; i < rest.length; i += 3) {
    const here = Math.hypot(positions[i] - rest[i], positions[i + 1] - rest[i + 1], positions[i + 2] - rest[i + 2]);
    if (most < 1e-3) out.set(bare, i);
    else ramp(here / most, out, i);
  }
  return most;
}
