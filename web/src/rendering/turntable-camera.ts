// A turntable camera: it orbits the organ with its up axis kept vertical.
import { PerspectiveCamera, Vector3 } from "three";
import { add, scale, subtract, unit, type Ray } from "../organ/mesh-geometry";
import type { Vector } from "../protocol/server-messages";

/** Takes the camera over and obeys what would move it. */
export interface CameraGuest {
  place(camera: PerspectiveCamera): void;
  rotate(dx: number, dy: number, height: number): void;
  pan(dx: number, dy: number, height: number): void;
  step(count: number): void;
  reset(): void;
}

const FIELD = 32; // degrees, from top to bottom
const ZOOM_STEP = 0.12; // of the logarithm of the distance
const START = { yaw: -0.5, pitch: 0.42 }; // radians: from the front, slightly from the side and from above

export class TurntableCamera {
  readonly camera = new PerspectiveCamera(FIELD, 1, 1, 10000);
  private front = 0; // yaw of the view from the front; 0 is from -y, the anterior side of a patient
  private yaw = START.yaw;
  private pitch = START.pitch;
  private distance = 1;
  private target: Vector = [0, 0, 0];
  private center: Vector = [0, 0, 0];
  private size = 1; // mm, radius of the target
  private guest: CameraGuest | null = null;

  constructor() {
    this.camera.up.set(0, 0, 1);
  }

  /** Looks at a sphere so that it fills the picture. */
  lookAt(center: Vector, size: number, front: number): void {
    this.center = center;
    this.front = front;
    this.size = size;
    this.reset();
  }

  /** Takes the direction, distance and offset of another camera, in its own organ's size. Returns whether that changes it. */
  follow(other: TurntableCamera): boolean {
    const before = [this.yaw, this.pitch, this.distance, ...this.target].join();
    const share = this.size / other.size;
    this.yaw = other.yaw;
    this.pitch = other.pitch;
    this.distance = share * other.distance;
    this.target = add(this.center, scale(subtract(other.target, other.center), share));
    if (before === [this.yaw, this.pitch, this.distance, ...this.target].join()) return false;
    this.update();
    return true;
  }

  reset(): void {
    if (this.guest) return this.guest.reset();
    this.yaw = this.front + START.yaw;
    this.pitch = START.pitch;
    this.target = [...this.center];
    const narrow = Math.min(1, this.camera.aspect);
    this.distance = (1.02 * this.size) / (Math.sin((this.camera.fov * Math.PI) / 360) * narrow);
    this.update();
  }

  /** Where the eye is, degrees: about z from the front (-y) towards +x, and above the horizontal plane. */
  get angles(): [azimuth: number, elevation: number] {
    const turn = this.yaw / (2 * Math.PI);
    return [360 * (turn - Math.round(turn)), (180 / Math.PI) * this.pitch];
  }
  set angles([azimuth, elevation]: [number, number]) {
    this.yaw = (Math.PI / 180) * azimuth;
    this.pitch = Math.max(-1.5, Math.min(1.5, (Math.PI / 180) * elevation));
    this.update();
  }

  /** Hands the camera over, or takes it back. */
  setGuest(guest: CameraGuest | null): void {
    this.guest = guest;
    if (!guest) this.camera.fov = FIELD;
    this.update();
  }

  /** Rotates by a drag of so many pixels in a window `height` pixels high. */
  rotate(dx: number, dy: number, height: number): void {
    if (this.guest) return this.guest.rotate(dx, dy, height);
    this.yaw -= (Math.PI * dx) / height;
    this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + (Math.PI * dy) / height));
    this.update();
  }

  /** Moves the picture by so many pixels. */
  pan(dx: number, dy: number, height: number): void {
    if (this.guest) return this.guest.pan(dx, dy, height);
    const mm = this.millimetresPerPixel(height);
    const up = new Vector3(0, 1, 0).applyQuaternion(this.camera.quaternion).toArray();
    this.target = add(this.target, add(scale(this.right, -dx * mm), scale(up, dy * mm)));
    this.update();
  }

  /** At the depth of the point about which the view turns; 0 from inside, where no depth stands for all. height: of the
   * picture, pixels. */
  millimetresPerPixel(height: number): number {
    if (this.guest) return 0;
    return (2 * this.distance * Math.tan((this.camera.fov * Math.PI) / 360)) / height;
  }

  zoom(factor: number): void {
    if (this.guest) return this.guest.step(-Math.log(factor) / ZOOM_STEP);
    this.distance = Math.max(1.2 * this.size, Math.min(12 * this.size, this.distance * factor));
    this.update();
  }

  resize(width: number, height: number): void {
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  /** The ray from the eye through a point of the picture, x and y in -1..1; direction of unit length. */
  ray(x: number, y: number): Ray {
    const origin = this.camera.position.toArray();
    const through = new Vector3(x, y, 0.5).unproject(this.camera).toArray();
    return { origin, direction: unit(subtract(through, origin)) };
  }

  /** The point of the picture at which a position is drawn, x and y in -1..1. */
  project(point: Vector): [number, number] {
    const p = new Vector3(...point).project(this.camera);
    return [p.x, p.y];
  }

  get eye(): Vector {
    return this.camera.position.toArray();
  }

  /** Unit vector to the right in the picture. */
  get right(): Vector {
    return new Vector3(1, 0, 0).applyQuaternion(this.camera.quaternion).toArray();
  }

  /** Unit vector of the direction of view. */
  get forward(): Vector {
    return new Vector3(0, 0, -1).applyQuaternion(this.camera.quaternion).toArray();
  }

  /** Puts the camera where it, or its guest, is. */
  update(): void {
    if (this.guest) {
      this.guest.place(this.camera);
      this.camera.updateProjectionMatrix();
      this.camera.updateMatrixWorld();
      return;
    }
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
