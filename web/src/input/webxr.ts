// The organ in a headset, if the browser offers one (WebXR Device API): enlarged five times, in front of the user. Each
// controller is a tool in space; it holds the tissue that it touches while its trigger is pulled.
import { CylinderGeometry, Group, Matrix4, Mesh, MeshPhongMaterial, PerspectiveCamera, Vector3 } from "three";
import type { CommandQueue } from "../tools/command-queue";
import { limitLength, subtract, toolVector } from "../organ/mesh-geometry";
import { CommandKind, ContactState, type Frame, type Vector } from "../protocol/server-messages";
import type { OrganView } from "../rendering/organ-view";

const MAGNIFICATION = 5;
const DISTANCE = 0.7, BELOW = 0.25; // m, from the eyes and below them
const PEN_LENGTH = 0.13, PEN_RADIUS = 0.004; // m, of a drawn controller; its tip touches
const CONTROLLERS = [0, 1]; // also the numbers of their tools

/** A held point of the surface at rest, and the position of the controller for zero displacement; mm. */
interface Hold {
  point: Vector;
  origin: Vector;
}

export class WebXRInput {
  private readonly room = new Group(); // the coordinates of the room, scaled to the organ's mm
  private readonly camera = new PerspectiveCamera(60, 1, 0.05, 20);
  private reach = 1; // mm, the longest displacement
  private readonly holds: (Hold | null)[] = [null, null];

  constructor(private readonly view: OrganView, private readonly commands: CommandQueue, private readonly newestFrame: () => Frame | null) {
    this.room.add(this.camera);
    const pen = new CylinderGeometry(PEN_RADIUS / 4, PEN_RADIUS, PEN_LENGTH).rotateX(-Math.PI / 2).translate(0, 0, PEN_LENGTH / 2);
    const material = new MeshPhongMaterial({ color: 0x9aa3ad });
    for (const i of CONTROLLERS) {
      const controller = view.renderer.xr.getController(i);
      this.room.add(controller.add(new Mesh(pen, material)));
      controller.addEventListener("selectstart", () => this.hold(i));
      controller.addEventListener("selectend", () => (this.holds[i] = null));
      controller.addEventListener("disconnected", () => this.commands.release(i));
    }
    view.root.add(this.room);
  }

  /** Does this browser offer a headset? */
  static async isSupported(): Promise<boolean> {
    return (await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false)) ?? false;
  }

  get active(): boolean {
    return this.view.renderer.xr.isPresenting;
  }

  async enter(reach: number): Promise<void> {
    const session = await navigator.xr!.requestSession("immersive-vr", { optionalFeatures: ["local-floor"] });
    this.reach = reach;
    const { xr } = this.view.renderer;
    xr.enabled = true;
    xr.setReferenceSpaceType("local");
    // From metres in the room, y up, to millimetres of the organ, z up.
    const scale = 1000 / MAGNIFICATION, [x, y, z] = this.view.center;
    const matrix = new Matrix4().makeBasis(new Vector3(scale, 0, 0), new Vector3(0, 0, scale), new Vector3(0, -scale, 0));
    const middle = new Vector3(0, -BELOW, -DISTANCE).applyMatrix4(matrix);
    matrix.setPosition(x - middle.x, y - middle.y, z - middle.z);
    matrix.decompose(this.room.position, this.room.quaternion, this.room.scale);
    await xr.setSession(session);
    session.addEventListener("end", () => {
      xr.enabled = false;
      for (const i of CONTROLLERS) {
        this.holds[i] = null;
        this.commands.release(i);
      }
      this.view.resize();
    });
  }

  /** Called once a frame: commands the tools by the controllers' positions and draws for both eyes. */
  update(): void {
    const stamp = performance.now();
    for (const i of CONTROLLERS) {
      const hold = this.holds[i];
      if (!this.view.renderer.xr.getController(i).visible) continue;
      const tip = this.tip(i);
      if (hold) this.commands.send(i, CommandKind.hold, hold.point, limitLength(subtract(tip, hold.origin), 0.999 * this.reach), stamp);
      else this.commands.send(i, CommandKind.free, tip, [0, 0, 0], stamp);
    }
    this.view.draw(this.camera);
  }

  private tip(i: number): Vector {
    return this.view.renderer.xr.getController(i).getWorldPosition(new Vector3()).toArray();
  }

  /** Holds the tissue that the tool touches, with its present displacement. */
  private hold(i: number): void {
    const frame = this.newestFrame();
    if (frame?.contact[i] !== ContactState.closed) return;
    this.holds[i] = { point: toolVector(frame.point, i), origin: subtract(this.tip(i), toolVector(frame.displacement, i)) };
  }
}
