// What a page of a replay has beyond others: the timeline, its keys, and a second organ.
import type { ColorMode, FromWorker } from "../protocol/worker-messages";
import type { Frame, Play } from "../protocol/server-messages";
import type { OrganView } from "../rendering/organ-view";
import { Timeline } from "../ui/timeline";
import { SecondOrgan } from "./second-organ";

export class ReplayControls {
  private readonly timeline: Timeline;
  private second: SecondOrgan | null = null; // of a second replay
  readonly keys: Record<string, () => void>;

  /** addresses: of the scene and the socket of the second replay. */
  constructor(view: OrganView, send: (play: Play) => void, addresses: () => [scene: string, socket: string]) {
    const timeline = (this.timeline = new Timeline((step, value) => send({ step, value }), (count) => {
      if (count > 1) this.second ??= new SecondOrgan(view, ...addresses());
    }));
    this.keys = {
      p: () => timeline.toggle(),
      j: () => timeline.skip(-1),
      l: () => timeline.skip(1),
      ",": () => timeline.toEvent(-1),
      ".": () => timeline.toEvent(1),
      "[": () => timeline.changeSpeed(-1),
      "]": () => timeline.changeSpeed(1),
    };
  }

  /** Whether a teacher plays, and this page follows. */
  set following(on: boolean) {
    this.timeline.following = on;
  }

  take(message: Extract<FromWorker, { kind: "timeline" | "position" }>): void {
    if (message.kind === "timeline") this.timeline.show(message.tracks);
    else this.timeline.setPosition(message.position);
  }

  update(frame: Frame): void {
    this.timeline.update(frame.tick);
  }
  /** The view of the second organ, if there is one. */
  get views(): OrganView[] {
    return this.second ? [this.second.view] : [];
  }
  draw(): void {
    this.second?.draw();
  }
  /** The second organ is drawn as the first one. */
  set wireframe(on: boolean) {
    if (this.second) this.second.view.drawWireframe = on;
  }
  set translucent(on: boolean) {
    if (this.second) this.second.view.drawTranslucent = on;
  }
  show(mode: ColorMode): void {
    this.second?.show(mode);
  }
  /** Of the second replay; null without one. */
  get secondFrame(): Frame | null {
    return this.second?.frame ?? null;
  }
}
