// The shapes of tools that press, pull and grasp: a finger, a probe, the jaws of a forceps. Each has its tip at the origin, its
// shaft along +y, and the radius of its tip as the unit.
import {
  CustomBlending, CylinderGeometry, GreaterDepth, Group, LatheGeometry, Matrix4, Mesh, MeshPhongMaterial, SphereGeometry, Vector2, Vector3, type BufferGeometry,
} from "three";

const SKIN = 0xd6a184, NAIL = 0xeac6b8, STEEL = 0xc9d2d8, TEAL = 0x0b7480;
export type ToolShape = "finger" | "probe" | "jaw";

const lathe = (points: [number, number][]): BufferGeometry => new LatheGeometry(points.map((p) => new Vector2(...p)), 28);
const round = (radius: number, from: number, steps = 8): [number, number][] =>
  Array.from({ length: steps }, (_, i) => [radius * Math.sin((i * Math.PI) / 2 / (steps - 1)), from + radius * (1 - Math.cos((i * Math.PI) / 2 / (steps - 1)))]);

/** A mesh, and the same faintly where something hides it: so a tool stays visible in the dent that it makes. */
export function withHiddenPart(geometry: BufferGeometry, color: number, shininess: number): Mesh {
  const mesh = new Mesh(geometry, new MeshPhongMaterial({ color, shininess }));
  // Drawn after the organ and before the tool, which would hide parts of itself: so it is not in the list of transparent things.
  const faint = new MeshPhongMaterial({ color, shininess, blending: CustomBlending, opacity: 0.3, depthFunc: GreaterDepth, depthWrite: false });
  mesh.add(new Mesh(geometry, faint));
  mesh.children[0].renderOrder = 1;
  mesh.renderOrder = 2;
  return mesh;
}

const MAKE: Record<ToolShape, () => Mesh[]> = {
  finger: () => {
    const nail = withHiddenPart(new SphereGeometry(1, 16, 12).scale(0.6, 0.8, 0.3).translate(0, 1.2, 0.84), NAIL, 60);
    // The creases of two joints lie at 3.4 and 6.6.
    return [withHiddenPart(lathe([...round(1, 0), [1.03, 2.2], [1.0, 3.1], [0.97, 3.4], [1.02, 3.7], [1.12, 5], [1.1, 6.2], [1.07, 6.6], [1.13, 7], [1.2, 8]]), SKIN, 12), nail, withHiddenPart(lathe([[1.1, 7.6], [1.32, 7.65], [1.42, 9.6], [1.3, 9.8], [0, 9.8]]), TEAL, 20)];
  },
  probe: () => [
    withHiddenPart(lathe([...round(0.55, 0, 10), [0.5, 0.8], [0.34, 0.98], [0.17, 1.1], [0.17, 7]]), STEEL, 120),
    withHiddenPart(lathe([[0.17, 7], [0.4, 7.2], [0.42, 11], [0.3, 11.3], [0, 11.3]]), TEAL, 60),
  ],
  jaw: () => [
    withHiddenPart(lathe([[0, 0], [0.3, 0.02], [0.36, 0.3], [0.2, 0.8], [0.26, 5], [0.34, 7.4]]), STEEL, 120),
    withHiddenPart(new CylinderGeometry(0.55, 0.36, 3.4, 16).translate(0, 9, 0), TEAL, 60),
  ],
};

/** The shapes that one tool can have, of which one is shown. */
export class ShapedTool {
  readonly group = new Group();
  private readonly shapes: Partial<Record<ToolShape, Group>> = {};

  hide(): void {
    this.group.visible = false;
  }

  /** tip: where it touches, mm; out: along its shaft, of unit length; eye: to the eye, where a finger's nail is. */
  place(shape: ToolShape, tip: Vector3, out: Vector3, eye: Vector3, radius: number): void {
    if (!this.shapes[shape]) this.group.add((this.shapes[shape] = new Group().add(...MAKE[shape]())));
    for (const [name, group] of Object.entries(this.shapes)) group.visible = name === shape;
    this.group.visible = true;
    const back = eye.clone().addScaledVector(out, -eye.dot(out));
    if (back.lengthSq() < 1e-6) back.set(out.y, -out.x, 0).addScalar(1e-3);
    back.normalize();
    const side = new Vector3().crossVectors(out, back).normalize();
    this.group.quaternion.setFromRotationMatrix(new Matrix4().makeBasis(side, out, back.crossVectors(side, out)));
    this.group.position.copy(tip);
    this.group.scale.setScalar(radius);
  }
}
