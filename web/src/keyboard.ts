// Keys: everything that pointers reach. Letters and digits wherever the focus is, the rest on the organ's canvas.
import type { Cursor } from "./cursor";
import type { View } from "./view";

export const HELP: [string, string][] = [
  ["1 2 3 4", "Press, pull, grasp, needle"],
  ["Tab to the organ, then arrow keys", "Cursor over the surface; of what is held, the hand. With Ctrl in small steps"],
  ["Space", "Take hold, and let go again; puts the needle in"],
  ["+ −", "Deeper and back: the row with the slider"],
  ["Shift and arrow keys", "Turn the view"],
  ["Page Up, Page Down", "Nearer, farther"],
  ["Enter", "Take a sample with the needle"],
  ["F", "Found it"],
  ["N  O", "The needle goes inwards or along the view; needle out"],
  ["W  I  S", "Wireframe, see inside, slices"],
  ["C", "Next colouring"],
  ["R", "Reset the view"],
  ["Escape", "Let go of everything"],
  ["?", "These keys"],
];

const ARROWS: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEP = 12, FINE = 3; // pixels
const TURN = 24;

/** keys: what letters do. drive: the tool at work by so many notches. */
export function listen(
  canvas: HTMLCanvasElement, view: View, cursor: Cursor, keys: Record<string, () => void>, drive: (notches: number) => void,
): void {
  const moves: Record<string, () => void> = {
    " ": () => (cursor.holds ? cursor.release() : cursor.take()),
    PageUp: () => (view.turntable.zoom(0.88), view.touched()),
    PageDown: () => (view.turntable.zoom(1 / 0.88), view.touched()),
  };
  const notches: Record<string, number> = { "+": 1, "=": 1, "-": -1, "−": -1 };
  canvas.addEventListener("keydown", (event) => {
    if (event.altKey || event.metaKey) return;
    const arrow = ARROWS[event.key];
    if (arrow) {
      const [x, y] = arrow, step = event.shiftKey ? TURN : event.ctrlKey ? FINE : STEP;
      if (event.shiftKey) {
        view.turntable.turn(step * x, step * y, canvas.clientHeight);
        view.touched();
        cursor.draw();
      } else cursor.move(step * x, step * y);
    } else if (!moves[event.key]) return;
    else if (event.key !== " " || !event.repeat) moves[event.key]();
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
    if (document.querySelector("dialog[open]") || target instanceof HTMLSelectElement) return;
    if (notches[event.key]) return drive(notches[event.key]);
    if (event.key === "Enter" && target instanceof HTMLButtonElement) return; // its own
    keys[event.key.length === 1 ? event.key.toLowerCase() : event.key]?.();
  });
}
