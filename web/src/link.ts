// What page and worker hand each other.
import type { Frame, Scene, Tool } from "./messages";

/** The scene's arrays: nodes at rest (mm), triangles, and each node's unit normal at rest. */
export interface Organ {
  scene: Scene;
  rest: Float32Array<ArrayBuffer>;
  triangles: Uint32Array<ArrayBuffer>;
  normals: Float32Array<ArrayBuffer>;
}

/** Arrays that travel between page and worker without a copy: positions (mm) and normals of every shown node. */
export interface Shape {
  positions: Float32Array<ArrayBuffer>;
  normals: Float32Array<ArrayBuffer>;
}

export type FromWorker =
  | { kind: "organ"; organ: Organ }
  | { kind: "frame"; frame: Frame; shape: Shape; delay: number }
  | { kind: "status"; good: boolean; text: string };

export type ToWorker =
  | { kind: "open"; scene: string; socket: string }
  | { kind: "tool"; tool: Tool }
  | { kind: "next"; shape: Shape | null };
