// The worker that makes the bodies of a session's cuts, so that the session goes on meanwhile.
import type { FromBodyWorker, ToBodyWorker } from "../protocol/body-messages";
import { CutRefused, TouchEngine } from "./touch-engine";

/** Makes the bodies that a session asks for by this port, and nothing else. end: ends the worker. */
export function makeBodies(port: MessagePort, end: () => void): void {
  let engine: Promise<TouchEngine>;
  const post = (message: FromBodyWorker, transfer: Transferable[] = []) => port.postMessage(message, transfer);
  const take = async (module: ArrayBuffer, solid: Uint8Array) => {
    const loaded = await TouchEngine.load(module);
    loaded.take(solid);
    return loaded;
  };
  const build = async (cuts: Float64Array[]) => {
    try {
      const arrays = (await engine).build(cuts);
      post({ kind: "arrays", arrays }, arrays.map(({ buffer }) => buffer));
    } catch (problem) {
      if (problem instanceof CutRefused) return post({ kind: "refused", text: problem.message });
      post({ kind: "failed", text: `The cut body cannot be made, perhaps for want of memory (${String(problem)}).` });
      end(); // what an engine that has stopped midway holds is of no use
    }
  };
  port.onmessage = ({ data }: MessageEvent<ToBodyWorker>) => {
    if (data.kind === "take") engine = take(data.module, data.solid);
    else void build(data.cuts);
  };
}
