// A cursor on the surface for input without a pointer: moved by arrow keys or the stick of a gamepad.
import type { ToolController } from "../tools/tool-controller";
import type { Hit } from "../organ/mesh-geometry";
import type { OrganView } from "../rendering/organ-view";

export class SurfaceCursor {
  private hit: Hit | null = null; // its point of the surface
  private heldPixel: [number, number] | null = null; // while its tool holds the tissue

  constructor(private readonly canvas: HTMLCanvasElement, private readonly view: OrganView, private readonly controller: ToolController) {}

  /** Shows it, at first in the middle of the organ. Returns whether it has a place. */
  show(): boolean {
    if (this.controller.kind === "camera") return this.hide(), false;
    this.hit ??= this.firstHit();
    this.draw();
    return this.hit !== null;
  }

  hide(): void {
    if (this.view.toolMeshes.setCursor(null)) this.view.requestRedraw();
  }

  /** Forgets its place, since another organ is shown. */
  clear(): void {
    this.hit = this.heldPixel = null;
    this.hide();
  }

  /** The organ was cut: what is held is held on. */
  followCut(): void {
    this.hit = null;
    if (!this.heldPixel) this.hide();
  }

  /** Draws it where its point of the surface is now. */
  draw(): void {
    if (!this.hit || this.heldPixel) return this.hide();
    const { position, normal } = this.controller.drawnPoint(this.hit);
    if (this.view.toolMeshes.setCursor(position, normal)) this.view.requestRedraw();
  }

  /** Its pixel in the window. */
  get pixel(): [number, number] | null {
    if (this.heldPixel) return this.heldPixel;
    return this.hit ? this.view.toPixel(this.controller.drawnPoint(this.hit).position) : null;
  }

  /** Moves it by so many pixels. While it holds nothing, it stays on the organ. */
  move(dx: number, dy: number): void {
    if (this.controller.kind === "camera") { // it turns its head
      this.view.turntable.rotate(-dx, -dy, this.canvas.clientHeight);
      return this.view.requestRedraw();
    }
    if (!this.show() && !this.heldPixel) return;
    const [x, y] = this.pixel!, stamp = performance.now();
    if (this.heldPixel) {
      this.heldPixel = [x + dx, y + dy];
      this.controller.moveTo(...this.heldPixel, stamp);
    } else {
      this.hit = this.controller.pick(x + dx, y + dy) ?? this.hit;
      this.draw();
    }
  }

  /** Sets the pressure, relative to the selected depth. */
  press(pressure: number): void {
    if (this.heldPixel) this.controller.moveTo(...this.heldPixel, performance.now(), pressure);
  }

  get holding(): boolean {
    return this.heldPixel !== null && this.controller.holding;
  }

  /** Begins with the selected tool. */
  begin(): void {
    if (this.controller.holding || !this.show()) return;
    const pixel = this.pixel!;
    if (!this.controller.begin(...pixel, performance.now())) return;
    if (this.controller.holding) this.heldPixel = pixel;
    else this.controller.release(); // a needle stays inserted
    this.draw();
  }

  release(): void {
    if (!this.heldPixel) return;
    const [x, y] = this.heldPixel;
    this.heldPixel = null;
    this.controller.release();
    this.hit = this.controller.pick(x, y) ?? this.hit;
    this.draw();
  }

  /** The surface in the middle of the picture, or the nearest to it. */
  private firstHit(): Hit | null {
    const box = this.canvas.getBoundingClientRect();
    const middle: [number, number] = [box.left + box.width / 2, box.top + box.height / 2];
    for (let distance = 0; distance < Math.min(box.width, box.height) / 2; distance += 12)
      for (const [x, y] of [[0, -distance], [0, distance], [-distance, 0], [distance, 0]]) {
        const hit = this.controller.pick(middle[0] + x, middle[1] + y);
        if (hit) return hit;
      }
    return null;
  }
}
