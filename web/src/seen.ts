// What tests and benchmarks look at; nothing in the page uses it.
import type { Beside } from "./beside";
import type { Commands } from "./commands";
import type { Cursor } from "./cursor";
import type { Hand } from "./hand";
import type { Frame, Scene, Vector } from "./messages";
import type { Readout } from "./readout";
import type { View } from "./view";

interface Parts {
  view: View;
  hand: Hand;
  cursor: Cursor;
  commands: Commands;
  beside: Beside;
  readout: Readout;
  frame(): Frame | null;
  scene(): Scene | null;
}

declare global {
  interface Window {
    palpate: {
      readonly frame: Frame | null;
      readonly scene: Scene | null;
      /** Pixel at which a shown node is drawn. */
      pixel(node: number): [number, number];
      /** Pixel at which the material point that is held is drawn. */
      held(): [number, number] | null;
      /** Is the organ under this pixel? */
      under(x: number, y: number): boolean;
      /** Pixel of the keyboard's cursor. */
      cursor(): [number, number] | null;
      /** Crosshair in the slices, mm. */
      cross(): Vector | null;
      /** Serial of the newest command. */
      readonly sent: number;
      /** Delays of the last commands: ms from the hand's move to the end of drawing what obeys it. */
      latency(last?: number): { median: number; p99: number; count: number };
      /** ms of the page's thread for each of the last frames. */
      readonly work: number[];
      /** Pictures drawn since the page opened. */
      readonly pictures: number;
    };
  }
}

const KEPT = 2000;

/** Shows the parts; gives what is told of each frame's work. */
export function exposed(parts: Parts): { work(ms: number): void } {
  const work: number[] = [];
  const { view, hand } = parts;
  window.palpate = {
    get frame() {
      return parts.frame();
    },
    get scene() {
      return parts.scene();
    },
    get pictures() {
      return view.renderer.info.render.frame;
    },
    get sent() {
      return parts.commands.sent;
    },
    pixel: (node) => view.toPixel([...view.positions.subarray(3 * node, 3 * node + 3)] as Vector),
    held: () => (hand.held ? view.toPixel(hand.held) : null),
    under: (x, y) => hand.under(x, y) !== null,
    cursor: () => parts.cursor.pixel,
    cross: () => parts.beside.cross,
    latency: (last = 1000) => parts.commands.latency(last),
    work,
  };
  return {
    work(ms) {
      parts.readout.work = parts.readout.work ? 0.9 * parts.readout.work + 0.1 * ms : ms;
      work.push(ms);
      if (work.length > KEPT) work.splice(0, KEPT / 2);
    },
  };
}
