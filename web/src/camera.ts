// A camera on a turntable: it circles the organ, upright, nearer or farther.
import { PerspectiveCamera, Vector3 } from "three";
import { add, minus, times } from "./geometry";
import type { Vector } from "./messages";

const START = { yaw: -0.5, pitch: 0.42 }; // from the front, a little to the side and above

export class Turntable {
  readonly camera = new PerspectiveCamera(32, 1, 1, 10000);
  private front = 0; // yaw from which the organ is seen from the front; 0 is -y, a patient's belly
  private yaw = START.yaw;
  private pitch = START.pitch;
  private distance = 1;
  private target: Vector = [0, 0, 0];
  private centre: Vector = [0, 0, 0];
  private size = 1; // mm, radius of what is looked at

  constructor() {
    this.camera.up.set(0, 0, 1);
  }

  /** Looks at a ball. */
  frame(centre: Vector, size: number, front: number): void {
    this.centre = centre;
    this.front = front;
    this.size = size;
    this.reset();
  }

  reset(): void {
    this.yaw = this.front + START.yaw;
    this.pitch = START.pitch;
    this.target = [...this.centre];
    const narrow = Math.min(1, this.camera.aspect);
    this.distance = (1.02 * this.size) / (Math.sin((this.camera.fov * Math.PI) / 360) * narrow);
    this.place();
  }

  /** Turns by a drag of so many pixels of a window `height` pixels high. */
  turn(dx: number, dy: number, height: number): void {
    this.yaw -= (Math.PI * dx) / height;
    this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + (Math.PI * dy) / height));
    this.place();
  }

  shift(dx: number, dy: number, height: number): void {
    const mm = (2 * this.distance * Math.tan((this.camera.fov * Math.PI) / 360)) / height;
    const up = new Vector3(0, 1, 0).applyQuaternion(this.camera.quaternion).toArray();
    this.target = add(this.target, add(times(this.right, -dx * mm), times(up, dy * mm)));
    this.place();
  }

  zoom(factor: number): void {
    this.distance = Math.max(1.2 * this.size, Math.min(12 * this.size, this.distance * factor));
    this.place();
  }

  resize(width: number, height: number): void {
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  /** Ray through a pixel: from the eye, unit direction. x, y in -1..1. */
  ray(x: number, y: number): { origin: Vector; direction: Vector } {
    const origin = this.camera.position.toArray();
    const through = new Vector3(x, y, 0.5).unproject(this.camera).toArray();
    const way = minus(through, origin);
    return { origin, direction: times(way, 1 / Math.hypot(...way)) };
  }

  /** Where a point is on the screen, x, y in -1..1. */
  project(point: Vector): [number, number] {
    const p = new Vector3(...point).project(this.camera);
    return [p.x, p.y];
  }

  get eye(): Vector {
    return this.camera.position.toArray();
  }

  /** Unit vector along the picture's horizontal. */
  get right(): Vector {
    return new Vector3(1, 0, 0).applyQuaternion(this.camera.quaternion).toArray();
  }

  /** Unit vector from the eye to the middle of the picture. */
  get forward(): Vector {
    return new Vector3(0, 0, -1).applyQuaternion(this.camera.quaternion).toArray();
  }

  private place(): void {
    const flat = Math.cos(this.pitch) * this.distance;
    const eye = add(this.target, [Math.sin(this.yaw) * flat, -Math.cos(this.yaw) * flat, Math.sin(this.pitch) * this.distance]);
    this.camera.position.set(...eye);
    this.camera.near = this.distance / 50;
    this.camera.far = this.distance * 10;
    this.camera.lookAt(...this.target);
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
  }
}
