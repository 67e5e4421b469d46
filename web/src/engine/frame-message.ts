// A frame of the page's own engine as the message that a server would send.
import { AT_REST, DISPLACEMENT_STEPS, FRAME_BYTES, encodeFrame, type Frame } from "../protocol/server-messages";

/** shown: displacements of the shown nodes, (nodes, 3) mm, which follow as integers of one step; at rest none do. */
export function frameMessage(state: Omit<Frame, "step" | "count">, shown: Float32Array): ArrayBuffer {
  let largest = 0;
  for (const x of shown) largest = Math.max(largest, Math.abs(x));
  const step = largest < AT_REST ? 0 : largest / DISPLACEMENT_STEPS;
  const head = new Uint8Array(encodeFrame({ ...state, step, count: step && shown.length / 3 }));
  if (!step) return head.buffer;
  const whole = new Uint8Array(FRAME_BYTES + 2 * shown.length);
  whole.set(head);
  const displacements = new Int16Array(whole.buffer, FRAME_BYTES);
  for (let i = 0; i < shown.length; i++) displacements[i] = Math.round(shown[i] / step);
  return whole.buffer;
}
