// What page and worker hand each other.
import type { Colouring } from "./colour";
import type { Choose, Difference, Frame, Mark, Scene, Tool } from "./messages";

/** The scene's arrays: nodes at rest (mm), triangles, unit normals at rest, and the skin's edges as pairs of nodes. */
export interface Organ {
  scene: Scene;
  rest: Float32Array<ArrayBuffer>;
  triangles: Uint32Array<ArrayBuffer>;
  normals: Float32Array<ArrayBuffer>;
  edges: Uint32Array<ArrayBuffer>;
}

/** Arrays that travel between page and worker without a copy, of every shown node: positions (mm), normals (x, y, z and
 * a blank, 32767 is 1), colours (linear red, green, blue and a blank, 255 is 1). */
export interface Shape {
  positions: Float32Array<ArrayBuffer>;
  normals: Int16Array<ArrayBuffer>;
  colours: Uint8Array<ArrayBuffer>;
}

export const buffers = ({ positions, normals, colours }: Shape): ArrayBuffer[] => [positions.buffer, normals.buffer, colours.buffer];

/** The ends of a colour scale; null where there is nothing to show. */
export type Scale = [low: number, high: number] | null;

export type FromWorker =
  | { kind: "organ"; organ: Organ }
  | { kind: "frame"; frame: Frame; shape: Shape | null; scale: Scale; work: number }
  | { kind: "difference"; difference: Difference }
  | { kind: "status"; good: boolean; text: string };

export type ToWorker =
  | { kind: "open"; scene: string; socket: string }
  | { kind: "say"; tool: Tool }
  | { kind: "choose"; choose: Choose }
  | { kind: "mark"; mark: Mark }
  | { kind: "colour"; colouring: Colouring }
  | { kind: "back"; shape: Shape }
  | { kind: "next"; shape: Shape | null; pressing: boolean };
