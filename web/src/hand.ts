// The hand: what a pointer, the keyboard's cursor or a gamepad does to the organ with the chosen tool. Each of them says
// only at which pixel it is.
//
// Press: a mouse cannot push back, so the depth is held and the force is what changes. Holding presses the surface in
// along its normal by the chosen depth (a pen's own pressure scales it); stroking moves the fingertip along at that
// depth, and the force read-out rises where something stiff lies below: how a hand examines. Picked on the surface at
// rest, so that the dent under the finger does not steer it.
// Pull: takes hold of the point under the pixel and moves it in the plane of the picture.
// Grasp: two jaws left and right of it, brought together by the chosen amount; they move as one.
// Needle: enters under the pixel and stays; the chosen depth drives it.
import { HOLD, NEEDLES, type Commands } from "./commands";
import { add, at, atMost, dot, length, minus, pick, times, unit, type Hit } from "./geometry";
import { NEEDLE } from "./instruments";
import type { Organ } from "./link";
import type { Vector } from "./messages";
import type { View } from "./view";

export type Kind = "press" | "pull" | "grasp" | "needle";
export const KINDS: Kind[] = ["press", "pull", "grasp", "needle"];
/** The tools that a kind moves, by number. */
export const SLOTS: Record<Kind, number[]> = { press: [0], pull: [0], grasp: [0, 1], needle: [NEEDLE] };

interface Jaw {
  hit: Hit;
  point: Vector; // mm, at rest
  closing: Vector; // unit vector towards the other jaw; zero of a single one
}
interface Grip {
  jaws: Jaw[];
  start: Vector; // mm, where it was taken, as drawn
  share: number; // of the way that the patch's mean goes, so that the point itself arrives
}
interface Piercing {
  point: Vector;
  inward: Vector;
  along: Vector; // the eye's ray
}

export class Hand {
  kind: Kind = "press";
  inward = true; // the needle goes along the normal, else along the eye's ray
  readonly amounts: Record<Kind, number> = { press: 1, pull: 0, grasp: 1, needle: 0 }; // mm
  private organ: Organ | null = null;
  private grip: Grip | null = null;
  private spot: Hit | null = null; // where the press is, on the surface at rest
  private piercing: Piercing | null = null;
  private aiming = false; // the needle's entry still follows
  private pressure = 1;
  private share = 0.85; // of the last pull: the next one starts with it
  private place: [number, number] = [0, 0];

  constructor(private readonly view: View, private readonly commands: Commands) {}

  show(organ: Organ): void {
    this.letGoOfAll();
    this.organ = organ;
  }

  /** The organ's surface under a pixel: as drawn, or at rest. */
  under(x: number, y: number, rest = false): Hit | null {
    if (!this.organ) return null;
    const { origin, direction } = this.view.turntable.ray(...this.view.toView(x, y));
    return this.met(origin, direction, rest);
  }

  private met(origin: Vector, direction: Vector, rest: boolean): Hit | null {
    const { scene, triangles, rest: home } = this.organ!;
    const skin = scene.parts.find((p) => !p.inside)!;
    return pick(origin, direction, rest ? home : this.view.positions, triangles, skin.first, skin.count);
  }

  /** Where a point of the surface is drawn, and its normal at rest. */
  drawnAt(hit: Hit): { place: Vector; normal: Vector } {
    const { triangles, normals } = this.organ!;
    return { place: at(hit, this.view.positions, triangles), normal: at(hit, normals, triangles) };
  }

  /** Does the hand hold something that it must let go of? */
  get busy(): boolean {
    return this.spot !== null || this.grip !== null;
  }
  get pressing(): boolean {
    return this.spot !== null;
  }
  get pierced(): boolean {
    return this.piercing !== null;
  }

  /** Where the material point that is held is drawn, mm. */
  get held(): Vector | null {
    if (!this.organ) return null;
    if (this.spot) return at(this.spot, this.view.positions, this.organ.triangles);
    return this.grip ? this.middle(this.grip.jaws) : null;
  }

  private middle(jaws: Jaw[]): Vector {
    const sum = jaws.map(({ hit }) => at(hit, this.view.positions, this.organ!.triangles)).reduce(add);
    return times(sum, 1 / jaws.length);
  }

  /** Takes hold at a pixel; says whether there was something. other: pulls where it would press, and the other way. */
  take(x: number, y: number, stamp: number, other = false): boolean {
    const hit = this.organ && !this.organ.scene.replay ? this.under(x, y) : null;
    if (!hit) return false;
    this.place = [x, y];
    const kind = other && this.kind === "press" ? "pull" : other && this.kind === "pull" ? "press" : this.kind;
    if (kind === "press") this.spot = this.under(x, y, true) ?? hit;
    else if (kind === "needle") this.pierce(hit);
    else {
      const jaws = kind === "pull" ? [this.jaw(hit)] : this.jaws(hit);
      this.grip = { jaws, start: this.drawnAt(hit).place, share: this.share };
    }
    this.command(stamp);
    return true;
  }

  private jaw(hit: Hit, closing: Vector = [0, 0, 0]): Jaw {
    return { hit, point: at(hit, this.organ!.rest, this.organ!.triangles), closing };
  }

  /** Left and right of a point, far enough apart that their patches do not overlap, on the surface that the eye sees;
   * where it ends on one side, the nearest point of the surface. */
  private jaws(hit: Hit): Jaw[] {
    const { turntable } = this.view, middle = this.drawnAt(hit).place;
    const apart = 1.25 * this.organ!.scene.radius;
    const jaws = [-1, 1].map((side) => {
      const aim = add(middle, times(turntable.right, side * apart));
      const eye = turntable.eye, ray = unit(minus(aim, eye));
      return this.jaw(this.met(eye, ray, false) ?? this.nearest(aim));
    });
    const across = unit(minus(jaws[1].point, jaws[0].point));
    return [{ ...jaws[0], closing: across }, { ...jaws[1], closing: times(across, -1) }];
  }

  /** The corner of the drawn surface that is nearest to a place. */
  private nearest(place: Vector): Hit {
    const { triangles, scene } = this.organ!, { positions } = this.view;
    const skin = scene.parts.find((p) => !p.inside)!;
    let best = 0, least = Infinity;
    for (let corner = 3 * skin.first; corner < 3 * (skin.first + skin.count); corner++) {
      const n = 3 * triangles[corner];
      const far = (positions[n] - place[0]) ** 2 + (positions[n + 1] - place[1]) ** 2 + (positions[n + 2] - place[2]) ** 2;
      if (far < least) (least = far), (best = corner);
    }
    const weights: Vector = [0, 0, 0];
    weights[best % 3] = 1;
    return { triangle: Math.floor(best / 3), weights, distance: 0 };
  }

  private pierce(hit: Hit): void {
    const { rest, triangles, normals } = this.organ!;
    const { direction } = this.view.turntable.ray(...this.view.toView(...this.place));
    if (this.piercing) this.withdraw();
    this.piercing = { point: at(hit, rest, triangles), inward: times(unit(at(hit, normals, triangles)), -1), along: direction };
    this.amounts.needle = 0;
    this.aiming = true;
  }

  /** The pixel moves. pressure: of a pen, 1 is as chosen. */
  follow(x: number, y: number, stamp: number, pressure = 1): void {
    this.place = [x, y];
    this.pressure = pressure;
    if (this.spot) this.spot = this.under(x, y, true) ?? this.spot; // off the edge: stays
    else if (this.aiming && this.amounts.needle === 0) {
      const hit = this.under(x, y);
      if (hit) this.pierce(hit);
    }
    this.command(stamp);
  }

  /** The chosen depth, pinch or way of a tool, mm. */
  amount(kind: Kind, mm: number, stamp = performance.now()): void {
    this.amounts[kind] = mm;
    if (kind === "needle" && this.piercing) this.drive(stamp);
    else this.command(stamp);
  }

  /** The needle's way has changed. */
  point(inward: boolean): void {
    this.inward = inward;
    this.drive(performance.now());
  }

  private command(stamp: number): void {
    if (!this.organ) return;
    const { rest, triangles, normals, scene } = this.organ, most = 0.999 * scene.reach;
    if (this.spot) {
      const normal = unit(at(this.spot, normals, triangles));
      const way = times(normal, -this.amounts.press * this.pressure);
      this.commands.send(0, HOLD, at(this.spot, rest, triangles), atMost(way, most), stamp);
    } else if (this.grip) {
      const { jaws, share } = this.grip, moved = times(this.moved(this.grip), share);
      jaws.forEach(({ point, closing }, i) => {
        const way = add(moved, times(closing, this.amounts.grasp / 2));
        this.commands.send(i, HOLD, point, atMost(way, most), stamp);
      });
    } else if (this.aiming) this.drive(stamp);
  }

  private drive(stamp: number): void {
    if (!this.piercing || !this.organ) return;
    const { point, inward, along } = this.piercing;
    const deep = Math.max(0.05, Math.min(this.amounts.needle, 0.999 * this.organ.scene.reach)); // a needle has a direction
    this.commands.send(NEEDLE, NEEDLES, point, times(this.inward ? inward : along, deep), stamp);
  }

  /** A frame was drawn. What the tool moves is the mean over its patch, of which the point under the pixel moves a
   * little more: the way is shortened until that point is where the pixel is. */
  drawn(): void {
    const { grip, held } = this;
    if (!grip || !held) return;
    const wanted = this.moved(grip), way = length(wanted);
    if (way < 0.02 * this.view.size) return;
    const from = times(grip.jaws.map((jaw) => jaw.point).reduce(add), 1 / grip.jaws.length);
    const gone = dot(minus(held, from), wanted) / (way * way);
    if (Math.abs(gone - 1) < 0.01) return;
    this.share = grip.share = Math.max(0.6, Math.min(1.1, grip.share - 0.15 * (gone - 1)));
    this.command(performance.now());
  }

  /** From where the point was taken to the pixel, in the plane of the picture through it, and towards the eye. */
  private moved(grip: Grip): Vector {
    const { turntable } = this.view;
    const { origin, direction } = turntable.ray(...this.view.toView(...this.place));
    const forward = turntable.forward;
    const along = dot(minus(grip.start, origin), forward) / dot(direction, forward);
    const aside = minus(add(origin, times(direction, along)), grip.start);
    return grip.jaws.length > 1 ? aside : add(aside, times(direction, -this.amounts.pull));
  }

  /** The finger is lifted: a needle stays, all else lets go. */
  release(): void {
    this.aiming = false;
    if (!this.busy) return;
    this.grip = this.spot = null;
    this.commands.away(0);
    this.commands.away(1);
  }

  /** The needle goes out. */
  withdraw(): void {
    this.piercing = null;
    this.aiming = false;
    this.commands.away(NEEDLE);
  }

  letGoOfAll(): void {
    this.release();
    this.withdraw();
  }
}
