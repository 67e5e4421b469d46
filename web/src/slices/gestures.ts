// Mouse, pen and touch input on a pane.
import type { Vector } from "../protocol/server-messages";
import type { Pane } from "./pane";
import type { ViewState, Tool } from "./view-state";

interface Position {
  x: number;
  y: number;
}

export class Gestures {
  private readonly fingers = new Map<number, Position>();
  private dragMode: Tool | null = null;
  private start: Vector | null = null; // of a profile

  /** maximize: called at a double click. */
  constructor(private readonly pane: Pane, private readonly state: ViewState, maximize: () => void) {
    const { canvas } = pane;
    canvas.addEventListener("focus", () => {
      this.activate();
      state.changed();
    });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", () => state.tool !== "measure" && maximize());
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.lift(event));
    canvas.addEventListener("pointercancel", (event) => this.lift(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  private positionOf(event: PointerEvent | WheelEvent): Position {
    const box = this.pane.canvas.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  private activate(): void {
    this.state.active = this.pane.plane.name;
    this.state.activeSide = this.pane.sideIndex;
  }

  private shift(dx: number, dy: number): void {
    const { pane } = this;
    this.state.setCenter(pane.side, pane.plane.name, pane.point(pane.width / 2 - dx, pane.height / 2 - dy));
  }

  /** Zooms about a position of the pane. */
  private zoom(factor: number, at: Position): void {
    const under = this.pane.point(at.x, at.y);
    this.state.zoomBy(this.pane.side, this.pane.plane.name, factor);
    const [x, y] = this.pane.pixel(under);
    this.shift(at.x - x, at.y - y);
  }

  private press(event: PointerEvent): void {
    this.activate();
    const { pane, state } = this, at = this.positionOf(event);
    this.fingers.set(event.pointerId, at);
    pane.canvas.setPointerCapture(event.pointerId);
    if (this.fingers.size > 1) {
      if (state.measurements.placing) state.measurements.undo(); // the first finger's point
      this.dragMode = null; // two fingers pinch
      return;
    }
    this.dragMode = event.button === 2 ? "window" : event.button === 1 || event.shiftKey ? "pan" : state.tool;
    if (this.dragMode === "crosshair") state.moveCrosshair(pane.side, pane.point(at.x, at.y));
    if (this.dragMode === "profile") this.start = pane.point(at.x, at.y);
    if (this.dragMode === "measure") state.measurements.begin(pane.slicePoint(pane.point(at.x, at.y)), (first) => pane.near(first, at));
    if (event.button === 1) event.preventDefault();
    state.changed();
  }

  private move(event: PointerEvent): void {
    const old = this.fingers.get(event.pointerId);
    if (!old) return;
    const { pane, state } = this, at = this.positionOf(event);
    if (this.fingers.size === 2) this.pinch(event.pointerId, old, at);
    this.fingers.set(event.pointerId, at);
    const [dx, dy] = [at.x - old.x, at.y - old.y];
    if (this.dragMode === "crosshair") state.moveCrosshair(pane.side, pane.point(at.x, at.y));
    else if (this.dragMode === "pan") this.shift(dx, dy);
    else if (this.dragMode === "window") state.adjustWindow(pane.side, 1.005 ** dx, -dy / 300); // right: wider; up: brighter values
    else if (this.dragMode === "measure") state.measurements.moveTo(pane.slicePoint(pane.point(at.x, at.y)));
    else if (this.dragMode === "profile" && this.start) {
      state.profile = { start: this.start, end: pane.point(at.x, at.y) };
      state.mark = null;
      state.changed();
    }
  }

  private pinch(id: number, old: Position, now: Position): void {
    const other = [...this.fingers].find(([key]) => key !== id)![1];
    const distance = (a: Position) => Math.max(20, Math.hypot(a.x - other.x, a.y - other.y));
    this.shift((now.x - old.x) / 2, (now.y - old.y) / 2);
    this.zoom(distance(now) / distance(old), { x: (now.x + other.x) / 2, y: (now.y + other.y) / 2 });
  }

  private lift(event: PointerEvent): void {
    this.fingers.delete(event.pointerId);
    if (this.dragMode === "measure") this.state.measurements.place();
    this.dragMode = this.start = null;
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.activate();
    const { pane, state } = this, { name } = pane.plane;
    if (event.ctrlKey || event.metaKey) this.zoom(Math.exp(-event.deltaY / 300), this.positionOf(event));
    else if (event.deltaY) state.goToSlice(pane.side, name, state.slice(pane.side, name) + Math.sign(event.deltaY));
  }
}
