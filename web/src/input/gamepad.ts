// A gamepad in the standard layout (W3C Gamepad): the left stick moves the cursor, the right stick rotates the view, the
// right trigger holds (the press tool as deep as it is pulled). The shoulder buttons select the tool, the D-pad changes
// its amount.
import type { SurfaceCursor } from "./surface-cursor";
import type { ToolController } from "../tools/tool-controller";
import type { OrganView } from "../rendering/organ-view";

const DEAD_ZONE = 0.15; // of a stick
const SPEED = 0.5; // canvas heights per second
const STEPS_PER_SECOND = 6; // of the amount
const LEFT_SHOULDER = 4, RIGHT_SHOULDER = 5, TRIGGER = 7, UP = 12, DOWN = 13;
const TRIGGER_THRESHOLD = 0.06;

export interface GamepadActions {
  changeAmount(steps: number): void;
  selectTool(by: number): void;
  mark(button: number): void;
}

export class GamepadInput {
  private lastPoll = performance.now();
  private pressed: boolean[] = [];

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly view: OrganView,
    private readonly controller: ToolController,
    private readonly cursor: SurfaceCursor,
    private readonly actions: GamepadActions,
  ) {}

  /** Called once a frame: reads the first gamepad. */
  poll(now: number): void {
    const seconds = Math.min(0.05, (now - this.lastPoll) / 1000);
    this.lastPoll = now;
    const pad = navigator.getGamepads?.().find((each) => each?.connected && each.mapping === "standard");
    if (!pad) {
      if (this.pressed[TRIGGER]) this.cursor.release(); // disconnected while it held
      this.pressed = [];
      return;
    }
    const distance = seconds * SPEED * this.canvas.clientHeight;
    const [x, y, turnX, turnY] = pad.axes.map((value) => (Math.abs(value) > DEAD_ZONE ? value : 0));
    if (x || y) this.cursor.move(distance * x, distance * y);
    if (turnX || turnY) {
      this.view.turntable.rotate(1.6 * distance * turnX, 1.6 * distance * turnY, this.canvas.clientHeight);
      this.view.requestRedraw();
    }
    this.readTrigger(pad.buttons[TRIGGER]?.value ?? 0);
    const isDown = (button: number) => pad.buttons[button]?.pressed ?? false;
    if (isDown(UP)) this.actions.changeAmount(STEPS_PER_SECOND * seconds);
    if (isDown(DOWN)) this.actions.changeAmount(-STEPS_PER_SECOND * seconds);
    for (const button of [0, 1, 2, LEFT_SHOULDER, RIGHT_SHOULDER]) {
      if (isDown(button) && !this.pressed[button]) this.onPress(button);
      this.pressed[button] = isDown(button);
    }
  }

  private readTrigger(value: number): void {
    const isDown = value > TRIGGER_THRESHOLD;
    if (isDown && !this.pressed[TRIGGER]) this.cursor.begin();
    if (!isDown && this.pressed[TRIGGER]) this.cursor.release();
    this.pressed[TRIGGER] = isDown;
    if (isDown && this.controller.pressing) this.cursor.press(value);
  }

  private onPress(button: number): void {
    if (button === LEFT_SHOULDER) this.actions.selectTool(-1);
    else if (button === RIGHT_SHOULDER) this.actions.selectTool(1);
    else this.actions.mark(button);
  }
}
