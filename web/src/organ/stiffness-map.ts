// Stiffness measured so far by pressing: force over depth, N/mm, at each node near a contact; NaN elsewhere.
import { length, toolVector } from "./mesh-geometry";
import type { Organ } from "../protocol/worker-messages";
import { ContactState, type Frame } from "../protocol/server-messages";

const MIN_DEPTH = 0.5; // mm
const MAX_WEIGHT = 4; // so that new measurements still count

export class StiffnessMap {
  readonly values: Float32Array;
  private readonly weight: Float32Array;

  constructor(private readonly organ: Organ) {
    this.values = new Float32Array(organ.scene.nodes).fill(NaN);
    this.weight = new Float32Array(organ.scene.nodes);
  }

  /** Adds the first tool's measurement: a weighted mean, with a weight that decreases with distance from the contact. */
  add(frame: Frame): void {
    const depth = length(toolVector(frame.displacement, 0));
    if (frame.contact[0] !== ContactState.closed || depth < MIN_DEPTH) return;
    const measured = length(toolVector(frame.force, 0)) / depth;
    const [x, y, z] = toolVector(frame.point, 0);
    const { rest, scene } = this.organ;
    const radius = 0.6 * scene.radius;
    for (let i = 0; i < scene.nodes; i++) {
      const dx = rest[3 * i] - x, dy = rest[3 * i + 1] - y, dz = rest[3 * i + 2] - z;
      const distance = Math.sqrt(dx * dx + dy * dy + dz * dz);
      if (distance > radius) continue;
      const weight = (1 - distance / radius) ** 2;
      const old = this.weight[i];
      this.values[i] = old ? (old * this.values[i] + weight * measured) / (old + weight) : measured;
      this.weight[i] = Math.min(old + weight, MAX_WEIGHT);
    }
  }

  /** The lowest and the highest value, or null if nothing was measured. */
  get range(): [number, number] | null {
    let low = Infinity, high = -Infinity;
    for (const s of this.values) {
      if (s < low) low = s;
      if (s > high) high = s;
    }
    return low <= high ? [low, high] : null;
  }
}
