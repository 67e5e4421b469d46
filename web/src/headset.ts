// Into the organ with a headset, where the browser offers one (WebXR Device API): it hangs life-size times five before
// the eyes; each controller is a tool in space, and takes hold of what it touches while its trigger is down.
import { CylinderGeometry, Group, Matrix4, Mesh, MeshPhongMaterial, PerspectiveCamera, Vector3 } from "three";
import { FREE, HOLD, type Commands } from "./commands";
import { atMost, minus, slot } from "./geometry";
import type { Frame, Vector } from "./messages";
import type { View } from "./view";

const LARGER = 5;
const BEFORE = 0.7, UNDER = 0.25; // m from the eyes, and below them
const LONG = 0.13, THICK = 0.004; // m, of what a hand holds: its tip is what touches

export class Headset {
  private readonly rig = new Group(); // the room, in the organ's millimetres
  private readonly camera = new PerspectiveCamera(60, 1, 0.05, 20);
  private reach = 1; // mm, the longest displacement
  private readonly taken: ({ point: Vector; from: Vector } | null)[] = [null, null];

  constructor(private readonly view: View, private readonly commands: Commands, private readonly newest: () => Frame | null) {
    this.rig.add(this.camera);
    const pen = new CylinderGeometry(THICK / 4, THICK, LONG).rotateX(-Math.PI / 2).translate(0, 0, LONG / 2);
    const steel = new MeshPhongMaterial({ color: 0x9aa3ad });
    for (const i of [0, 1]) {
      const controller = view.renderer.xr.getController(i);
      this.rig.add(controller.add(new Mesh(pen, steel)));
      controller.addEventListener("selectstart", () => this.take(i));
      controller.addEventListener("selectend", () => (this.taken[i] = null));
      controller.addEventListener("disconnected", () => this.commands.away(i));
    }
    view.world.add(this.rig);
  }

  /** Does this browser have a headset to offer? */
  static async offered(): Promise<boolean> {
    return (await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false)) ?? false;
  }

  get on(): boolean {
    return this.view.renderer.xr.isPresenting;
  }

  async enter(reach: number): Promise<void> {
    const session = await navigator.xr!.requestSession("immersive-vr", { optionalFeatures: ["local-floor"] });
    this.reach = reach;
    const { xr } = this.view.renderer;
    xr.enabled = true;
    xr.setReferenceSpaceType("local");
    // Metres of the room to millimetres of the organ, whose z is up where the room's is y.
    const scale = 1000 / LARGER, [x, y, z] = this.view.centre;
    const turn = new Matrix4().makeBasis(new Vector3(scale, 0, 0), new Vector3(0, 0, scale), new Vector3(0, -scale, 0));
    const middle = new Vector3(0, -UNDER, -BEFORE).applyMatrix4(turn);
    turn.setPosition(x - middle.x, y - middle.y, z - middle.z);
    turn.decompose(this.rig.position, this.rig.quaternion, this.rig.scale);
    await xr.setSession(session);
    session.addEventListener("end", () => {
      xr.enabled = false;
      for (const i of [0, 1]) {
        this.taken[i] = null;
        this.commands.away(i);
      }
      this.view.resize();
    });
  }

  /** Once a picture: tells where the controllers are, and draws for both eyes. */
  turn(): void {
    const stamp = performance.now();
    for (const i of [0, 1]) {
      const controller = this.view.renderer.xr.getController(i), taken = this.taken[i];
      if (!controller.visible) continue;
      const tip = controller.getWorldPosition(new Vector3()).toArray();
      if (taken) this.commands.send(i, HOLD, taken.point, atMost(minus(tip, taken.from), 0.999 * this.reach), stamp);
      else this.commands.send(i, FREE, tip, [0, 0, 0], stamp);
    }
    this.view.draw(this.camera);
  }

  private take(i: number): void {
    const frame = this.newest();
    if (frame?.grip[i] !== 1) return; // it touches nothing
    const tip = this.view.renderer.xr.getController(i).getWorldPosition(new Vector3()).toArray();
    this.taken[i] = { point: slot(frame.point, i), from: minus(tip, slot(frame.displacement, i)) }; // goes on from here
  }
}
