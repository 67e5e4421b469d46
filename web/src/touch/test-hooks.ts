// `window.palpate`: the page's state for tests and benchmarks. Nothing in the page uses it.
import type { Endoscope } from "../endoscopy/endoscope";
import type { Measuring } from "./measuring";
import type { ReplayControls } from "./replay-controls";
import type { SideSlices } from "./side-slices";
import type { CommandQueue } from "../tools/command-queue";
import type { SurfaceCursor } from "../input/surface-cursor";
import type { ToolController } from "../tools/tool-controller";
import type { OtherHand, PiecePose } from "../protocol/room-messages";
import { CommandKind, type Frame, type Guidance, type Scene, type Vector } from "../protocol/server-messages";
import type { AudioFeedback } from "../sound/audio-feedback";
import type { SoundEvent } from "../sound/sound-events";
import { pitch, renderOffline } from "../sound/synthesizer";
import type { ForceReadout } from "../ui/force-readout";
import type { Appearance } from "../rendering/appearance";
import type { OrganView } from "../rendering/organ-view";

interface Parts {
  view: OrganView;
  controller: ToolController;
  cursor: SurfaceCursor;
  commands: CommandQueue;
  endoscope: Endoscope;
  measuring: Measuring;
  replay: ReplayControls;
  sideSlices: SideSlices;
  readout: ForceReadout;
  sound: AudioFeedback;
  frame(): Frame | null;
  scene(): Scene | null;
  hands(): OtherHand[];
  guidance(): Window["palpate"]["guidance"];
}

declare global {
  interface Window {
    palpate: {
      readonly frame: Frame | null;
      readonly scene: Scene | null;
      /** Tools of others in a room. */
      readonly hands: OtherHand[];
      /** Who guides whom, and the force on the guided hand, N. */
      readonly guidance: { told: Guidance | null; force: Vector };
      /** Where the pieces are that cuts have freed, and the pixel at which the middle of each is drawn. */
      pieces(): (PiecePose & { pixel: [number, number] })[];
      /** Shown nodes as they are drawn, (nodes, 3) mm. */
      positions(): number[];
      /** Commands a tool to hold the material point at `point` and displace it, mm. */
      hold(tool: number, point: Vector, displacement: Vector): void;
      release(tool: number): void;
      /** Pixel at which a shown node is drawn. */
      nodePixel(node: number): [number, number];
      /** The newest frame of a second replay. */
      readonly secondFrame: Frame | null;
      /** Whether the figures of all measurements are those of now. */
      readonly measured: boolean;
      /** Tissue or plain, and how much of it is drawn. */
      readonly appearance: Appearance;
      /** The view from inside. */
      readonly endoscope: Endoscope;
      /** Pixel at which a position (mm) is drawn. */
      pixel(point: Vector): [number, number];
      /** Pixel at which the held material point is drawn. */
      heldPixel(): [number, number] | null;
      /** Is the organ under this pixel? */
      hitsOrgan(x: number, y: number): boolean;
      /** Pixel of the surface cursor. */
      cursorPixel(): [number, number] | null;
      /** Crosshair in the slices, mm. */
      crosshair(): Vector | null;
      /** Serial number of the newest command. */
      readonly lastSerial: number;
      /** Delays of the last commands, ms: from the input to the end of drawing a frame that obeys it. */
      latency(last?: number): { median: number; p99: number; count: number };
      /** Work of the page's thread for each of the last frames, ms. */
      readonly work: number[];
      /** The newest sounds. */
      readonly played: AudioFeedback["played"];
      /** Hz, for a force and its limit, N. */
      pitch(force: number, limit: number): number;
      /** Samples at 44.1 kHz of events and forces at times in s, as the page plays them. */
      renderSound(seconds: number, events: [SoundEvent, number][], forces: [number, number][], limit: number): Promise<number[]>;
      /** Frames drawn since the page opened. */
      readonly framesDrawn: number;
    };
  }
}

const CAPACITY = 2000;

/** Defines `window.palpate`. Returns a function that records the work for a frame. */
export function exposeTestHooks(parts: Parts): { recordWork(ms: number): void } {
  const work: number[] = [];
  const { view, controller, readout } = parts;
  window.palpate = {
    get frame() {
      return parts.frame();
    },
    get scene() {
      return parts.scene();
    },
    get hands() {
      return parts.hands();
    },
    get guidance() {
      return parts.guidance();
    },
    pieces: () => view.pieces.poses.map((pose, i) => ({ ...pose, pixel: view.toPixel(view.pieces.middle(i)) })),
    positions: () => [...view.positions],
    hold: (tool, point, displacement) => parts.commands.send(tool, CommandKind.hold, point, displacement, performance.now()),
    release: (tool) => parts.commands.release(tool, true),
    get framesDrawn() {
      return view.renderer.info.render.frame;
    },
    get lastSerial() {
      return parts.commands.lastSerial;
    },
    get secondFrame() {
      return parts.replay.secondFrame;
    },
    get measured() {
      return parts.measuring.isCurrent;
    },
    appearance: view.appearance,
    endoscope: parts.endoscope,
    nodePixel: (node) => view.toPixel([...view.positions.subarray(3 * node, 3 * node + 3)] as Vector),
    pixel: (point) => view.toPixel(point),
    heldPixel: () => (controller.heldPoint ? view.toPixel(controller.heldPoint) : null),
    hitsOrgan: (x, y) => controller.pick(x, y) !== null,
    cursorPixel: () => parts.cursor.pixel,
    crosshair: () => parts.sideSlices.crosshair,
    played: parts.sound.played,
    pitch,
    renderSound: async (...what) => [...(await renderOffline(...what))],
    latency: (last = 1000) => parts.commands.latency(last),
    work,
  };
  return {
    recordWork(ms) {
      readout.work = readout.work ? 0.9 * readout.work + 0.1 * ms : ms;
      work.push(ms);
      if (work.length > CAPACITY) work.splice(0, CAPACITY / 2);
    },
  };
}
