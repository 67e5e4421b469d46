// Keyboard input for everything that a pointer can do. Letters and digits work anywhere in the page, the other keys on
// the organ's canvas.
import type { SurfaceCursor } from "./surface-cursor";
import type { OrganView } from "../rendering/organ-view";

export const HELP: [string, string][] = [
  ["1 2 3 4 5 6 7", "Press, pull, grasp, needle, cut, measure, camera"],
  ["Tab to the organ, then arrow keys", "Move the cursor over the surface, or the tool that holds; with Ctrl in small steps"],
  ["Space", "Hold, and let go again; inserts the needle"],
  ["+ −", "Move the slider"],
  ["Shift and arrow keys", "Rotate the view"],
  ["Page Up, Page Down", "Zoom in, out"],
  ["Z", "Take the last cut back, or the last point measured"],
  ["G  Q", "Inside: fly on along the lumen, and stop; leave"],
  ["K", "Measure a distance, an angle or an area; Space sets a point"],
  ["Enter", "Take a sample with the needle; close an area"],
  ["F", "Found it"],
  ["X  1 2", "In an experiment: the other interval; the answer"],
  ["N  O", "Needle inwards or along the view; needle out"],
  ["A", "Drawn as tissue, or plainly"],
  ["W  I  S", "Wireframe, see inside, slices"],
  ["C", "Next color mode"],
  ["M", "Sound: off, events, force as pitch"],
  ["P", "In a replay: play or pause"],
  ["J  L  ,  .", "In a replay: a second back, forth; the event before, after"],
  ["[  ]", "In a replay: slower, faster"],
  ["T  V", "Save a picture; record a video, and end it"],
  ["R  0", "Reset the view; the view, the tools and the colors"],
  ["H", "In a room, as its teacher: stop all hands, and let them go on"],
  ["Escape", "Let go of everything"],
  ["?", "Show these keys"],
];

const ARROWS: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEP = 12, SMALL_STEP = 3, ROTATE_STEP = 24; // pixels

/** keys: actions by key. changeAmount: moves the slider by so many steps. */
export function listenToKeys(
  canvas: HTMLCanvasElement, view: OrganView, cursor: SurfaceCursor, keys: Record<string, () => void>, changeAmount: (steps: number) => void,
): void {
  const canvasKeys: Record<string, () => void> = {
    " ": () => (cursor.holding ? cursor.release() : cursor.begin()),
    PageUp: () => (view.turntable.zoom(0.88), view.requestRedraw()),
    PageDown: () => (view.turntable.zoom(1 / 0.88), view.requestRedraw()),
  };
  const steps: Record<string, number> = { "+": 1, "=": 1, "-": -1, "−": -1 };
  canvas.addEventListener("keydown", (event) => {
    if (event.altKey || event.metaKey) return;
    const arrow = ARROWS[event.key];
    if (arrow) {
      const [x, y] = arrow, step = event.shiftKey ? ROTATE_STEP : event.ctrlKey ? SMALL_STEP : STEP;
      if (event.shiftKey) {
        view.turntable.rotate(step * x, step * y, canvas.clientHeight);
        view.requestRedraw();
        cursor.draw();
      } else cursor.move(step * x, step * y);
    } else if (!canvasKeys[event.key]) return;
    else if (event.key !== " " || !event.repeat) canvasKeys[event.key]();
    event.preventDefault();
  });
  canvas.addEventListener("focus", () => canvas.matches(":focus-visible") && cursor.show());
  canvas.addEventListener("blur", () => {
    cursor.release();
    cursor.hide();
  });
  canvas.addEventListener("pointerdown", () => cursor.hide());
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const target = event.target as HTMLElement;
    if (document.querySelector("dialog[open]") || target.matches("select, input:not([type=range])")) return;
    if (steps[event.key]) return changeAmount(steps[event.key]);
    if (event.key === "Enter" && target instanceof HTMLButtonElement) return; // the button's own key
    keys[event.key.length === 1 ? event.key.toLowerCase() : event.key]?.();
  });
}
