// The coupling between a guiding tool and a guided one: a line from one to the other, in the color of who guides.
import { CylinderGeometry, Mesh, MeshBasicMaterial, Vector3 } from "three";
import { length, subtract } from "../organ/mesh-geometry";
import type { Vector } from "../protocol/server-messages";

const UP = new Vector3(0, 1, 0);

export class GuidanceLine {
  // In front of the organ, since it may lead through it.
  readonly mesh = new Mesh(new CylinderGeometry(1, 1, 1, 8), new MeshBasicMaterial({ depthTest: false, transparent: true, opacity: 0.75 }));

  constructor() {
    this.mesh.visible = false;
    this.mesh.renderOrder = 2;
  }

  /** Between two places, mm; null: there is none. size: mm, radius of the organ. Returns whether it has changed. */
  show(ends: [Vector, Vector] | null, color: number, size: number): boolean {
    const { mesh } = this, was = mesh.visible;
    mesh.visible = ends !== null;
    if (!ends) return was;
    const [from, to] = ends.map((end) => new Vector3(...end)), way = to.clone().sub(from), far = length(subtract(...ends));
    mesh.material.color.setHex(color);
    mesh.position.copy(from).addScaledVector(way, 0.5);
    mesh.scale.set(0.008 * size, Math.max(far, 1e-6), 0.008 * size);
    if (far > 0) mesh.quaternion.setFromUnitVectors(UP, way.normalize());
    return true;
  }
}
