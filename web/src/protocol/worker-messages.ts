// Messages between the page and its worker.
import type { PredictionState } from "./prediction-messages";
import type { OtherHand, PiecePose, RoomState } from "./room-messages";
import type {
  Choice, Difference, Frame, Guidance, Guided, Lead, Mark, Note, NoteText, Play, Position, Scalpel, Scene, Selection, TimelineTrack, ToolCommand, TrialStatus,
} from "./server-messages";

/** The scene's arrays: nodes at rest (mm), where they are drawn then (`open`: cuts gape), triangles, unit normals at rest, and the edges of the outer surface, and
 * of the lips of cuts, as pairs of nodes. beside: the organ of each node, where there are several. openness: of each node at rest, 0 (buried) to 255. */
export interface Organ {
  scene: Scene;
  rest: Float32Array<ArrayBuffer>;
  open: Float32Array<ArrayBuffer>;
  triangles: Uint32Array<ArrayBuffer>;
  beside: Uint32Array<ArrayBuffer> | null;
  normals: Float32Array<ArrayBuffer>;
  edges: Uint32Array<ArrayBuffer>;
  rims: Uint32Array<ArrayBuffer>;
  openness: Uint8Array<ArrayBuffer>;
  pieces: Piece[];
}

/** A piece that a cut has freed, as an organ of its own, and how it is drawn. */
export interface Piece {
  organ: Organ;
  arrays: NodeArrays;
}

/** Values of every shown node, transferred between page and worker without a copy: positions (mm), normals (x, y, z and
 * an unused entry; 32767 is 1), colors (linear red, green, blue and an unused entry; 255 is 1). */
export interface NodeArrays {
  positions: Float32Array<ArrayBuffer>;
  normals: Int16Array<ArrayBuffer>;
  colors: Uint8Array<ArrayBuffer>;
}

export const buffersOf = ({ positions, normals, colors }: NodeArrays): ArrayBuffer[] => [positions.buffer, normals.buffer, colors.buffer];

/** What the color of a node means. */
export type ColorMode = "plain" | "displacement" | "strain" | "stiffness" | "error";

export type Ends = [low: number, high: number];

/** A color scale, in its unit: its ends, the values of now, and the value up to which the model holds (null: all or
 * unknown); null if there is no scale. */
export type Scale = { ends: Ends; range: Ends; limit: number | null } | null;

/** organ: cut: another one, or the same after a cut. bodies: wants a worker that makes bodies at the other end of the port. stale: what was shown last is not of now. way: to the room and back. */
export type FromWorker =
  | { kind: "organ"; organ: Organ; cut: boolean }
  | { kind: "frame"; frame: Frame; arrays: NodeArrays | null; hands: OtherHand[]; pieces: PiecePose[]; scale: Scale; work: number }
  | { kind: "difference"; difference: Difference }
  | { kind: "trial"; status: TrialStatus }
  | { kind: "notes"; notes: NoteText[] }
  | { kind: "people"; room: RoomState }
  | { kind: "guidance"; told: Guidance }
  | { kind: "timeline"; tracks: TimelineTrack[] }
  | { kind: "position"; position: Position }
  | { kind: "stale" }
  | { kind: "prediction"; state: PredictionState }
  | { kind: "way"; milliseconds: number }
  | { kind: "notice"; text: string }
  | { kind: "status"; good: boolean; text: string }
  | { kind: "bodies"; port: MessagePort }
  | { kind: "record"; text: string; file: boolean };

/** bodies: makes the bodies of a session's cuts, and nothing else. open-file: an exported organ and its engine, instead of a server; save: asks for its record, to write into a file or not. predict: whether the page shall predict what the room will answer. ends: of the scale of a mode, from now on. next: asks for the next frame; pressing: whether the first tool measures stiffness. return: arrays to use again. */
export type ToWorker =
  | { kind: "open"; scene: string; socket: string }
  | { kind: "open-file"; organ: ArrayBuffer; engine: ArrayBuffer }
  | { kind: "bodies"; port: MessagePort }
  | { kind: "command"; command: ToolCommand }
  | { kind: "select"; selection: Selection }
  | { kind: "mark"; mark: Mark }
  | { kind: "scalpel"; scalpel: Scalpel }
  | { kind: "choose"; choice: Choice }
  | { kind: "lead"; lead: Lead }
  | { kind: "guided"; guided: Guided }
  | { kind: "note"; note: Note; text: string }
  | { kind: "play"; play: Play }
  | { kind: "color"; mode: ColorMode }
  | { kind: "ends"; mode: ColorMode; ends: Ends }
  | { kind: "save"; file: boolean }
  | { kind: "predict"; on: boolean }
  | { kind: "return"; arrays: NodeArrays }
  | { kind: "next"; arrays: NodeArrays | null; pressing: boolean };
