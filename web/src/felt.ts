// What the tool has felt so far: force over depth, N/mm, at each node it pressed, NaN elsewhere.
import { length, slot } from "./geometry";
import type { Organ } from "./link";
import type { Frame } from "./messages";

export class Felt {
  readonly stiffness: Float32Array;
  private readonly weight: Float32Array;

  constructor(private readonly organ: Organ) {
    this.stiffness = new Float32Array(organ.scene.nodes).fill(NaN);
    this.weight = new Float32Array(organ.scene.nodes);
  }

  /** Takes one frame of the first tool in: a node near the contact's middle believes it more. */
  add(frame: Frame): void {
    const depth = length(slot(frame.displacement, 0));
    if (frame.grip[0] !== 1 || depth < 0.5) return;
    const here = length(slot(frame.force, 0)) / depth;
    const [x, y, z] = slot(frame.point, 0);
    const { rest, scene } = this.organ;
    const reach = 0.6 * scene.radius;
    for (let i = 0; i < scene.nodes; i++) {
      const dx = rest[3 * i] - x, dy = rest[3 * i + 1] - y, dz = rest[3 * i + 2] - z;
      const far = Math.sqrt(dx * dx + dy * dy + dz * dz);
      if (far > reach) continue;
      const believe = (1 - far / reach) ** 2;
      const old = this.weight[i];
      this.stiffness[i] = old ? (old * this.stiffness[i] + believe * here) / (old + believe) : here;
      this.weight[i] = Math.min(old + believe, 4);
    }
  }

  /** The lowest and the highest, or null if nothing was felt. */
  get range(): [number, number] | null {
    let low = Infinity, high = -Infinity;
    for (const s of this.stiffness) {
      if (s < low) low = s;
      if (s > high) high = s;
    }
    return low <= high ? [low, high] : null;
  }
}
