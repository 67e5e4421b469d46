// What mouse, pen and fingers do to a pane.
import type { Vector } from "../messages";
import type { Pane } from "./pane";
import type { State, Tool } from "./state";

interface Spot {
  x: number;
  y: number;
}

export class Gestures {
  private readonly fingers = new Map<number, Spot>();
  private doing: Tool | null = null;
  private start: Vector | null = null; // of a profile

  /** Watches a pane; `maximise` is what a double click asks for. */
  constructor(private readonly pane: Pane, private readonly state: State, maximise: () => void) {
    const { canvas } = pane;
    canvas.addEventListener("focus", () => {
      this.choose();
      state.changed();
    });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", maximise);
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.lift(event));
    canvas.addEventListener("pointercancel", (event) => this.lift(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  private spot(event: PointerEvent | WheelEvent): Spot {
    const box = this.pane.canvas.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  private choose(): void {
    this.state.active = this.pane.plane.name;
    this.state.chosen = this.pane.number;
  }

  private shift(dx: number, dy: number): void {
    const { pane } = this;
    this.state.look(pane.side, pane.plane.name, pane.point(pane.width / 2 - dx, pane.height / 2 - dy));
  }

  /** What is under the spot stays there. */
  private zoom(factor: number, at: Spot): void {
    const under = this.pane.point(at.x, at.y);
    this.state.zoomBy(this.pane.side, this.pane.plane.name, factor);
    const [x, y] = this.pane.pixel(under);
    this.shift(at.x - x, at.y - y);
  }

  private press(event: PointerEvent): void {
    this.choose();
    const { pane, state } = this, at = this.spot(event);
    this.fingers.set(event.pointerId, at);
    pane.canvas.setPointerCapture(event.pointerId);
    if (this.fingers.size > 1) {
      this.doing = null; // two fingers pinch
      return;
    }
    this.doing = event.button === 2 ? "window" : event.button === 1 || event.shiftKey ? "pan" : state.tool;
    if (this.doing === "cross") state.cross(pane.side, pane.point(at.x, at.y));
    if (this.doing === "profile") this.start = pane.point(at.x, at.y);
    if (event.button === 1) event.preventDefault();
    state.changed();
  }

  private move(event: PointerEvent): void {
    const old = this.fingers.get(event.pointerId);
    if (!old) return;
    const { pane, state } = this, at = this.spot(event);
    if (this.fingers.size === 2) this.pinch(event.pointerId, old, at);
    this.fingers.set(event.pointerId, at);
    const [dx, dy] = [at.x - old.x, at.y - old.y];
    if (this.doing === "cross") state.cross(pane.side, pane.point(at.x, at.y));
    else if (this.doing === "pan") this.shift(dx, dy);
    else if (this.doing === "window") state.turnWindow(pane.side, 1.005 ** dx, -dy / 300); // right: wider; up: brighter values
    else if (this.doing === "profile" && this.start) {
      state.profile = { start: this.start, end: pane.point(at.x, at.y) };
      state.mark = null;
      state.changed();
    }
  }

  private pinch(id: number, old: Spot, now: Spot): void {
    const other = [...this.fingers].find(([key]) => key !== id)![1];
    const apart = (a: Spot) => Math.max(20, Math.hypot(a.x - other.x, a.y - other.y));
    this.shift((now.x - old.x) / 2, (now.y - old.y) / 2);
    this.zoom(apart(now) / apart(old), { x: (now.x + other.x) / 2, y: (now.y + other.y) / 2 });
  }

  private lift(event: PointerEvent): void {
    this.fingers.delete(event.pointerId);
    this.doing = this.start = null;
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.choose();
    const { pane, state } = this, { name } = pane.plane;
    if (event.ctrlKey || event.metaKey) this.zoom(Math.exp(-event.deltaY / 300), this.spot(event));
    else if (event.deltaY) state.toSlice(pane.side, name, state.slice(pane.side, name) + Math.sign(event.deltaY));
  }
}
