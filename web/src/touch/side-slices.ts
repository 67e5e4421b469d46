// Slices of the images that the organ was made from, with a crosshair at the tool: small panes of `palpate view`.
import { element, write } from "../ui/controls";
import type { Album, Vector } from "../protocol/server-messages";
import { Gestures } from "../slices/gestures";
import { Pane } from "../slices/pane";
import { NAMES } from "../slices/planes";
import { initialSide, ViewState } from "../slices/view-state";
import { fetchValues, ImageSource } from "../slices/image-source";

const REDRAW_INTERVAL = 40; // ms, of one pane

export class SideSlices {
  private state: ViewState | null = null;
  private panes: Pane[] = [];
  private outdated = new Set<Pane>();
  private lastDraw = 0; // ms
  private requested = false;
  private organ: { center: Vector; size: number } = { center: [0, 0, 0], size: 1 };

  constructor(private readonly token: string) {
    element("slices-preset").addEventListener("change", () => {
      const { state } = this;
      if (state) state.preset(state.side, element<HTMLSelectElement>("slices-preset").value);
    });
  }

  /** Shows the slices around a sphere. */
  lookAt(center: Vector, size: number): void {
    this.organ = { center, size };
    this.resetView();
  }

  /** Shows or hides the slices; fetches the image the first time. */
  set shown(on: boolean) {
    element("side-slices").hidden = !on;
    if (on && !this.requested) {
      this.requested = true;
      this.open().catch((problem: unknown) => {
        this.requested = false;
        write("slices-status", problem instanceof Error ? problem.message : String(problem));
      });
    }
    this.redrawAll();
  }

  private async open(): Promise<void> {
    const answer = await fetch(`album?${this.token}`);
    if (!answer.ok) throw new Error(await answer.text());
    const image = ((await answer.json()) as Album).images[0], stack = image.stacks[0];
    const onProgress = (share: number) => write("slices-status", `Loading slices, ${Math.round(100 * share)} %`);
    const source = new ImageSource(image, stack, await fetchValues(`values/0/0?${this.token}`, image, stack, onProgress));
    const state = (this.state = new ViewState([initialSide(image, source)], () => this.redrawAll()));
    this.panes = NAMES.map((name) => new Pane(state, 0, name));
    for (const pane of this.panes) new Gestures(pane, state, () => this.resetView());
    element("slices").replaceChildren(...this.panes.map((pane) => pane.element));
    element("slices-preset").replaceChildren(...stack.windows.map((window) => new Option(window.name)));
    new ResizeObserver(() => this.redrawAll()).observe(element("slices"));
    write("slices-status", image.note);
    this.resetView();
  }

  private resetView(): void {
    if (!this.state) return;
    const { state } = this, { side } = state, { center, size } = this.organ;
    const extent = Math.max(...side.source.shape.map((n, axis) => n * side.source.spacing[axis]));
    for (const name of NAMES) {
      side.center[name] = [...center];
      side.zoom[name] = Math.max(1, extent / (2.6 * size));
    }
    state.moveCrosshair(side, center);
  }

  private redrawAll(): void {
    for (const pane of this.panes) this.outdated.add(pane);
  }

  /** Moves the crosshair to a position, mm, if it is in another voxel. */
  moveTo(point: Vector): void {
    const { state } = this;
    if (!state || element("side-slices").hidden) return;
    const { source, crosshair } = state.side;
    const here = source.nearest(source.index(point)), before = source.nearest(source.index(crosshair));
    if (here.some((i, axis) => i !== before[axis])) state.moveCrosshair(state.side, point);
  }

  /** Draws at most one pane, so that the picture of the organ is not delayed. */
  draw(now: number): void {
    if (now - this.lastDraw < REDRAW_INTERVAL / this.panes.length || element("side-slices").hidden) return;
    const [pane] = this.outdated;
    if (!pane) return;
    this.outdated.delete(pane);
    pane.draw();
    this.lastDraw = now;
  }

  /** Position of the crosshair, mm; null without slices. */
  get crosshair(): Vector | null {
    return this.state ? [...this.state.side.crosshair] : null;
  }
}
