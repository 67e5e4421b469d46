// A frame of the page's own engine as the message that a server would send.
import { AT_REST, DISPLACEMENT_STEPS, EXAM_FORCE, EXAM_LENGTH, EXAM_WORK, FRAME_BYTES, encodeFrame, type Frame } from "../protocol/server-messages";

/** shown: displacements of the shown nodes, (nodes, 3) mm, which follow as integers of one step; at rest none do. */
export function frameMessage(state: Omit<Frame, "step" | "count">, shown: Float32Array): ArrayBuffer {
  const largest = largestOf(shown);
  return inSteps(state, shown, largest < AT_REST ? 0 : largest / DISPLACEMENT_STEPS);
}

/** The same in the steps of a screen, as the server of an exam sends it. */
export function examFrameMessage(state: Omit<Frame, "step" | "count">, shown: Float32Array): ArrayBuffer {
  const lengths = (values: readonly number[]) => rounded(values, EXAM_LENGTH);
  const { point, displacement, insertion, force, energy } = state;
  const told = { ...state, point: lengths(point), displacement: lengths(displacement), insertion: lengths(insertion), force: rounded(force, EXAM_FORCE), energy: rounded([energy], EXAM_WORK)[0] };
  return inSteps(told, shown, largestOf(shown) < EXAM_LENGTH / 2 ? 0 : EXAM_LENGTH);
}

const rounded = (values: readonly number[], step: number): number[] => values.map((value) => step * Math.round(value / step));
const largestOf = (values: Float32Array): number => values.reduce((most, x) => Math.max(most, Math.abs(x)), 0);

function inSteps(state: Omit<Frame, "step" | "count">, shown: Float32Array, step: number): ArrayBuffer {
  const head = new Uint8Array(encodeFrame({ ...state, step, count: step && shown.length / 3 }));
  if (!step) return head.buffer;
  const whole = new Uint8Array(FRAME_BYTES + 2 * shown.length);
  whole.set(head);
  const displacements = new Int16Array(whole.buffer, FRAME_BYTES);
  for (let i = 0; i < shown.length; i++) displacements[i] = Math.round(shown[i] / step);
  return whole.buffer;
}
