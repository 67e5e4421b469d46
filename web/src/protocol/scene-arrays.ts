// The organ of a `Scene` message: its header, and the arrays that follow.
import type { Scene } from "./server-messages";

export interface SceneArrays {
  scene: Scene;
  rest: Float32Array<ArrayBuffer>; // (nodes, 3) mm
  open: Float32Array<ArrayBuffer>; // where tension has opened the cuts
  triangles: Uint32Array<ArrayBuffer>;
  beside: Uint32Array<ArrayBuffer> | null; // (nodes) to which of several organs each belongs
  pieces?: PieceArrays[];
}

/** A piece that a cut has freed. open: its vertices as it came free, mm. */
export interface PieceArrays {
  rest: Float32Array<ArrayBuffer>;
  open: Float32Array<ArrayBuffer>;
  triangles: Uint32Array<ArrayBuffer>;
  lips: number[];
}

export function readScene(data: ArrayBuffer): SceneArrays {
  const header = new DataView(data).getUint32(0, true);
  const scene = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, header))) as Scene;
  const rest = new Float32Array(data.slice(4 + header, 4 + header + 12 * scene.nodes));
  const arrays = scene.gapes ? 2 : 1, open = rest.slice();
  if (scene.gapes) new Float32Array(data.slice(4 + header + 12 * scene.nodes, 4 + header + 24 * scene.nodes)).forEach((x, i) => (open[i] += x));
  const at = 4 + header + 12 * arrays * scene.nodes, end = at + 12 * scene.triangles;
  const triangles = new Uint32Array(data.slice(at, end)), after = end + 4 * (scene.beside.length && scene.nodes);
  const beside = scene.beside.length ? new Uint32Array(data.slice(end, after)) : null;
  return { scene, rest, open, triangles, beside, pieces: readPieces(scene, data, after) };
}

function readPieces(scene: Scene, data: ArrayBuffer, from: number): PieceArrays[] {
  let at = from;
  const next = (bytes: number): ArrayBuffer => data.slice(at, (at += bytes));
  return scene.pieces.map(({ nodes, triangles, lips }) => ({
    rest: new Float32Array(next(12 * nodes)), open: new Float32Array(next(12 * nodes)), triangles: new Uint32Array(next(12 * triangles)), lips,
  }));
}
