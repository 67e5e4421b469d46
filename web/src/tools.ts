// From pointer events to commands. On the organ a pointer is the tool; beside it, or with another button or a second
// finger, it turns the view.
//
// Press: a mouse cannot push back, so the depth is held and the force is what changes. Holding presses the surface in
// along its normal by the chosen depth (a pen's own pressure scales it); stroking moves the fingertip along at that
// depth, and the force read-out rises where something stiff lies below: how a hand examines. Picked on the surface at
// rest, so that the dent under the finger does not steer it.
// Pull: takes hold of the point under the pointer and moves it in the plane of the picture; the wheel moves it away or
// nearer.
import { add, at, atMost, dot, length, minus, pick, times, type Hit } from "./geometry";
import type { Organ } from "./link";
import type { Tool, Vector } from "./messages";
import type { View } from "./view";

export type Kind = "press" | "pull";

interface Pull {
  hit: Hit;
  point: Vector; // mm, at rest
  start: Vector; // mm, where it was taken
  away: number; // mm, along the eye's ray
  share: number; // of the way that the patch's mean goes, so that the point itself arrives
}

export class Tools {
  kind: Kind = "press";
  private organ: Organ | null = null;
  private serial = 0;
  private touching: number | null = null; // the pointer that is the tool
  private pull: Pull | null = null;
  private spot: Hit | null = null; // where the press is, on the surface at rest
  private pressure = 1;
  private share = 0.85; // of the last pull: the next one starts with it
  private last: PointerEvent | null = null;
  private readonly turning = new Map<number, [number, number]>();
  private depthSet = 1; // mm

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly view: View,
    private readonly send: (tool: Tool) => void,
    private readonly setDepth: (mm: number) => void,
  ) {
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const)
      canvas.addEventListener(end, (event) => this.up(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
  }

  show(organ: Organ): void {
    this.release();
    this.organ = organ;
  }

  /** How deep the press tool presses, mm. */
  set depth(mm: number) {
    this.depthSet = mm;
    this.command();
  }

  /** The organ's surface under a pixel: as drawn, or at rest. */
  under(x: number, y: number, rest = false): Hit | null {
    if (!this.organ) return null;
    const { origin, direction } = this.view.turntable.ray(...this.view.toView(x, y));
    const skin = this.organ.scene.parts.find((p) => !p.inside)!;
    const positions = rest ? this.organ.rest : this.view.positions;
    return pick(origin, direction, positions, this.organ.triangles, skin.first, skin.count);
  }

  /** Where the material point that is held is drawn, mm. */
  get held(): Vector | null {
    const hit = this.pull?.hit ?? this.spot;
    return hit && this.organ ? at(hit, this.view.positions, this.organ.triangles) : null;
  }

  private down(event: PointerEvent): void {
    const hit = event.button === 0 && !this.turning.size ? this.under(event.clientX, event.clientY) : null;
    this.canvas.setPointerCapture(event.pointerId);
    if (this.touching === null && hit && this.organ && !this.organ.scene.replay) this.take(event, hit);
    else {
      if (this.touching !== null && this.last && event.pointerType === "touch") {
        this.turning.set(this.touching, [this.last.clientX, this.last.clientY]); // a second finger: both turn now
        this.release();
      }
      this.turning.set(event.pointerId, [event.clientX, event.clientY]);
    }
    this.canvas.classList.add("busy");
  }

  private take(event: PointerEvent, hit: Hit): void {
    this.touching = event.pointerId;
    const { rest, triangles } = this.organ!;
    const pulls = (this.kind === "pull") !== event.shiftKey;
    if (pulls) {
      this.pull = { hit, point: at(hit, rest, triangles), start: at(hit, this.view.positions, triangles), away: 0, share: this.share };
    } else this.spot = this.under(event.clientX, event.clientY, true) ?? hit;
    this.follow(event);
  }

  private move(event: PointerEvent): void {
    if (event.pointerId === this.touching) return this.follow(event);
    if (!this.turning.has(event.pointerId)) {
      if (!event.buttons) this.canvas.classList.toggle("over", this.under(event.clientX, event.clientY) !== null);
      return;
    }
    this.turn(event);
  }

  private follow(event: PointerEvent): void {
    this.last = event;
    this.pressure = event.pointerType === "pen" && event.pressure > 0 ? Math.min(2 * event.pressure, 1.5) : 1;
    if (this.spot) this.spot = this.under(event.clientX, event.clientY, true) ?? this.spot; // off the edge: stays
    this.command();
  }

  private command(): void {
    if (!this.organ || this.touching === null) return;
    const { rest, triangles, normals, scene } = this.organ;
    let point: Vector, displacement: Vector;
    if (this.pull) {
      point = this.pull.point;
      displacement = times(this.pulled(this.pull), this.pull.share);
    } else if (this.spot) {
      point = at(this.spot, rest, triangles);
      const normal = at(this.spot, normals, triangles);
      displacement = times(normal, (-this.depthSet * this.pressure) / (Math.hypot(...normal) || 1));
    } else return;
    this.send({ held: 1, serial: ++this.serial, point, displacement: atMost(displacement, 0.999 * scene.reach) });
  }

  /** A frame was drawn. What the tool moves is the mean over its patch, of which the point under the pointer moves a
   * little more: the way is shortened until that point is where the pointer is. */
  drawn(): void {
    const { pull, held } = this;
    if (!pull || !held) return;
    const wanted = this.pulled(pull);
    const way = length(wanted);
    if (way < 0.02 * this.view.size) return;
    const gone = dot(minus(held, pull.point), wanted) / (way * way);
    if (Math.abs(gone - 1) < 0.01) return;
    this.share = pull.share = Math.max(0.6, Math.min(1.1, pull.share - 0.15 * (gone - 1)));
    this.command();
  }

  /** Is the press tool pressing? */
  get pressing(): boolean {
    return this.spot !== null;
  }

  /** From where the point was taken to the pointer, in the plane of the picture through it. */
  private pulled(pull: Pull): Vector {
    const { turntable } = this.view;
    const { origin, direction } = turntable.ray(...this.view.toView(this.last!.clientX, this.last!.clientY));
    const forward = turntable.forward;
    const along = dot(minus(pull.start, origin), forward) / dot(direction, forward);
    return add(minus(add(origin, times(direction, along)), pull.start), times(direction, pull.away));
  }

  private up(event: PointerEvent): void {
    if (event.pointerId === this.touching) this.release();
    this.turning.delete(event.pointerId);
    if (this.touching === null && !this.turning.size) this.canvas.classList.remove("busy");
  }

  /** Lets go. */
  release(): void {
    if (this.touching === null) return;
    this.touching = this.pull = this.spot = this.last = null;
    this.send({ held: 0, serial: ++this.serial, point: [0, 0, 0], displacement: [0, 0, 0] });
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

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const notches = -event.deltaY / (event.deltaMode === 0 ? 100 : 3);
    const step = 0.02 * this.view.size;
    if (this.pull) {
      this.pull.away += step * notches;
      this.command();
    } else if (this.spot) this.setDepth(this.depthSet + 0.5 * step * notches);
    else {
      this.view.turntable.zoom(Math.exp(-0.12 * notches));
      this.view.touched();
    }
  }
}
