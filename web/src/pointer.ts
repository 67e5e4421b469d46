// Mouse, pen and fingers on the organ's canvas. On the organ a pointer is the hand; beside it, or with another button or
// a second finger, it turns the view.
import type { Hand } from "./hand";
import type { View } from "./view";

const FOLLOWS_EVERY = 6; // ms

export class Pointer {
  private touching: number | null = null; // the pointer that is the hand
  private last: [number, number] = [0, 0];
  private followed = 0; // ms, when the hand last followed
  private readonly turning = new Map<number, [number, number]>();

  /** hovers: told of the pixel that nothing is done at; drive: by so many notches of the wheel. */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly view: View,
    private readonly hand: Hand,
    private readonly hovers: (x: number, y: number) => boolean,
    private readonly drive: (notches: number) => void,
  ) {
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    // Moves come once a picture; raw, as they happen: the tissue answers up to a picture sooner.
    canvas.addEventListener("pointerrawupdate", (event) => {
      const raw = event as PointerEvent;
      if (raw.pointerId === this.touching && raw.timeStamp - this.followed > FOLLOWS_EVERY) this.follow(raw);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const)
      canvas.addEventListener(end, (event) => this.up(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
  }

  private down(event: PointerEvent): void {
    const { clientX: x, clientY: y } = event;
    this.canvas.setPointerCapture(event.pointerId);
    const free = event.button === 0 && !this.turning.size && this.touching === null && !this.hand.busy;
    if (free && this.hand.take(x, y, event.timeStamp, event.shiftKey)) {
      this.touching = event.pointerId;
      this.followed = event.timeStamp;
      this.last = [x, y];
    } else {
      if (this.touching !== null && event.pointerType === "touch") {
        this.turning.set(this.touching, this.last); // a second finger: both turn now
        this.release();
      }
      this.turning.set(event.pointerId, [x, y]);
    }
    this.canvas.classList.add("busy");
  }

  private move(event: PointerEvent): void {
    const { clientX: x, clientY: y } = event;
    if (event.pointerId === this.touching) {
      if (event.timeStamp > this.followed) this.follow(event);
    } else if (this.turning.has(event.pointerId)) this.turn(event);
    else if (!event.buttons) this.canvas.classList.toggle("over", this.hovers(x, y));
  }

  private follow(event: PointerEvent): void {
    this.last = [event.clientX, event.clientY];
    this.followed = event.timeStamp;
    const pressure = event.pointerType === "pen" && event.pressure > 0 ? Math.min(2 * event.pressure, 1.5) : 1;
    this.hand.follow(...this.last, event.timeStamp, pressure);
  }

  private up(event: PointerEvent): void {
    if (event.pointerId === this.touching) this.release();
    this.turning.delete(event.pointerId);
    if (this.touching === null && !this.turning.size) this.canvas.classList.remove("busy");
  }

  /** The pointer lets go. */
  release(): void {
    if (this.touching === null) return;
    this.touching = null;
    this.hand.release();
  }

  private turn(event: PointerEvent): void {
    const before = this.turning.get(event.pointerId)!;
    const others = [...this.turning].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    const dx = event.clientX - before[0], dy = event.clientY - before[1];
    const { turntable } = this.view, height = this.canvas.clientHeight;
    if (others.length) {
      const apart = (x: number, y: number) => Math.hypot(x - others[0][0], y - others[0][1]) || 1;
      turntable.zoom(apart(...before) / apart(event.clientX, event.clientY));
      turntable.turn(dx / 2, dy / 2, height);
    } else if (event.buttons & 4 || event.shiftKey) turntable.shift(dx, dy, height);
    else turntable.turn(dx, dy, height);
    this.turning.set(event.pointerId, [event.clientX, event.clientY]);
    this.view.touched();
  }

  /** Over a tool at work the wheel drives it, else it zooms. */
  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const notches = -event.deltaY / (event.deltaMode === 0 ? 100 : 3);
    const driven = this.hand.busy || (this.hand.kind === "needle" && this.hand.pierced);
    if (driven) return this.drive(notches);
    this.view.turntable.zoom(Math.exp(-0.12 * notches));
    this.view.touched();
  }
}
