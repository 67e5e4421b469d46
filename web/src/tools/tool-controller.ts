// Turns the input of a mouse, a pen, a finger, the keyboard or a gamepad into commands of the selected tool. Each input
// device reports only the pixel it points at.
//
// Press: a mouse gives no force feedback, so the depth is prescribed and the force is measured. The tool presses the
// surface in along its normal by the selected depth (times the pressure of a pen). Moving it strokes the surface at that
// depth, and the displayed force rises over a stiff region. It is picked on the surface at rest, so that the dent below
// the tool does not move it.
// Pull: holds the point under the pixel and moves it in the plane of the picture: of the organ, or of a loose piece before it.
// Grasp: two jaws to the left and right of that point, closed by the selected amount; they move together.
// Needle: enters under the pixel and stays there; the selected depth inserts it.
// Cut: a blade goes along the surface where the pixel goes, as deep as selected. The server cuts the tissue behind it.
// Measure: sets points on the surface as drawn, see `MeasureTool`.
// Camera: moves nothing here; what is dragged turns the view from inside, see `Endoscope`.
import { BladeStroke } from "./blade-stroke";
import type { CommandQueue } from "./command-queue";
import type { MeasureTool } from "./measure-tool";
import { PieceGrasp } from "./piece-grasp";
import { add, dot, interpolate, length, limitLength, locate, nearestNode, pick, scale, subtract, unit, type Hit, type Ray } from "../organ/mesh-geometry";
import { ENDOSCOPE_TOOLS, NEEDLE } from "../rendering/tool-meshes";
import type { Organ } from "../protocol/worker-messages";
import { CommandKind, type Scalpel, type Vector } from "../protocol/server-messages";
import type { PieceHit } from "../rendering/loose-pieces";
import type { OrganView } from "../rendering/organ-view";

export type ToolKind = "press" | "pull" | "grasp" | "needle" | "cut" | "measure" | "camera";
export const TOOL_KINDS: ToolKind[] = ["press", "pull", "grasp", "needle", "cut", "measure", "camera"];
/** The numbers of the tools that a kind commands. */
export const TOOL_NUMBERS: Record<ToolKind, number[]> = { press: [0], pull: [0], grasp: [0, 1], needle: [NEEDLE], cut: [], measure: [], camera: ENDOSCOPE_TOOLS };

const MAX_REACH = 0.999; // of the longest displacement, since the server gets it rounded
const MOST_MOVED = 0.02; // of the organ's radius: farther from another organ's surface, a measured point is not one of it
const JAW = 1.25; // of the contact's radius: from the middle of a grasp to each jaw, so that their patches do not overlap
const MIN_INSERTION = 0.05; // mm: a needle needs a direction

interface Jaw {
  hit: Hit;
  point: Vector; // mm, at rest
  closing: Vector; // unit vector towards the other jaw; zero for a single one
}
interface Grasp {
  jaws: Jaw[];
  start: Vector; // mm, the grasped point as drawn at first
  gain: number; // of the commanded displacement, see `correctGain`
}
interface Needle {
  point: Vector;
  inward: Vector; // unit vector normal to the surface
  view: Vector; // unit vector of the ray from the eye
}

export class ToolController {
  kind: ToolKind = "press";
  inward = true; // the needle's direction: normal to the surface, or that of the view
  readonly amounts: Record<ToolKind, number> = { press: 1, pull: 0, grasp: 1, needle: 0, cut: 1, measure: 0, camera: 0 }; // mm
  picked: { point: Vector; count: number } | null = null; // mm, at rest: where a tool began last, and how often one did
  private organ: Organ | null = null;
  private grasp: Grasp | null = null;
  private pressPoint: Hit | null = null; // on the surface at rest
  private needle: Needle | null = null;
  readonly blade: BladeStroke;
  private readonly piece: PieceGrasp;
  private aiming = false; // the needle's entry point still follows the pixel
  private pressure = 1;
  private gain = 0.85; // of the last grasp: the first value for the next one
  private pixel: [number, number] = [0, 0];

  constructor(private readonly view: OrganView, private readonly commands: CommandQueue, private readonly measureTool: MeasureTool, sendScalpel: (scalpel: Scalpel) => void) {
    this.piece = new PieceGrasp(view, commands);
    this.blade = new BladeStroke(view, () => this.amounts.cut, (origin, direction) => this.pickRay(origin, direction, true), sendScalpel);
  }

  setOrgan(organ: Organ): void {
    this.releaseAll();
    this.commands.reach = MAX_REACH * organ.scene.reach;
    const before = this.organ, size = this.view.size, surface = organ.scene.parts.find((p) => !p.inside)!;
    this.measureTool.setOrgan(organ, (hit) => {
      const found = locate(interpolate(hit, before!.rest, before!.triangles), organ.rest, organ.triangles, surface.first, surface.count);
      return found.distance < MOST_MOVED * size ? found : null;
    });
    this.organ = organ;
  }

  /** The organ was cut: tools hold on where they are. Called before the view shows it. */
  setCutOrgan(organ: Organ): void {
    const before = this.organ!, surface = organ.scene.parts.find((p) => !p.inside)!;
    const again = (hit: Hit) => locate(interpolate(hit, before.rest, before.triangles), organ.rest, organ.triangles, surface.first, surface.count);
    if (this.pressPoint) this.pressPoint = again(this.pressPoint);
    this.blade.relocate(again);
    for (const jaw of this.grasp?.jaws ?? []) jaw.hit = again(jaw.hit);
    this.measureTool.setOrgan(organ, again);
    this.organ = organ;
  }

  /** The point of the organ's surface under a pixel: of the surface as drawn, or at rest. */
  pick(x: number, y: number, rest = false): Hit | null {
    if (!this.organ) return null;
    const { origin, direction } = this.ray(x, y);
    return this.pickRay(origin, direction, rest);
  }

  /** The loose piece under a pixel, if it is before the organ. */
  pieceAt(x: number, y: number): PieceHit | null {
    const { origin, direction } = this.ray(x, y), found = this.view.pieces.pick(origin, direction);
    return found && found.distance < (this.pick(x, y)?.distance ?? Infinity) ? found : null;
  }

  private ray(x: number, y: number): Ray {
    return this.view.turntable.ray(...this.view.toClip(x, y));
  }

  private pickRay(origin: Vector, direction: Vector, rest: boolean): Hit | null {
    const { scene, triangles, open } = this.organ!;
    const surface = scene.parts.find((p) => !p.inside)!;
    return pick(origin, direction, rest ? open : this.view.positions, triangles, surface.first, surface.count);
  }

  /** Position of a surface point as drawn, and its normal at rest. */
  drawnPoint(hit: Hit): { position: Vector; normal: Vector } {
    const { triangles, normals } = this.organ!;
    return { position: interpolate(hit, this.view.positions, triangles), normal: interpolate(hit, normals, triangles) };
  }

  /** Does the tool hold something that ends with `release`? */
  get holding(): boolean {
    return this.pressPoint !== null || this.grasp !== null || this.piece.holding || this.blade.cutting;
  }
  get pressing(): boolean {
    return this.pressPoint !== null;
  }
  get needleInserted(): boolean {
    return this.needle !== null;
  }

  /** Position of the held material point as drawn, mm. */
  get heldPoint(): Vector | null {
    if (!this.organ) return null;
    if (this.pressPoint) return interpolate(this.pressPoint, this.view.positions, this.organ.triangles);
    return this.grasp ? this.centerOf(this.grasp.jaws) : this.piece.heldPoint;
  }

  private centerOf(jaws: Jaw[]): Vector {
    const sum = jaws.map(({ hit }) => interpolate(hit, this.view.positions, this.organ!.triangles)).reduce(add);
    return scale(sum, 1 / jaws.length);
  }

  /** Begins at a pixel; returns whether the organ is there. swap: pulls instead of pressing, and the other way round. */
  begin(x: number, y: number, stamp: number, swap = false): boolean {
    if (this.kind === "camera") return false;
    const obeyed = this.organ && (this.kind === "measure" || !this.organ.scene.replay), hit = obeyed ? this.pick(x, y) : null;
    const kind = swap && this.kind === "press" ? "pull" : swap && this.kind === "pull" ? "press" : this.kind;
    const piece = obeyed && (kind === "pull" || kind === "grasp") ? this.pieceAt(x, y) : null;
    if (!hit && !piece) return false;
    this.pixel = [x, y];
    if (piece) {
      this.piece.begin(piece, kind === "grasp" ? JAW * this.organ!.scene.radius : 0);
      return this.sendCommands(stamp), true;
    }
    if (!hit) return false;
    if (this.kind === "measure") return this.measureTool.begin(hit), true;
    this.picked = { point: interpolate(hit, this.organ!.rest, this.organ!.triangles), count: (this.picked?.count ?? 0) + 1 };
    if (kind === "cut") return this.blade.begin(this.pick(x, y, true) ?? hit, this.ray(x, y).direction, this.organ!), true;
    if (kind === "press") this.pressPoint = this.pick(x, y, true) ?? hit;
    else if (kind === "needle") this.insertNeedle(hit);
    else {
      const jaws = kind === "pull" ? [this.jaw(hit)] : this.jaws(hit);
      this.grasp = { jaws, start: this.drawnPoint(hit).position, gain: this.gain };
    }
    this.sendCommands(stamp);
    return true;
  }

  private jaw(hit: Hit, closing: Vector = [0, 0, 0]): Jaw {
    return { hit, point: interpolate(hit, this.organ!.rest, this.organ!.triangles), closing };
  }

  /** Jaws to the left and right of a point, on the visible surface. Where it ends on one side: its node nearest to that place. */
  private jaws(hit: Hit): Jaw[] {
    const { turntable } = this.view, middle = this.drawnPoint(hit).position;
    const { scene } = this.organ!, offset = JAW * scene.radius, surface = scene.parts.find((p) => !p.inside)!;
    const jaws = [-1, 1].map((side) => {
      const target = add(middle, scale(turntable.right, side * offset));
      const { eye } = turntable, direction = unit(subtract(target, eye));
      return this.jaw(this.pickRay(eye, direction, false) ?? nearestNode(target, this.view.positions, this.organ!.triangles, surface.first, surface.count));
    });
    const closing = unit(subtract(jaws[1].point, jaws[0].point));
    return [{ ...jaws[0], closing }, { ...jaws[1], closing: scale(closing, -1) }];
  }

  private insertNeedle(hit: Hit): void {
    const { rest, triangles, normals } = this.organ!;
    const { direction } = this.ray(...this.pixel);
    if (this.needle) this.withdrawNeedle();
    const inward = scale(unit(interpolate(hit, normals, triangles)), -1);
    this.needle = { point: interpolate(hit, rest, triangles), inward, view: direction };
    this.amounts.needle = 0;
    this.aiming = true;
  }

  /** The pixel moves. pressure: of a pen, relative to the selected depth. */
  moveTo(x: number, y: number, stamp: number, pressure = 1): void {
    this.pixel = [x, y];
    this.pressure = pressure;
    if (this.measureTool.placing) {
      const hit = this.pick(x, y);
      return hit ? this.measureTool.moveTo(hit) : undefined;
    }
    if (this.blade.cutting) return this.blade.move(this.ray(x, y), this.organ!);
    if (this.pressPoint) this.pressPoint = this.pick(x, y, true) ?? this.pressPoint; // stays where the surface ends
    else if (this.aiming && this.amounts.needle === 0) {
      const hit = this.pick(x, y);
      if (hit) this.insertNeedle(hit);
    }
    this.sendCommands(stamp);
  }

  /** Sets depth, displacement or closing of a tool, mm. */
  setAmount(kind: ToolKind, mm: number, stamp = performance.now()): void {
    this.amounts[kind] = mm;
    if (kind === "needle" && this.needle) this.sendNeedle(stamp);
    else this.sendCommands(stamp);
  }

  setNeedleDirection(inward: boolean): void {
    this.inward = inward;
    this.sendNeedle(performance.now());
  }

  private sendCommands(stamp: number): void {
    if (!this.organ) return;
    const { rest, triangles, normals, scene } = this.organ, longest = MAX_REACH * scene.reach;
    if (this.pressPoint) {
      const normal = unit(interpolate(this.pressPoint, normals, triangles));
      const displacement = scale(normal, -this.amounts.press * this.pressure);
      this.commands.send(0, CommandKind.hold, interpolate(this.pressPoint, rest, triangles), limitLength(displacement, longest), stamp, true);
    } else if (this.grasp) {
      const { jaws, gain } = this.grasp, common = scale(this.pointerDisplacement(this.grasp.start, this.lift(this.grasp)), gain);
      jaws.forEach(({ point, closing }, i) => {
        const displacement = add(common, scale(closing, this.amounts.grasp / 2));
        this.commands.send(i, CommandKind.hold, point, limitLength(displacement, longest), stamp);
      });
    } else if (this.piece.start) {
      const moved = this.pointerDisplacement(this.piece.start, this.piece.jaws > 1 ? 0 : this.amounts.pull);
      this.piece.send(moved, longest, stamp);
    } else if (this.aiming) this.sendNeedle(stamp);
  }

  private sendNeedle(stamp: number): void {
    if (!this.needle || !this.organ) return;
    const { point, inward, view } = this.needle;
    const depth = Math.max(MIN_INSERTION, Math.min(this.amounts.needle, MAX_REACH * this.organ.scene.reach));
    this.commands.send(NEEDLE, CommandKind.needle, point, scale(this.inward ? inward : view, depth), stamp);
  }

  /** Called after each drawn frame. A tool displaces the mean of its patch; the point under the pixel moves a little more.
   * The gain is corrected until that point is under the pixel. */
  correctGain(): void {
    const { grasp, heldPoint } = this;
    if (!grasp || !heldPoint || this.commands.shifted) return;
    const wanted = this.pointerDisplacement(grasp.start, this.lift(grasp)), distance = length(wanted);
    if (distance < 0.02 * this.view.size) return;
    const from = scale(grasp.jaws.map((jaw) => jaw.point).reduce(add), 1 / grasp.jaws.length);
    const reached = dot(subtract(heldPoint, from), wanted) / (distance * distance);
    if (Math.abs(reached - 1) < 0.01) return;
    this.gain = grasp.gain = Math.max(0.6, Math.min(1.1, grasp.gain - 0.15 * (reached - 1)));
    this.sendCommands(performance.now());
  }

  /** mm towards the eye: of a pull. */
  private lift(grasp: Grasp): number {
    return grasp.jaws.length > 1 ? 0 : this.amounts.pull;
  }

  /** Displacement from the grasped point, as drawn at first, to the pixel, in the plane of the picture through it, and towards the eye. */
  private pointerDisplacement(start: Vector, lift: number): Vector {
    const { turntable } = this.view, { forward } = turntable;
    const { origin, direction } = turntable.ray(...this.view.toClip(...this.pixel));
    const distance = dot(subtract(start, origin), forward) / dot(direction, forward);
    const inPlane = subtract(add(origin, scale(direction, distance)), start);
    return add(inPlane, scale(direction, -lift));
  }

  /** Lets go of everything but the needle, which stays inserted. */
  release(): void {
    this.aiming = false;
    if (this.measureTool.placing) return this.measureTool.place();
    if (this.blade.cutting) return this.blade.end();
    if (!this.holding) return;
    this.grasp = this.pressPoint = null;
    this.piece.release();
    this.commands.release(0);
    this.commands.release(1);
  }

  withdrawNeedle(): void {
    this.needle = null;
    this.aiming = false;
    this.commands.release(NEEDLE);
  }

  releaseAll(): void {
    this.release();
    this.withdrawNeedle();
  }
}
