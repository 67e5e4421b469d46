// The worker that predicts what a room will answer to the hand of this page.
import { PredictedSession } from "./predicted-session";
import { TouchEngine } from "./touch-engine";
import type { FromPrediction, ToPrediction } from "../protocol/prediction-messages";
import { decodeFrame } from "../protocol/server-messages";

const scope = self as unknown as {
  postMessage(message: FromPrediction, transfer?: Transferable[]): void;
  onmessage: (event: MessageEvent<ToPrediction>) => void;
};

let session: PredictedSession | null = null;

const SAME_PLACE = 1e-3; // mm

/** Both rounded as they do: where a blade grazes a node, that may make another surface. */
const alike = (a: Float32Array, b: Float32Array): boolean => a.length === b.length && a.every((x, i) => Math.abs(x - b[i]) < SAME_PLACE);

async function begin({ engine, solid, rest, frame }: Extract<ToPrediction, { kind: "begin" }>): Promise<void> {
  const loaded = await TouchEngine.load(engine);
  loaded.make(new Uint8Array(solid));
  if (loaded.first && !alike(loaded.first.rest, rest)) throw new Error("this browser cuts the organ otherwise than the room");
  session = new PredictedSession(loaded, rest, decodeFrame(new DataView(frame)), (data, hands) => scope.postMessage({ kind: "frame", data, hands }, [data]));
  session.start();
  scope.postMessage({ kind: "ready" });
}

scope.onmessage = ({ data }) => {
  if (data.kind === "begin") begin(data).catch((problem: unknown) => scope.postMessage({ kind: "problem", text: String(problem) }));
  else if (data.kind === "command") session?.command(data.command);
  else if (data.kind === "hear") session?.hear(decodeFrame(new DataView(data.frame)), data.hands);
  else if (data.kind === "stop") session?.stop(data.frozen);
  else session?.hush(data.silent);
};
