// The slices that the organ was made from, beside it, with the tool's place in them: `palpate view`'s panes, small.
import { element, write } from "./controls";
import type { Album, Vector } from "./messages";
import { Gestures } from "./slices/gestures";
import { Pane } from "./slices/pane";
import { NAMES } from "./slices/planes";
import { fresh, State } from "./slices/state";
import { fetchValues, Stored } from "./slices/stored";

const EVERY = 40; // ms between drawings of one pane

export class Beside {
  private state: State | null = null;
  private panes: Pane[] = [];
  private stale = new Set<Pane>();
  private drawnAt = 0;
  private asked = false;
  private box: { centre: Vector; size: number } = { centre: [0, 0, 0], size: 1 };

  constructor(private readonly token: string) {
    element("slices-preset").addEventListener("change", () => {
      const { state } = this;
      if (state) state.preset(state.side, element<HTMLSelectElement>("slices-preset").value);
    });
  }

  /** Looks at this ball. */
  frame(centre: Vector, size: number): void {
    this.box = { centre, size };
    this.aim();
  }

  /** Shows or hides; what is shown first is fetched now. */
  set shown(on: boolean) {
    element("beside").hidden = !on;
    if (on && !this.asked) {
      this.asked = true;
      this.open().catch((problem: unknown) => {
        this.asked = false;
        write("slices-status", problem instanceof Error ? problem.message : String(problem));
      });
    }
    this.all();
  }

  private async open(): Promise<void> {
    const answer = await fetch(`album?${this.token}`);
    if (!answer.ok) throw new Error(await answer.text());
    const image = ((await answer.json()) as Album).images[0], stack = image.stacks[0];
    const told = (share: number) => write("slices-status", `Loading slices, ${Math.round(100 * share)} %`);
    const stored = new Stored(image, stack, await fetchValues(`values/0/0?${this.token}`, image, stack, told));
    const state = (this.state = new State([fresh(image, stored)], () => this.all()));
    this.panes = NAMES.map((name) => new Pane(state, 0, name));
    for (const pane of this.panes) new Gestures(pane, state, () => this.aim());
    element("slices").replaceChildren(...this.panes.map((pane) => pane.element));
    element("slices-preset").replaceChildren(...stack.windows.map((window) => new Option(window.name)));
    new ResizeObserver(() => this.all()).observe(element("slices"));
    write("slices-status", image.note);
    this.aim();
  }

  private aim(): void {
    if (!this.state) return;
    const { state } = this, { side } = state, { centre, size } = this.box;
    const whole = Math.max(...side.stored.shape.map((n, axis) => n * side.stored.spacing[axis]));
    for (const name of NAMES) {
      side.centre[name] = [...centre];
      side.zoom[name] = Math.max(1, whole / (2.6 * size));
    }
    state.cross(side, centre);
  }

  private all(): void {
    for (const pane of this.panes) this.stale.add(pane);
  }

  /** The tool is here, mm. Nothing changes while it stays in its voxel. */
  at(point: Vector): void {
    const { state } = this;
    if (!state || element("beside").hidden) return;
    const { stored, cross } = state.side;
    const here = stored.nearest(stored.index(point)), before = stored.nearest(stored.index(cross));
    if (here.some((i, axis) => i !== before[axis])) state.cross(state.side, point);
  }

  /** One pane at a time, so that the organ's picture is never late for them. */
  draw(now: number): void {
    if (now - this.drawnAt < EVERY / this.panes.length || element("beside").hidden) return;
    const [pane] = this.stale;
    if (!pane) return;
    this.stale.delete(pane);
    pane.draw();
    this.drawnAt = now;
  }

  /** Where the crosshair is, mm; null without slices. */
  get cross(): Vector | null {
    return this.state ? [...this.state.side.cross] : null;
  }
}
