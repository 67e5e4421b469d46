// The view from inside a hollow organ: a camera that one moves, turns, and flies along the centre line. It is a ball that
// the wall holds back, and that presses the wall: see `CollisionSphere`.
import { PerspectiveCamera, Quaternion, Vector3 } from "three";
import { CollisionSphere } from "./collision-sphere";
import { LumenCenterline } from "./lumen-centerline";
import { add, limitLength, scale } from "../organ/mesh-geometry";
import { CommandKind, type Vector } from "../protocol/server-messages";
import type { Organ } from "../protocol/worker-messages";
import type { OrganView } from "../rendering/organ-view";
import { ENDOSCOPE_TOOLS } from "../rendering/tool-meshes";
import type { CommandQueue } from "../tools/command-queue";

const LARGEST = 2.5, OF_LUMEN = 0.4; // mm, and of the lumen's median radius: the ball's radius
const FIELD = 90; // degrees, from top to bottom
const STEP = 0.25; // radii of the lumen: of the wheel and the keys
const SPEED = 2; // radii of the lumen a second: in flight
const REACH = 0.999; // of the longest displacement, since the server gets it rounded

export class Endoscope {
  active = false;
  flying = false;
  centerline: LumenCenterline | null = null;
  branch = 0;
  private start = 0; // mm along the main branch at which it begins: behind the opening
  sphere: CollisionSphere | null = null;
  private organ: Organ | null = null;
  private moved = false;
  private lastFlight = 0; // ms
  private flown = 0; // mm along the branch: the station nearest to the camera comes in steps
  private readonly turn = new Quaternion();

  constructor(private readonly view: OrganView, private readonly commands: CommandQueue, private readonly grasps: () => boolean) {}

  setOrgan(organ: Organ, same: boolean): void {
    this.organ = organ;
    const centerline = new LumenCenterline(organ.scene), before = same ? this.sphere?.position : undefined;
    this.centerline = this.sphere = null;
    if (centerline.isThere) {
      const radius = Math.min(LARGEST, OF_LUMEN * centerline.medianRadius);
      this.start = Math.min(2 * radius, 0.5 * centerline.lengthOf(0));
      this.centerline = centerline;
      this.sphere = new CollisionSphere(organ, before ?? centerline.at(0, this.start).point, radius, centerline.largestRadius);
    }
    if (!this.sphere) this.leave();
    else if (!same) this.goTo(0, this.start);
  }

  enter(): void {
    if (!this.sphere || this.active) return;
    this.active = true;
    this.view.enterEndoscope(this, 3 * this.sphere.radius);
    this.moved = true;
  }

  leave(): void {
    if (!this.active) return;
    this.active = this.flying = false;
    this.release();
    this.view.leaveEndoscope();
  }

  /** Called by the camera of the view: puts it where this one is. */
  place(camera: PerspectiveCamera): void {
    const { position, radius } = this.sphere!;
    camera.position.set(...position);
    camera.quaternion.copy(this.turn);
    camera.fov = FIELD;
    camera.near = 0.05 * radius;
    camera.far = 10 * this.view.size;
  }

  get position(): Vector | null {
    return this.sphere?.position ?? null;
  }
  get radius(): number {
    return this.sphere?.radius ?? 0;
  }
  get forward(): Vector {
    return new Vector3(0, 0, -1).applyQuaternion(this.turn).toArray();
  }

  /** Where it is along the centre line: branch, mm, and mm of the whole branch. */
  get along(): { branch: number; mm: number; length: number } {
    const { branch, mm } = this.centerline!.nearest(this.sphere!.position, this.branch);
    return { branch, mm, length: this.centerline!.lengthOf(branch) };
  }

  /** Goes to a place of the centre line and looks along it. */
  goTo(branch: number, mm: number): void {
    this.branch = branch;
    this.flyTo(mm);
    this.look(this.centerline!.direction(branch, mm));
  }

  private flyTo(mm: number): void {
    const here = this.along, sphere = this.sphere!;
    // Station by station, since the way straight there may lead through a wall.
    if (here.branch === this.branch) {
      const steps = Math.max(1, Math.ceil(Math.abs(mm - here.mm) / sphere.radius));
      for (let i = 1; i <= steps; i++) sphere.moveTo(this.centerline!.at(this.branch, here.mm + ((mm - here.mm) * i) / steps).point);
    } else sphere.position = this.centerline!.at(this.branch, mm).point;
    this.changed();
  }

  /** Turns the view into a direction, its up as near as can be to what it was. */
  look(direction: Vector): void {
    const before = new Vector3(0, 0, -1).applyQuaternion(this.turn), after = new Vector3(...direction);
    this.turn.premultiply(new Quaternion().setFromUnitVectors(before, after));
    this.changed();
  }

  /** Turns by a drag of so many pixels in a window `height` pixels high: what is seen follows the pointer. */
  rotate(dx: number, dy: number, height: number): void {
    this.flying = false;
    const angle = (FIELD * Math.PI) / 180 / height;
    this.turn.multiply(new Quaternion().setFromAxisAngle(new Vector3(0, 1, 0), dx * angle));
    this.turn.multiply(new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), dy * angle));
    this.changed();
  }

  /** Moves sideways by so many pixels. */
  pan(dx: number, dy: number, height: number): void {
    const mm = (2 * this.sphere!.radius) / (0.25 * height), axis = (x: number, y: number) => new Vector3(x, y, 0).applyQuaternion(this.turn).toArray();
    this.move(add(scale(axis(1, 0), -dx * mm), scale(axis(0, 1), dy * mm)));
  }

  /** Forward by so many steps; backward if negative. */
  step(count: number): void {
    const { radius } = this.centerline!.at(this.branch, this.along.mm);
    this.move(scale(this.forward, count * STEP * radius));
  }

  private move(by: Vector): void {
    this.flying = false;
    this.sphere!.moveTo(add(this.sphere!.position, by));
    this.branch = this.along.branch;
    this.changed();
  }

  reset(): void {
    this.flying = false;
    this.goTo(0, this.start);
  }

  fly(on: boolean, now: number): void {
    this.flying = on;
    this.lastFlight = now;
  }

  private changed(): void {
    this.moved = true;
    if (this.active) this.view.placeCamera();
  }

  /** Called once a frame: flies on, and presses the wall where the ball touches it. */
  update(now: number): void {
    if (!this.active || !this.sphere || !this.centerline) return;
    if (this.flying) {
      const { mm, length: end } = this.along, seconds = Math.min(0.1, (now - this.lastFlight) / 1000);
      const after = Math.max(mm, this.flown) + SPEED * this.centerline.at(this.branch, mm).radius * seconds;
      this.lastFlight = now;
      this.flown = after;
      this.flyTo(Math.min(after, end));
      this.look(this.centerline.direction(this.branch, Math.min(after, end)));
      if (after >= end) this.flying = false;
    } else this.flown = 0;
    if (this.moved && !this.organ!.scene.replay) this.press(now);
    this.moved = false;
  }

  private press(now: number): void {
    const presses = this.sphere!.presses(), longest = REACH * this.organ!.scene.reach;
    ENDOSCOPE_TOOLS.forEach((tool, i) => {
      if (i > 0 && this.grasps()) return;
      if (presses[i]) this.commands.send(tool, CommandKind.hold, presses[i].point, limitLength(presses[i].displacement, longest), now);
      else this.commands.release(tool);
    });
  }

  release(): void {
    ENDOSCOPE_TOOLS.forEach((tool, i) => (i > 0 && this.grasps() ? undefined : this.commands.release(tool)));
  }
}
