// Has the bodies of a session's cuts made in a worker of its own.
import type { FromBodyWorker, ToBodyWorker } from "../protocol/body-messages";

export class BodyBuilder {
  private port: MessagePort | null = null; // to the worker

  /** begin: begins such a worker at the other end. module, solid: as a session has them. */
  constructor(private readonly beginWorker: (port: MessagePort) => void, private readonly module: ArrayBuffer, private readonly solid: Uint8Array) {}

  /** Gets ready: a hand has begun a cut. */
  begin(): MessagePort {
    if (this.port) return this.port;
    const { port1, port2 } = new MessageChannel();
    this.beginWorker(port2);
    const take: ToBodyWorker = { kind: "take", module: this.module, solid: this.solid };
    port1.postMessage(take);
    return (this.port = port1);
  }

  /** The body with these cuts beside those that the organ came with. Rejects with a text for the person. One at a time. */
  build(cuts: Float64Array[]): Promise<Uint8Array<ArrayBuffer>[]> {
    const port = this.begin(), message: ToBodyWorker = { kind: "build", cuts };
    return new Promise((made, refused) => {
      port.onmessage = ({ data }: MessageEvent<FromBodyWorker>) => {
        if (data.kind === "arrays") return made(data.arrays);
        if (data.kind === "failed") this.port = null; // the next cut gets another worker
        refused(data.text);
      };
      port.postMessage(message);
    });
  }
}
