// Mouse, pen and touch input on the organ's canvas. A pointer on the organ moves the tool. Outside the organ, with another
// button or with a second finger, it rotates the view.
import type { ToolController } from "../tools/tool-controller";
import type { OrganView } from "../rendering/organ-view";

const MOVE_INTERVAL = 6; // ms

export class PointerInput {
  private toolPointer: number | null = null; // the pointer that moves the tool
  private last: [number, number] = [0, 0];
  private moved = 0; // ms, when the tool last moved
  private readonly viewPointers = new Map<number, [number, number]>();

  /** hover: called with the pixel of a pointer without buttons, returns whether the organ is there. changeAmount: moves
   * the slider by so many steps. */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly view: OrganView,
    private readonly controller: ToolController,
    private readonly hover: (x: number, y: number) => boolean,
    private readonly changeAmount: (steps: number) => void,
  ) {
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    // pointermove comes once a frame, pointerrawupdate at once: it saves up to a frame of delay.
    canvas.addEventListener("pointerrawupdate", (event) => {
      const raw = event as PointerEvent;
      if (raw.pointerId === this.toolPointer && raw.timeStamp - this.moved > MOVE_INTERVAL) this.moveTool(raw);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const)
      canvas.addEventListener(end, (event) => this.up(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
  }

  private down(event: PointerEvent): void {
    const { clientX: x, clientY: y } = event;
    this.canvas.setPointerCapture(event.pointerId);
    const free = event.button === 0 && !this.viewPointers.size && this.toolPointer === null && !this.controller.holding;
    if (free && this.controller.begin(x, y, event.timeStamp, event.shiftKey)) {
      this.toolPointer = event.pointerId;
      this.moved = event.timeStamp;
      this.last = [x, y];
    } else {
      if (this.toolPointer !== null && event.pointerType === "touch") {
        this.viewPointers.set(this.toolPointer, this.last); // a second finger: both move the view now
        this.release();
      }
      this.viewPointers.set(event.pointerId, [x, y]);
    }
    this.canvas.classList.add("dragging");
  }

  private move(event: PointerEvent): void {
    const { clientX: x, clientY: y } = event;
    if (event.pointerId === this.toolPointer) {
      if (event.timeStamp > this.moved) this.moveTool(event);
    } else if (this.viewPointers.has(event.pointerId)) this.moveView(event);
    else if (!event.buttons) this.canvas.classList.toggle("on-organ", this.hover(x, y));
  }

  private moveTool(event: PointerEvent): void {
    this.last = [event.clientX, event.clientY];
    this.moved = event.timeStamp;
    const pressure = event.pointerType === "pen" && event.pressure > 0 ? Math.min(2 * event.pressure, 1.5) : 1;
    this.controller.moveTo(...this.last, event.timeStamp, pressure);
  }

  private up(event: PointerEvent): void {
    if (event.pointerId === this.toolPointer) this.release();
    this.viewPointers.delete(event.pointerId);
    if (this.toolPointer === null && !this.viewPointers.size) this.canvas.classList.remove("dragging");
  }

  release(): void {
    if (this.toolPointer === null) return;
    this.toolPointer = null;
    this.controller.release();
  }

  private moveView(event: PointerEvent): void {
    const before = this.viewPointers.get(event.pointerId)!;
    const others = [...this.viewPointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    const dx = event.clientX - before[0], dy = event.clientY - before[1];
    const { turntable } = this.view, height = this.canvas.clientHeight;
    if (others.length) {
      const distance = (x: number, y: number) => Math.hypot(x - others[0][0], y - others[0][1]) || 1;
      turntable.zoom(distance(...before) / distance(event.clientX, event.clientY));
      turntable.rotate(dx / 2, dy / 2, height);
    } else if (event.buttons & 4 || event.shiftKey) turntable.pan(dx, dy, height);
    else turntable.rotate(dx, dy, height);
    this.viewPointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.view.requestRedraw();
  }

  /** The wheel moves the slider while a tool holds, otherwise it zooms. */
  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const steps = -event.deltaY / (event.deltaMode === 0 ? 100 : 3);
    const toolActive = this.controller.holding || (this.controller.kind === "needle" && this.controller.needleInserted);
    if (toolActive) return this.changeAmount(steps);
    this.view.turntable.zoom(Math.exp(-0.12 * steps));
    this.view.requestRedraw();
  }
}
