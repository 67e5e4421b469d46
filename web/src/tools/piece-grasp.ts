// A hand on a piece that a cut has freed: it holds it at a point, or with two jaws, and the piece goes where the pixel goes.
import { add, interpolate, limitLength, nearestNode, scale, subtract, unit } from "../organ/mesh-geometry";
import { CommandKind, type Vector } from "../protocol/server-messages";
import type { OrganView } from "../rendering/organ-view";
import type { PieceHit } from "../rendering/loose-pieces";
import type { CommandQueue } from "./command-queue";

interface Held {
  piece: number;
  point: Vector; // mm, the point that was taken, where the piece came free
  points: Vector[]; // mm, of the jaws, where the piece came free
  offset: Vector; // mm, from there, when it was taken
  start: Vector; // mm, the point as drawn then
}

export class PieceGrasp {
  private held: Held | null = null;

  constructor(private readonly view: OrganView, private readonly commands: CommandQueue) {}

  get holding(): boolean {
    return this.held !== null;
  }

  /** The point that was taken, as drawn now, mm. */
  get heldPoint(): Vector | null {
    const pose = this.held && this.view.pieces.poses[this.held.piece];
    return pose ? add(this.held!.point, pose.offset) : null;
  }

  /** Where it was taken, as drawn then, mm. */
  get start(): Vector | null {
    return this.held?.start ?? null;
  }

  get jaws(): number {
    return this.held?.points.length ?? 0;
  }

  /** Takes a piece. apart: mm from the point to each of two jaws; 0: it is held there. */
  begin(hit: PieceHit, apart: number): void {
    const { pieces: { pieces, poses }, turntable } = this.view, { open, triangles } = pieces[hit.piece].organ, { offset } = poses[hit.piece];
    const point = interpolate(hit, open, triangles), start = add(point, offset), { eye } = turntable;
    const jaw = (side: number): Vector => {
      const target = add(start, scale(turntable.right, side * apart)), found = this.view.pieces.pick(eye, unit(subtract(target, eye)));
      const at = found?.piece === hit.piece ? found : nearestNode(subtract(target, offset), open, triangles, 0, triangles.length / 3);
      return interpolate(at, open, triangles);
    };
    this.held = { piece: hit.piece, point, points: apart > 0 ? [jaw(-1), jaw(1)] : [point], offset: [...offset], start };
  }

  /** Moves it by what the pixel has moved, mm. longest: of a displacement. */
  send(moved: Vector, longest: number, stamp: number): void {
    if (!this.held) return;
    const displacement = limitLength(add(this.held.offset, moved), longest);
    this.held.points.forEach((point, tool) => this.commands.send(tool, CommandKind.carry, point, displacement, stamp));
  }

  release(): void {
    this.held = null;
  }
}
