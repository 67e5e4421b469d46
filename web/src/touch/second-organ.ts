// The organ of a second replay, beside the first: a picture of its own, with the camera of the first.
import { buffersOf, type ColorMode, type FromWorker, type NodeArrays, type ToWorker } from "../protocol/worker-messages";
import { workerAddress } from "../protocol/embedded-file";
import type { PiecePose } from "../protocol/room-messages";
import type { Frame } from "../protocol/server-messages";
import { OrganView } from "../rendering/organ-view";
import { element, write } from "../ui/controls";

export class SecondOrgan {
  readonly view: OrganView;
  frame: Frame | null = null;
  private readonly worker = new Worker(workerAddress(), { type: "module" });
  private pending: { frame: Frame; arrays: NodeArrays | null; pieces: PiecePose[] } | null = null;

  /** first: the view whose camera this one has. scene, socket: addresses of the second replay. */
  constructor(private readonly first: OrganView, scene: string, socket: string) {
    element("second").hidden = false;
    document.body.classList.add("with-second");
    const canvas = element<HTMLCanvasElement>("second-view");
    this.view = new OrganView(canvas, first.appearance);
    this.worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.take(data);
    this.post({ kind: "open", scene, socket });
    this.listen(canvas);
  }

  private post(message: ToWorker, transfer: Transferable[] = []): void {
    this.worker.postMessage(message, transfer);
  }

  private take(data: FromWorker): void {
    if (data.kind === "organ") {
      this.view.show(data.organ);
      write("second-title", data.organ.scene.title);
      this.pending = null;
      this.post({ kind: "next", arrays: null, pressing: false });
    } else if (data.kind === "frame") {
      const undrawn = this.pending?.arrays ?? null;
      this.pending = { frame: data.frame, arrays: data.arrays ?? undrawn, pieces: data.pieces };
      if (data.arrays && undrawn) this.post({ kind: "return", arrays: undrawn }, buffersOf(undrawn));
    }
  }

  /** Drags and the wheel move the camera of both. */
  private listen(canvas: HTMLCanvasElement): void {
    const { first } = this, height = () => canvas.clientHeight;
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      if (event.shiftKey || event.buttons & 4) first.turntable.pan(event.movementX, event.movementY, height());
      else first.turntable.rotate(event.movementX, event.movementY, height());
      first.requestRedraw();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      first.turntable.zoom(Math.exp(0.0012 * event.deltaY));
      first.requestRedraw();
    }, { passive: false });
  }

  show(mode: ColorMode): void {
    this.post({ kind: "color", mode });
  }

  /** Called once a display frame. */
  draw(): void {
    const { pending, view } = this;
    this.pending = null;
    if (pending) {
      this.frame = pending.frame;
      view.showPieces(pending.pieces);
      const replaced = view.update(pending.frame, pending.arrays);
      this.post({ kind: "next", arrays: replaced, pressing: true }, replaced ? buffersOf(replaced) : []);
    }
    if (view.turntable.follow(this.first.turntable)) view.requestRedraw();
    view.draw();
  }
}
