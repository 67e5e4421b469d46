// What the tissue material needs to know of each node and what no frame changes: rest position, color, wetness, openness, blood.
import { BufferAttribute, type BufferGeometry } from "three";
import type { Organ } from "../protocol/worker-messages";
import { kindsOf } from "./tissue-kinds";

const STAIN = 0.05; // of the organ's radius: so far from a cut blood lies on the surface

/** size: mm, radius of the organ. */
export function setSurfaceAttributes(geometry: BufferGeometry, organ: Organ, size: number): void {
  const nodes = organ.rest.length / 3, kinds = kindsOf(organ.scene).map(({ color, wet, grain }) => [...linear(color), 255 * grain, 255 * wet]);
  const base = new Uint8Array(4 * nodes), surface = new Uint8Array(4 * nodes), blood = stains(organ, STAIN * size);
  for (let i = 0; i < nodes; i++) {
    const [r, g, b, grain, wet] = kinds[organ.beside?.[i] ?? 0] ?? kinds[0];
    base.set([r, g, b, grain], 4 * i);
    surface.set([organ.openness[i], blood[i], wet, 255], 4 * i);
  }
  geometry.setAttribute("rest", new BufferAttribute(organ.rest, 3));
  geometry.setAttribute("base", new BufferAttribute(base, 4, true));
  geometry.setAttribute("surface", new BufferAttribute(surface, 4, true));
}

const linear = (color: number): number[] => [color >> 16, (color >> 8) & 255, color & 255].map((c) => 255 * (c / 255) ** 2.2);

/** 255 on the lips of cuts, falling to 0 within `reach` mm beside them. */
function stains({ rest, rims, scene }: Organ, reach: number): Uint8Array {
  const blood = new Uint8Array(rest.length / 3), near = [...new Set(rims)];
  if (!near.length) return blood;
  for (let i = 0; i < blood.length; i++) {
    let least = i >= scene.lips[0] ? 0 : Infinity;
    for (const rim of near) {
      if (least === 0) break;
      const square = (rest[3 * i] - rest[3 * rim]) ** 2 + (rest[3 * i + 1] - rest[3 * rim + 1]) ** 2 + (rest[3 * i + 2] - rest[3 * rim + 2]) ** 2;
      least = Math.min(least, square);
    }
    blood[i] = 255 * Math.max(0, 1 - Math.sqrt(least) / reach);
  }
  return blood;
}
