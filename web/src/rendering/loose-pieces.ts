// Draws the pieces that cuts have freed, each where it is now, with the materials of the organ.
import { BufferAttribute, BufferGeometry, Group, LineSegments, Mesh, type Material } from "three";
import { add, pick, scale, subtract, type Hit } from "../organ/mesh-geometry";
import type { PiecePose } from "../protocol/room-messages";
import { PieceState, type Vector } from "../protocol/server-messages";
import type { Piece } from "../protocol/worker-messages";
import { setSurfaceAttributes } from "./surface-attributes";

export interface PieceHit extends Hit {
  piece: number;
}

export class LoosePieces {
  readonly group = new Group();
  pieces: Piece[] = [];
  poses: PiecePose[] = [];
  private meshes: Mesh[] = [];

  /** size: mm, radius of the organ. rims: material of the edges of cut faces. */
  show(pieces: Piece[], size: number, material: Material, rims: Material): void {
    this.group.traverse((thing) => thing instanceof Mesh && thing.geometry.dispose());
    this.group.clear();
    this.pieces = pieces;
    this.poses = [];
    this.meshes = pieces.map(({ organ, arrays }) => {
      const position = new BufferAttribute(arrays.positions, 3), geometry = new BufferGeometry().setIndex(new BufferAttribute(organ.triangles, 1));
      geometry.setAttribute("position", position).setAttribute("normal", new BufferAttribute(arrays.normals, 4, true)).setAttribute("color", new BufferAttribute(arrays.colors, 4, true));
      setSurfaceAttributes(geometry, organ, size);
      const mesh = new Mesh(geometry, material), edges = new BufferGeometry().setIndex(new BufferAttribute(organ.rims, 1)).setAttribute("position", position);
      mesh.add(new LineSegments(edges, rims));
      for (const thing of [mesh, ...mesh.children]) thing.frustumCulled = false;
      mesh.visible = false; // until it is said where it is
      this.group.add(mesh);
      return mesh;
    });
  }

  set material(material: Material) {
    for (const mesh of this.meshes) mesh.material = material;
  }

  /** Moves them; returns whether anything has changed. */
  update(poses: PiecePose[]): boolean {
    let changed = false;
    this.poses = poses;
    this.meshes.forEach((mesh, i) => {
      const there = this.isThere(i), [x, y, z] = poses[i]?.offset ?? [0, 0, 0], { position } = mesh;
      if (mesh.visible === there && position.x === x && position.y === y && position.z === z) return;
      mesh.visible = there;
      position.set(x, y, z);
      changed = true;
    });
    return changed;
  }

  private isThere(piece: number): boolean {
    return piece < this.poses.length && this.poses[piece].state !== PieceState.gone;
  }

  /** The mean of a piece's vertices as drawn, mm. */
  middle(piece: number): Vector {
    const { open } = this.pieces[piece].organ, sum: Vector = [0, 0, 0];
    open.forEach((x, i) => (sum[i % 3] += x));
    return add(scale(sum, 3 / open.length), this.poses[piece].offset);
  }

  /** The first piece on a ray. */
  pick(origin: Vector, direction: Vector): PieceHit | null {
    let first: PieceHit | null = null;
    this.pieces.forEach(({ organ: { open, triangles } }, piece) => {
      if (!this.isThere(piece)) return;
      const hit = pick(subtract(origin, this.poses[piece].offset), direction, open, triangles, 0, triangles.length / 3);
      if (hit && hit.distance < (first?.distance ?? Infinity)) first = { ...hit, piece };
    });
    return first;
  }
}
