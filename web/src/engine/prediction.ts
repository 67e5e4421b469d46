// Predicts in a room what the room will answer to the hand of this page, once the way there and back is long. It fetches the
// engine and the organ, and takes over when the hand holds nothing, so that no force steps.
import type { FromPrediction, PredictionState, ToPrediction } from "../protocol/prediction-messages";
import type { OtherHand } from "../protocol/room-messages";
import { ContactState, FRAME_BYTES, decodeFrame, encodeDetail, type Frame, type Scene, type ToolCommand } from "../protocol/server-messages";

const LONG = 60; // ms there and back, from which on a hand would feel the delay
const MODEL = "compliance"; // that the engine has

export class Prediction {
  private worker: Worker | null = null;
  private ready = false;
  private on = false;
  private problem = "";
  private truth: ArrayBuffer | null = null; // head of the room's newest frame
  private frozen = false;
  private silent = false;

  /** addresses: of the engine and the organ. post: takes a predicted frame. tell: is told where it is. request: sends the room a message. asked: as `ask` was told before. */
  constructor(
    private readonly scene: Scene, private readonly rest: Float32Array, private readonly addresses: [engine: string, solid: string],
    private readonly post: (data: ArrayBuffer, hands: OtherHand[]) => void, private readonly tell: (state: PredictionState) => void,
    private readonly request: (message: ArrayBuffer) => void,
    private asked: boolean | null, // by the person; null: by the way's length
  ) {
    this.report();
  }

  /** Whether its frames are shown in place of the room's. */
  get active(): boolean {
    return this.on;
  }

  /** The person wants it, or not. */
  ask(wanted: boolean): void {
    this.asked = wanted;
    if (!wanted) return this.close();
    this.problem = "";
    this.begin();
  }

  /** The way to the room and back takes so long, ms. */
  measure(roundTrip: number): void {
    if (this.asked === null && roundTrip > LONG) this.begin();
  }

  command(command: ToolCommand): void {
    if (this.on) this.send({ kind: "command", command });
  }

  /** A frame of the room. */
  hear(data: ArrayBuffer, hands: OtherHand[]): void {
    this.truth = data.slice(0, FRAME_BYTES);
    if (!this.ready) return this.asked ? this.begin() : undefined;
    const frame = decodeFrame(new DataView(data));
    if (!this.follows(frame)) return this.close("the organ was cut, or has another model");
    this.send({ kind: "hear", frame: this.truth, hands });
    if (!this.on && frame.contact.every((contact) => contact === ContactState.idle)) {
      this.on = true;
      this.request(encodeDetail({ whole: 0 }));
      this.report();
    }
  }

  stop(frozen: boolean): void {
    this.frozen = frozen;
    this.send({ kind: "stop", frozen });
  }

  hush(silent: boolean): void {
    this.silent = silent;
    this.send({ kind: "hush", silent });
  }

  close(problem = ""): void {
    this.worker?.terminate();
    this.worker = null;
    if (this.on) this.request(encodeDetail({ whole: 1 }));
    this.ready = this.on = false;
    this.problem = problem;
    this.report();
  }

  private follows(frame: Frame): boolean {
    return frame.body === this.scene.body && this.scene.models[frame.model] === MODEL && frame.chosen === frame.model;
  }

  private begin(): void {
    if (this.worker || this.problem) return;
    if (!this.truth || !this.follows(decodeFrame(new DataView(this.truth)))) return; // it is asked again
    const worker = (this.worker = new Worker(new URL("predict.js", self.location.href), { type: "module" }));
    worker.onmessage = ({ data }: MessageEvent<FromPrediction>) => {
      if (data.kind === "frame") {
        if (this.on) this.post(data.data, data.hands);
      } else if (data.kind === "ready") {
        this.ready = true;
        this.stop(this.frozen);
        this.hush(this.silent);
      } else this.close(data.text);
    };
    worker.onerror = ({ message }) => this.close(message);
    this.report();
    this.load(worker).catch((problem: unknown) => this.worker === worker && this.close(problem instanceof Error ? problem.message : String(problem)));
  }

  private async load(worker: Worker): Promise<void> {
    const [engine, solid] = await Promise.all(this.addresses.map(async (address) => {
      const answer = await fetch(address);
      if (!answer.ok) throw new Error((await answer.text()).replace("prediction: ", ""));
      return answer.arrayBuffer();
    }));
    const begin: ToPrediction = { kind: "begin", engine, solid, rest: this.rest, frame: this.truth! };
    worker.postMessage(begin, [engine, solid]);
  }

  private send(message: ToPrediction): void {
    if (this.ready) this.worker?.postMessage(message);
  }

  private report(): void {
    const { on, worker, problem } = this;
    this.tell({ state: on ? "on" : worker ? "preparing" : "off", problem });
  }
}
