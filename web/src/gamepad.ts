// A gamepad in the standard layout (W3C Gamepad): the left stick moves the cursor, the right one turns the view, the right
// trigger takes hold: of the press tool as deep as it is pulled. Bumpers choose the tool, the cross's up and down drive it.
import type { Cursor } from "./cursor";
import type { Hand } from "./hand";
import type { View } from "./view";

const DEAD = 0.15; // of a stick at rest
const SPEED = 0.5; // heights of the canvas a second
const LEFT_BUMPER = 4, RIGHT_BUMPER = 5, TRIGGER = 7, UP = 12, DOWN = 13;
const PULLED = 0.06;

export interface Orders {
  drive(notches: number): void;
  choose(by: number): void;
  mark(button: number): void;
}

export class Gamepads {
  private before = performance.now();
  private down: boolean[] = [];

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly view: View,
    private readonly hand: Hand,
    private readonly cursor: Cursor,
    private readonly orders: Orders,
  ) {}

  /** Once a frame: reads the first gamepad there is. */
  poll(now: number): void {
    const seconds = Math.min(0.05, (now - this.before) / 1000);
    this.before = now;
    const pad = navigator.getGamepads?.().find((each) => each?.connected && each.mapping === "standard");
    if (!pad) {
      if (this.down[TRIGGER]) this.cursor.release(); // unplugged while it held
      this.down = [];
      return;
    }
    const way = seconds * SPEED * this.canvas.clientHeight;
    const [x, y, turnX, turnY] = pad.axes.map((value) => (Math.abs(value) > DEAD ? value : 0));
    if (x || y) this.cursor.move(way * x, way * y);
    if (turnX || turnY) {
      this.view.turntable.turn(1.6 * way * turnX, 1.6 * way * turnY, this.canvas.clientHeight);
      this.view.touched();
    }
    this.pull(pad.buttons[TRIGGER]?.value ?? 0);
    const held = (button: number) => pad.buttons[button]?.pressed ?? false;
    if (held(UP)) this.orders.drive(6 * seconds);
    if (held(DOWN)) this.orders.drive(-6 * seconds);
    for (const button of [0, 1, 2, LEFT_BUMPER, RIGHT_BUMPER]) {
      if (held(button) && !this.down[button]) this.pressed(button);
      this.down[button] = held(button);
    }
  }

  private pull(value: number): void {
    const down = value > PULLED;
    if (down && !this.down[TRIGGER]) this.cursor.take();
    if (!down && this.down[TRIGGER]) this.cursor.release();
    this.down[TRIGGER] = down;
    if (down && this.hand.pressing) this.cursor.press(value);
  }

  private pressed(button: number): void {
    if (button === LEFT_BUMPER) this.orders.choose(-1);
    else if (button === RIGHT_BUMPER) this.orders.choose(1);
    else this.orders.mark(button);
  }
}
