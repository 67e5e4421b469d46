// What a notebook reads of the touch page, and what it sets.
import type { CommandQueue } from "../tools/command-queue";
import { TOOL_KINDS, type ToolController, type ToolKind } from "../tools/tool-controller";
import { add, toolVector } from "../organ/mesh-geometry";
import { inNotebook, NotebookLink } from "../protocol/notebook-link";
import type { Frame } from "../protocol/server-messages";
import type { ColorMode } from "../protocol/worker-messages";
import { setDark } from "../rendering/color-scheme";
import type { OrganView } from "../rendering/organ-view";
import type { DepthSlider } from "../ui/depth-slider";
import { measure } from "../ui/force-readout";

const RECORD_INTERVAL = 1000; // ms between two records at least
const RECORD_RATE = 100; // characters of it a ms: a long session is sent less often

interface Parts {
  view: OrganView;
  controller: ToolController;
  commands: CommandQueue;
  depthSlider: DepthSlider;
  frame(): Frame | null;
  color(): ColorMode;
  selectTool(kind: ToolKind): void;
  selectColor(mode: ColorMode): void;
  /** Asks the worker for the record of the session. */
  requestRecord(): void;
}

export class NotebookValues {
  private readonly link: NotebookLink;
  private record = "";
  private recorded = 0; // events that it holds
  private events = 0; // marks, and commands up to the newest
  private marks = 0;
  private nextRecord = 0; // ms
  private opened = false;

  constructor(private readonly parts: Parts) {
    const { view, depthSlider } = parts;
    this.link = new NotebookLink({
      dark: setDark,
      tool: (kind: ToolKind) => TOOL_KINDS.includes(kind) && parts.selectTool(kind),
      depth: (mm: number) => depthSlider.set(mm),
      color: (mode: ColorMode) => parts.selectColor(mode),
      view: (angles: [number, number]) => {
        view.turntable.angles = angles;
        view.requestRedraw();
      },
    });
  }

  addMark(): void {
    this.marks++;
  }

  setRecord(text: string): void {
    this.record = text;
    this.nextRecord = performance.now() + Math.max(RECORD_INTERVAL, text.length / RECORD_RATE);
  }

  /** Once a display frame. */
  update(now: number): void {
    const { view, controller, commands } = this.parts, frame = this.parts.frame();
    if (!inNotebook || !frame) return;
    if (!this.opened) this.link.open();
    this.opened = true;
    const kind = controller.kind, here = measure(frame, kind);
    const vector = (values: number[]) => toolVector(values, here!.tool);
    const touched = here && { force: vector(frame.force), point: vector(frame.point), displacement: vector(frame.displacement) };
    this.link.report(now, {
      tool: kind,
      depth: controller.amounts[kind],
      color: this.parts.color(),
      view: view.turntable.angles,
      _touched: touched && { ...touched, position: add(touched.point, touched.displacement) },
      _picked: controller.picked,
      _record: this.record,
    });
    this.events = commands.lastSerial + this.marks;
    if (here || this.events === this.recorded || now < this.nextRecord || frame.serial < commands.lastSerial) return;
    this.recorded = this.events;
    this.nextRecord = Infinity; // until it has come
    this.parts.requestRecord();
  }
}
