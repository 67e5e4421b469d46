// The hand without a pointer: a cursor on the surface, moved by arrow keys or a gamepad's stick.
import type { Hand } from "./hand";
import type { Hit } from "./geometry";
import type { View } from "./view";

export class Cursor {
  private hit: Hit | null = null; // where it rests on the surface
  private place: [number, number] | null = null; // pixel of what it holds

  constructor(private readonly canvas: HTMLCanvasElement, private readonly view: View, private readonly hand: Hand) {}

  /** Shows it, in the middle of the organ at first. */
  show(): boolean {
    this.hit ??= this.first();
    this.draw();
    return this.hit !== null;
  }

  hide(): void {
    if (this.view.instruments.cursor(null)) this.view.touched();
  }

  /** Another organ: the old place means nothing. */
  forget(): void {
    this.hit = this.place = null;
    this.hide();
  }

  /** Is it on show? Then it moves with the surface. */
  draw(): void {
    if (!this.hit || this.place) return this.hide();
    const { place, normal } = this.hand.drawnAt(this.hit);
    if (this.view.instruments.cursor(place, normal)) this.view.touched();
  }

  /** Where it is in the window. */
  get pixel(): [number, number] | null {
    if (this.place) return this.place;
    return this.hit ? this.view.toPixel(this.hand.drawnAt(this.hit).place) : null;
  }

  /** By so many pixels; a free cursor does not leave the organ. */
  move(dx: number, dy: number): void {
    if (!this.show() && !this.place) return;
    const [x, y] = this.pixel!, stamp = performance.now();
    if (this.place) {
      this.place = [x + dx, y + dy];
      this.hand.follow(...this.place, stamp);
    } else {
      this.hit = this.hand.under(x + dx, y + dy) ?? this.hit;
      this.draw();
    }
  }

  /** How hard it presses, 1 is as chosen. */
  press(pressure: number): void {
    if (this.place) this.hand.follow(...this.place, performance.now(), pressure);
  }

  get holds(): boolean {
    return this.place !== null && this.hand.busy;
  }

  /** Takes hold with the chosen tool. */
  take(): void {
    if (this.hand.busy || !this.show()) return;
    const pixel = this.pixel!;
    if (!this.hand.take(...pixel, performance.now())) return;
    if (this.hand.busy) this.place = pixel;
    else this.hand.release(); // a needle stays by itself
    this.draw();
  }

  release(): void {
    if (!this.place) return;
    const [x, y] = this.place;
    this.place = null;
    this.hand.release();
    this.hit = this.hand.under(x, y) ?? this.hit;
    this.draw();
  }

  /** The surface under the middle of the picture, or else what is nearest to it. */
  private first(): Hit | null {
    const box = this.canvas.getBoundingClientRect();
    const middle: [number, number] = [box.left + box.width / 2, box.top + box.height / 2];
    for (let far = 0; far < Math.min(box.width, box.height) / 2; far += 12)
      for (const [x, y] of [[0, -far], [0, far], [-far, 0], [far, 0]]) {
        const hit = this.hand.under(middle[0] + x, middle[1] + y);
        if (hit) return hit;
      }
    return null;
  }
}
