// Messages between the page's worker and the one that predicts.
import type { OtherHand } from "./room-messages";
import type { ToolCommand } from "./server-messages";

/** begin: engine and organ; rest: shown nodes, (nodes, 3) mm; frame: the room's newest. hear: a frame of the room, its head alone. */
export type ToPrediction =
  | { kind: "begin"; engine: ArrayBuffer; solid: ArrayBuffer; rest: Float32Array; frame: ArrayBuffer }
  | { kind: "command"; command: ToolCommand }
  | { kind: "hear"; frame: ArrayBuffer; hands: OtherHand[] }
  | { kind: "stop"; frozen: boolean }
  | { kind: "hush"; silent: boolean };

export type FromPrediction =
  | { kind: "ready" }
  | { kind: "problem"; text: string }
  | { kind: "frame"; data: ArrayBuffer; hands: OtherHand[] };

/** Where a prediction is. problem: why there is none. */
export interface PredictionState {
  state: "off" | "preparing" | "on";
  problem: string;
}
