// Draws the tools: a tip and a force arrow for each tool, a needle, a blade with its way, and the ring of the surface cursor.
import {
  ArrowHelper, BoxGeometry, BufferAttribute, BufferGeometry, CylinderGeometry, Group, Line, LineBasicMaterial, Matrix4, Mesh, MeshBasicMaterial,
  MeshPhongMaterial, Quaternion, RingGeometry, SphereGeometry, Vector3, Vector4,
} from "three";
import { add, length, scale, toolVector, unit } from "../organ/mesh-geometry";
import { ContactState, TOOLS, type Frame, type Vector } from "../protocol/server-messages";
import { ShapedTool, withHiddenPart, type ToolShape } from "./tool-shapes";

const TEAL = 0x0b7480, STEEL = 0xc9d2d8;
const UP = new Vector3(0, 1, 0), OUT = new Vector3(0, 0, 1);
const MIN_FORCE = 0.005; // N: no arrow below
const MIN_DISPLACEMENT = 0.01; // mm: no direction below

/** The number of the tool that is a needle; the others have a round tip. */
export const NEEDLE = 3;

/** The numbers of the tools with which a camera inside presses the wall. */
export const ENDOSCOPE_TOOLS = [2, 1];

const WAY = 2000; // points of a blade's way

const tools = <T>(make: () => T): T[] => Array.from({ length: TOOLS }, make);

export class ToolMeshes {
  readonly group = new Group();
  size = 1; // mm, radius of the organ
  hidesEndoscope = false; // what presses the wall is the camera itself
  shaped = false; // a finger, a probe or a forceps in place of a ball
  pulls = false; // what holds is a probe
  contactRadius = 1; // mm
  /** The sphere that stands for the tip of each tool in its shadow: center and radius, mm; 0: there is none. */
  readonly spheres = tools(() => new Vector4());
  private readonly shapes = tools(() => new ShapedTool());
  private readonly hands: (Vector3 | null)[] = tools(() => null); // since each tool came
  private readonly tips = tools(() => new Mesh(new SphereGeometry(1, 24, 16), new MeshPhongMaterial({ color: TEAL, shininess: 60 })));
  private readonly arrows = tools(() => new ArrowHelper(OUT, new Vector3(), 1, TEAL));
  private readonly shaft = new Mesh(new CylinderGeometry(1, 1, 1, 12), new MeshPhongMaterial({ color: STEEL, shininess: 120 }));
  private readonly point = new Mesh(new CylinderGeometry(1, 0.05, 1, 12), new MeshPhongMaterial({ color: STEEL, shininess: 120 }));
  private readonly hub = new Mesh(new CylinderGeometry(1, 1, 1, 16), new MeshPhongMaterial({ color: TEAL, shininess: 60 }));
  private readonly edge = withHiddenPart(new BoxGeometry(1, 1, 1), STEEL, 120);
  private readonly handle = new Mesh(new CylinderGeometry(1, 1, 1, 16), new MeshPhongMaterial({ color: TEAL, shininess: 60 }));
  private readonly way = new Line(new BufferGeometry(), new LineBasicMaterial({ color: 0x3a0a08 })); // of the blade, not cut yet
  private wayLength = 0;
  private readonly ring = new Mesh(new RingGeometry(0.75, 1, 40), new MeshBasicMaterial({ color: TEAL, depthTest: false, transparent: true, side: 2 }));
  private readonly dot = new Mesh(new RingGeometry(0, 0.2, 20), this.ring.material);

  /** The tip of each tool, mm. */
  readonly tipPositions: Vector[] = tools(() => [0, 0, 0]);
  private readonly axes: (Vector | null)[] = tools(() => null); // of needles; set before they pierce the surface

  constructor() {
    this.ring.add(this.dot);
    this.ring.renderOrder = 9;
    this.dot.renderOrder = 9;
    this.way.geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * WAY), 3));
    this.way.frustumCulled = false;
    this.group.add(...this.tips, ...this.arrows, this.shaft, this.point, this.hub, this.edge, this.handle, this.way, this.ring, ...this.shapes.map((shape) => shape.group));
    for (const each of this.group.children) each.visible = false;
  }

  /** Moves each tool and its force arrow to the state in the frame. gape: how far the organ has opened at a point, mm. approach: the direction from a
   * contact to the hand; camera: the camera's rotation. */
  update(frame: Frame, gape: (point: Vector) => Vector, approach: (contact: Vector) => Vector3, camera: Quaternion): void {
    let needleVisible = false;
    for (let i = 0; i < TOOLS; i++) {
      const carries = frame.contact[i] === ContactState.carrying, present = carries || frame.contact[i] === ContactState.closed || frame.contact[i] === ContactState.open;
      const displacement = toolVector(frame.displacement, i), force = toolVector(frame.force, i);
      const isNeedle = present && (i === NEEDLE || frame.insertion[i] > 0);
      const isCamera = this.hidesEndoscope && ENDOSCOPE_TOOLS.includes(i);
      const shaped = this.shaped && present && !isNeedle && !isCamera;
      this.tips[i].visible = present && !isNeedle && !isCamera && !shaped;
      this.shapes[i].hide();
      this.spheres[i].w = 0;
      const cutting = frame.contact[i] === ContactState.cutting;
      this.arrows[i].visible = (present || cutting) && !isCamera && length(force) > MIN_FORCE;
      const at = toolVector(frame.point, i), contact = add(carries ? at : add(at, gape(at)), displacement); // the displaced contact point
      if (!present) {
        if (cutting) this.placeArrow(this.arrows[i], new Vector3(...contact), force); // the blade is drawn where the hand is
        this.axes[i] = this.hands[i] = null;
        continue;
      }
      const axis = this.needleAxis(i, displacement, frame.insertion[i]);
      this.tipPositions[i] = isNeedle ? add(contact, scale(axis, frame.insertion[i])) : contact;
      this.tips[i].position.set(...contact);
      this.tips[i].scale.setScalar(0.035 * this.size);
      if (shaped) {
        const hand = (this.hands[i] ??= (i === 1 && this.hands[0]) || approach(contact)); // two jaws are in one hand
        this.placeShape(i, frame, contact, hand, new Vector3(0, 0, 1).applyQuaternion(camera));
      }
      if (isNeedle) this.placeNeedle(new Vector3(...this.tipPositions[i]), axis);
      needleVisible ||= isNeedle;
      this.placeArrow(this.arrows[i], new Vector3(...contact), force);
    }
    this.shaft.visible = this.point.visible = this.hub.visible = needleVisible;
  }

  /** The direction of a needle: that of its displacement until it pierces the surface. */
  private needleAxis(tool: number, displacement: Vector, insertion: number): Vector {
    if (insertion === 0 && length(displacement) > MIN_DISPLACEMENT) this.axes[tool] = unit(displacement);
    return this.axes[tool] ?? unit(displacement);
  }

  /** Places a finger or a probe, or one of two jaws, which meet in the hand. */
  private placeShape(tool: number, frame: Frame, contact: Vector, hand: Vector3, eye: Vector3): void {
    const other = 1 - tool, grasps = tool < 2 && (frame.contact[other] === ContactState.closed || frame.contact[other] === ContactState.carrying);
    const shape: ToolShape = grasps ? "jaw" : this.pulls ? "probe" : "finger";
    const radius = Math.min(this.contactRadius, 0.09 * this.size), tip = new Vector3(...contact), out = hand.clone();
    if (grasps) {
      const between = new Vector3(...add(toolVector(frame.point, other), toolVector(frame.displacement, other)));
      out.multiplyScalar(10 * radius).add(between.sub(tip).multiplyScalar(0.5));
    }
    out.normalize();
    this.shapes[tool].place(shape, tip, out, eye, radius);
    const tipRadius = shape === "finger" ? radius : 0.5 * radius;
    tip.addScaledVector(out, tipRadius);
    this.spheres[tool].set(tip.x, tip.y, tip.z, tipRadius);
  }

  private placeArrow(arrow: ArrowHelper, position: Vector3, force: Vector): void {
    const size = length(force);
    if (!arrow.visible) return;
    arrow.position.copy(position);
    arrow.setDirection(new Vector3(...force).normalize());
    arrow.setLength(this.size * (0.12 + 0.45 * (size / (size + 1))), 0.1 * this.size, 0.05 * this.size);
  }

  /** Places the point, the shaft and the hub of the needle. An opaque organ hides the part inside it. */
  private placeNeedle(tip: Vector3, axis: Vector): void {
    const direction = new Vector3(...axis), radius = 0.009 * this.size;
    const pointLength = 6 * radius, shaftLength = 1.7 * this.size, hubLength = 0.16 * this.size;
    const place = (mesh: Mesh, from: number, to: number, radius: number) => {
      mesh.position.copy(tip).addScaledVector(direction, -(from + to) / 2);
      mesh.scale.set(radius, to - from, radius);
      mesh.quaternion.setFromUnitVectors(UP, direction.clone().negate());
    };
    place(this.point, 0, pointLength, radius);
    place(this.shaft, pointLength, shaftLength, radius);
    place(this.hub, shaftLength, shaftLength + hubLength, 3.2 * radius);
  }

  /** Moves the blade over the surface, `depth` mm in it, or takes it away (null); its way stays until `forgetWay`. */
  moveBlade(point: Vector | null, normal: Vector = [0, 0, 1], depth = 0): void {
    const { edge, handle, way, size } = this;
    edge.visible = handle.visible = point !== null;
    edge.children[0].visible = this.shaped; // the part in the organ
    if (!point) return;
    const array = way.geometry.getAttribute("position") as BufferAttribute, place = add(point, scale(normal, 0.006 * size));
    const out = new Vector3(...normal), along = new Vector3(1, 0, 0);
    if (this.wayLength) along.fromBufferAttribute(array, this.wayLength - 1).sub(new Vector3(...place)).negate();
    if (this.wayLength < WAY && (!this.wayLength || along.length() > 0.005 * size)) array.setXYZ(this.wayLength++, ...place);
    array.needsUpdate = true;
    way.geometry.setDrawRange(0, this.wayLength);
    way.visible = this.wayLength > 1;
    along.addScaledVector(out, -along.dot(out));
    if (along.length() > 0.002 * size || edge.userData.still !== true) {
      if (along.length() < 1e-9) along.crossVectors(out, Math.abs(normal[1]) < 0.9 ? UP : new Vector3(1, 0, 0));
      along.normalize();
      edge.quaternion.setFromRotationMatrix(new Matrix4().makeBasis(along, out, new Vector3().crossVectors(along, out)));
      edge.userData.still = true;
    }
    const above = 0.22 * size, grip = 0.5 * size;
    edge.position.set(...add(point, scale(normal, (above - depth) / 2)));
    edge.scale.set(0.05 * size, above + depth, 0.006 * size);
    handle.position.set(...add(point, scale(normal, above + grip / 2)));
    handle.scale.set(0.028 * size, grip, 0.028 * size);
    handle.quaternion.setFromUnitVectors(UP, out);
  }

  /** Forgets the way of the blade up to its newest point, since the organ is cut there. */
  forgetWay(): void {
    const array = this.way.geometry.getAttribute("position") as BufferAttribute, last = this.wayLength - 1;
    if (last > 0) array.setXYZ(0, array.getX(last), array.getY(last), array.getZ(last));
    this.wayLength = this.edge.visible ? Math.min(this.wayLength, 1) : 0;
    this.way.visible = false;
  }

  /** Shows the cursor at a point of the surface, or hides it (null). Returns whether the picture changes. */
  setCursor(position: Vector | null, normal: Vector = [0, 0, 1]): boolean {
    const wasVisible = this.ring.visible, before = this.ring.position.toArray();
    this.ring.visible = position !== null;
    if (!position) return wasVisible;
    this.ring.position.set(...position);
    this.ring.scale.setScalar(0.075 * this.size);
    this.ring.quaternion.setFromUnitVectors(OUT, new Vector3(...normal).normalize());
    return !wasVisible || before.some((x, i) => x !== position[i]);
  }
}
