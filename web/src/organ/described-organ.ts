// What is drawn of an organ, and of a loose piece, besides the triangles that a scene brings.
import { openness } from "./ambient-occlusion";
import { ColorMap } from "./color-map";
import { borderEdges, normalize, normals, packNormals, uniqueEdges } from "./mesh-geometry";
import type { PieceArrays, SceneArrays } from "../protocol/scene-arrays";
import type { Scene } from "../protocol/server-messages";
import type { NodeArrays, Organ, Piece } from "../protocol/worker-messages";

const outerPart = (scene: Scene) => scene.parts.find((part) => !part.inside) ?? scene.parts[0];

/** The triangles of the outer surface. */
export function outerSurface(scene: Scene, triangles: Uint32Array<ArrayBuffer>): Uint32Array<ArrayBuffer> {
  const { first, count } = outerPart(scene);
  return triangles.subarray(3 * first, 3 * (first + count));
}

/** An organ with what is drawn of it besides its triangles. */
export function described({ scene, rest, open, triangles, beside }: SceneArrays): Organ {
  const { first, count } = outerPart(scene), surface = outerSurface(scene, triangles), unitNormals = new Float32Array(rest.length);
  // Of the outer surface only: nodes of the inner regions that are not on it keep a zero normal.
  normals(rest, surface, unitNormals);
  normalize(unitNormals);
  const edges = uniqueEdges(triangles, first, count);
  return { scene, rest, open, triangles, beside, normals: unitNormals, edges, rims: borderEdges(surface, scene.lips[0]), openness: openness(rest, surface), pieces: [] };
}

/** A piece that a cut has freed: rigid, so that nothing of it is computed again. */
export function looseOrgan(scene: Scene, { rest, open, triangles, lips }: PieceArrays): Piece {
  const nodes = rest.length / 3, count = triangles.length / 3, parts = [{ name: "piece", first: 0, count, inside: false }];
  const made = described({ scene: { ...scene, nodes, triangles: count, parts, lips, beside: [], gapes: false }, rest, open, triangles, beside: null });
  const arrays = allocate(nodes), sums = new Float32Array(rest.length);
  arrays.positions.set(open);
  normals(open, triangles, sums);
  packNormals(sums, arrays.normals);
  new ColorMap(made, triangles, {}).apply(open, scene.model, arrays.colors);
  return { organ: made, arrays };
}

/** Room for what a frame changes of each vertex. */
export const allocate = (nodes: number): NodeArrays => ({
  positions: new Float32Array(3 * nodes),
  normals: new Int16Array(4 * nodes),
  colors: new Uint8Array(4 * nodes),
});
