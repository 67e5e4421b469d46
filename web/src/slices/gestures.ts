// What mouse, pen and fingers do to a pane.
import type { Vector } from "../messages";
import type { Pane } from "./pane";
import type { State, Tool } from "./state";

interface Finger {
  x: number;
  y: number;
}

/** Watches a pane; `maximise` is what a double click asks for. */
export function watch(pane: Pane, state: State, maximise: () => void): void {
  const { canvas } = pane;
  const name = pane.plane.name;
  const fingers = new Map<number, Finger>();
  let doing: Tool | null = null;
  let start: Vector | null = null; // of a profile

  const spot = (event: PointerEvent | WheelEvent): Finger => {
    const box = canvas.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };
  const choose = () => {
    state.active = name;
    state.chosen = pane.number;
  };
  const shift = (dx: number, dy: number) => state.look(pane.side, name, pane.point(pane.width / 2 - dx, pane.height / 2 - dy));
  const zoom = (factor: number, at: Finger) => {
    const before = pane.point(at.x, at.y);
    state.zoomBy(pane.side, name, factor);
    const [x, y] = pane.pixel(before); // what was under the pointer stays there
    shift(at.x - x, at.y - y);
  };

  canvas.addEventListener("focus", () => {
    choose();
    state.changed();
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", maximise);
  canvas.addEventListener("pointerdown", (event) => {
    choose();
    const at = spot(event);
    fingers.set(event.pointerId, at);
    canvas.setPointerCapture(event.pointerId);
    if (fingers.size > 1) {
      doing = null; // two fingers pinch
      return;
    }
    doing = event.button === 2 ? "window" : event.button === 1 || event.shiftKey ? "pan" : state.tool;
    if (doing === "cross") state.cross(pane.side, pane.point(at.x, at.y));
    if (doing === "profile") start = pane.point(at.x, at.y);
    if (event.button === 1) event.preventDefault();
    state.changed();
  });
  canvas.addEventListener("pointermove", (event) => {
    const old = fingers.get(event.pointerId);
    if (!old) return;
    const at = spot(event);
    if (fingers.size === 2) pinch(event.pointerId, old, at);
    fingers.set(event.pointerId, at);
    const [dx, dy] = [at.x - old.x, at.y - old.y];
    if (doing === "cross") state.cross(pane.side, pane.point(at.x, at.y));
    else if (doing === "pan") shift(dx, dy);
    else if (doing === "window") state.turnWindow(pane.side, 1.005 ** dx, -dy / 300); // right: wider; up: brighter values
    else if (doing === "profile" && start) {
      state.profile = { start, end: pane.point(at.x, at.y) };
      state.mark = null;
      state.changed();
    }
  });
  function pinch(id: number, old: Finger, now: Finger): void {
    const other = [...fingers].find(([key]) => key !== id)![1];
    const apart = (a: Finger) => Math.max(20, Math.hypot(a.x - other.x, a.y - other.y));
    shift((now.x - old.x) / 2, (now.y - old.y) / 2);
    zoom(apart(now) / apart(old), { x: (now.x + other.x) / 2, y: (now.y + other.y) / 2 });
  }
  const lift = (event: PointerEvent) => {
    fingers.delete(event.pointerId);
    doing = start = null;
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      choose();
      if (event.ctrlKey || event.metaKey) zoom(Math.exp(-event.deltaY / 300), spot(event));
      else if (event.deltaY) state.toSlice(pane.side, name, state.slice(pane.side, name) + Math.sign(event.deltaY));
    },
    { passive: false },
  );
}
