// Messages between a session in the page and the worker that makes its cut bodies.

/** take: the engine's module and the organ, before anything else. build: the body with these cuts, by their blades, (triangles, 3, 3) mm. */
export type ToBodyWorker = { kind: "take"; module: ArrayBuffer; solid: Uint8Array } | { kind: "build"; cuts: Float64Array[] };

/** arrays: of the body, as the engine takes them. refused: why the cut cannot be made. failed: the worker has ended. */
export type FromBodyWorker = { kind: "arrays"; arrays: Uint8Array<ArrayBuffer>[] } | { kind: "refused" | "failed"; text: string };
