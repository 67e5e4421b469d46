// Draws the organ, the regions inside it, and the tools.
import {
  BufferAttribute, BufferGeometry, DirectionalLight, DoubleSide, DynamicDrawUsage, HemisphereLight, LineBasicMaterial,
  LineSegments, Mesh, MeshBasicMaterial, MeshPhongMaterial, Scene as Scene3D, Vector3, WebGLRenderer, type Camera,
} from "three";
import { TurntableCamera, type CameraGuest } from "./turntable-camera";
import { Appearance } from "./appearance";
import { GouraudMaterial } from "./gouraud-material";
import { GuidanceLine } from "./guidance-line";
import { LoosePieces } from "./loose-pieces";
import { OtherHands } from "./other-hands";
import { setSurfaceAttributes } from "./surface-attributes";
import { TissueMaterial } from "./tissue-material";
import { ToolMeshes } from "./tool-meshes";
import { INNER_COLORS } from "../organ/color-map";
import { add, interpolate, length, locate, pick, scale, subtract, toolVector } from "../organ/mesh-geometry";
import type { OtherHand, PiecePose } from "../protocol/room-messages";
import type { Organ, NodeArrays } from "../protocol/worker-messages";
import { ContactState, type Frame, type Vector } from "../protocol/server-messages";
import { onColorScheme } from "./color-scheme";
import { isSoftwareRendered } from "./software-rendering";

// Pixel ratio while the picture changes, if the processor draws: half the pixels, and a fifth less delay.
const MOVING_RATIO = 0.7;
const DARK = 0x0d0605; // seen from inside, where nothing is lit
// Where the hand may be, in camera coordinates; the last is before the eye.
const HANDS = [[0.45, 0.55, 0.7], [0.6, 0.1, 0.75], [-0.45, 0.5, 0.7], [0.1, -0.65, 0.7], [0.2, 0.25, 0.95]].map((hand) => new Vector3(...hand).normalize());
const REST_TIME = 250; // ms without a change until the picture is drawn at full resolution

export class OrganView {
  readonly turntable = new TurntableCamera();
  readonly renderer: WebGLRenderer;
  readonly root = new Scene3D();
  readonly toolMeshes = new ToolMeshes();
  readonly otherHands = new OtherHands();
  readonly pieces = new LoosePieces();
  readonly guidanceLine = new GuidanceLine();
  private readonly geometry = new BufferGeometry();
  private readonly material = Object.assign(new GouraudMaterial(), { polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
  private readonly tissue = Object.assign(new TissueMaterial(), { polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
  private readonly lines = new LineBasicMaterial({ vertexColors: true });
  private readonly rimLines = new LineBasicMaterial({ color: 0x4a0f0c });
  private surface: Mesh = new Mesh(this.geometry, this.material);
  // Fills the depth buffer only: it hides lines behind the organ, and all but the front layer of a translucent surface.
  private depthOnly = new Mesh(this.geometry, new MeshBasicMaterial({ colorWrite: false, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
  private wire = new LineSegments(new BufferGeometry(), this.lines);
  private rims = new LineSegments(new BufferGeometry(), this.rimLines); // of cuts, which at rest nothing else shows
  private organ: Organ | null = null;
  private inner: Mesh[] = [];
  private shownLevel = -1; // of the appearance
  private newest: Frame | null = null;
  private wireframe = false;
  private translucent = false;
  private needsRedraw = true;
  private wasStill = true; // the last frame showed the organ at rest, without tools
  private hasArrays = false; // positions of this organ have arrived
  private readonly softwareRendered = isSoftwareRendered();
  private sharp = true;
  private atRest = true;
  private timer = 0;
  private box = { left: 0, top: 0, width: 1, height: 1 };
  size = 0; // mm, radius of the organ
  smallestSide = 1; // mm, of its bounding box
  center: Vector = [0, 0, 0];

  /** appearance: tissue or plain; that of another view, or its own. */
  constructor(private readonly canvas: HTMLCanvasElement, readonly appearance = new Appearance()) {
    this.renderer = new WebGLRenderer({ canvas, antialias: !this.softwareRendered, alpha: !this.softwareRendered });
    if (this.softwareRendered) {
      this.setBackground();
      onColorScheme(() => this.setBackground());
    }
    const light = new DirectionalLight(0xffffff, 2.3);
    light.position.set(-0.5, 0.8, 1);
    this.turntable.camera.add(light, light.target); // the light moves with the camera
    light.target.position.set(0, 0, -1);
    this.root.add(this.turntable.camera, new HemisphereLight(0xffffff, 0x8a8fa0, 1.5), this.toolMeshes.group, this.otherHands.group, this.pieces.group, this.guidanceLine.mesh);
    new ResizeObserver(() => this.resize()).observe(canvas);
    addEventListener("resize", () => this.measure());
    addEventListener("scroll", () => this.measure(), true);
    this.resize();
  }

  /** Gives the canvas the background color of the page; seen from inside it is dark. */
  private setBackground(): void {
    if (this.material.inside) this.renderer.setClearColor(DARK, 1);
    else if (this.softwareRendered) this.renderer.setClearColor(getComputedStyle(this.canvas).getPropertyValue("--ground").trim());
    else this.renderer.setClearColor(0, 0);
    this.needsRedraw = true;
  }

  /** Shows another organ. The camera stays if it is another mesh of the same organ. */
  show(organ: Organ): void {
    const { scene, open, triangles } = organ;
    this.organ = organ;
    this.newest = null;
    this.hasArrays = false;
    this.material.polygonOffset = this.tissue.polygonOffset = organ.rims.length > 0; // so that the rims are in front
    this.root.remove(this.surface, this.wire, this.rims, ...this.inner);
    for (const old of [this.surface, this.wire, this.rims, ...this.inner]) old.geometry.dispose();
    const attribute = (array: Float32Array | Int16Array | Uint8Array, items: number) =>
      new BufferAttribute(array, items, items === 4).setUsage(DynamicDrawUsage);
    const nodes = open.length / 3;
    const position = attribute(open.slice(), 3), normal = attribute(new Int16Array(4 * nodes), 4), color = attribute(new Uint8Array(4 * nodes), 4);
    const drawn = (geometry: BufferGeometry, index: Uint32Array) =>
      geometry.setIndex(new BufferAttribute(index, 1)).setAttribute("position", position).setAttribute("normal", normal).setAttribute("color", color);
    const part = (first: number, count: number) => triangles.slice(3 * first, 3 * (first + count));
    const surface = scene.parts.find((p) => !p.inside)!;
    this.surface = new Mesh(drawn(this.geometry, part(surface.first, surface.count)), this.shownLevel > 0 ? this.tissue : this.material);
    this.wire = new LineSegments(drawn(new BufferGeometry(), organ.edges), this.lines);
    this.rims = new LineSegments(new BufferGeometry().setIndex(new BufferAttribute(organ.rims, 1)).setAttribute("position", position), this.rimLines);
    this.inner = scene.parts.filter((p) => p.inside).map((p, i) => {
      const material = new MeshPhongMaterial({ color: INNER_COLORS[i % INNER_COLORS.length], emissive: INNER_COLORS[i % INNER_COLORS.length], emissiveIntensity: 0.4, side: DoubleSide });
      return new Mesh(drawn(new BufferGeometry(), part(p.first, p.count)), material);
    });
    for (const thing of [this.surface, this.depthOnly, this.wire, this.rims, ...this.inner]) thing.frustumCulled = false; // it moves
    this.root.add(this.surface, this.depthOnly, this.wire, this.rims, ...this.inner);
    this.fitCamera(organ.rest, scene.front);
    setSurfaceAttributes(this.geometry, organ, this.size);
    this.pieces.show(organ.pieces, this.size, this.shownLevel > 0 ? this.tissue : this.material, this.rimLines);
    this.tissue.setSizes(this.size, scene.radius);
    this.toolMeshes.contactRadius = scene.radius;
    this.updateVisibility();
  }

  private fitCamera(rest: Float32Array, front: number): void {
    const low: Vector = [Infinity, Infinity, Infinity], high: Vector = [-Infinity, -Infinity, -Infinity];
    rest.forEach((x, i) => ((low[i % 3] = Math.min(low[i % 3], x)), (high[i % 3] = Math.max(high[i % 3], x))));
    const center = low.map((x, k) => (x + high[k]) / 2) as Vector;
    const size = Math.hypot(...low.map((x, k) => high[k] - x)) / 2;
    const other = Math.hypot(...center.map((x, k) => x - this.center[k])) > 0.1 * size || Math.abs(size - this.size) > 0.1 * size;
    this.center = center;
    this.size = size;
    this.smallestSide = Math.min(...low.map((x, k) => high[k] - x));
    if (!this.material.inside) this.toolMeshes.size = size;
    this.otherHands.size = size;
    if (other) this.turntable.lookAt(center, size, front);
  }

  /** How far the organ has opened at a point of its surface at rest, mm. */
  private gapeAt(point: Vector): Vector {
    if (!this.organ?.scene.gapes) return [0, 0, 0];
    const { rest, open, triangles, scene } = this.organ, surface = scene.parts.find((p) => !p.inside)!;
    const hit = locate(point, rest, triangles, surface.first, surface.count);
    return subtract(interpolate(hit, open, triangles), interpolate(hit, rest, triangles));
  }

  /** A direction from a contact to the hand in which the organ is not in the way. */
  private approach(contact: Vector): Vector3 {
    const { triangles, scene } = this.organ!, surface = scene.parts.find((p) => !p.inside)!;
    const start = 0.08 * this.size, { quaternion } = this.turntable.camera;
    const clear = (hand: Vector3) => [-0.2, 0, 0.2].every((side) => {
      const way = hand.clone().add(new Vector3(side * hand.y, -side * hand.x, 0)).normalize().applyQuaternion(quaternion).toArray();
      return !pick(add(contact, scale(way, start)), way, this.positions, triangles, surface.first, surface.count);
    });
    return (HANDS.find(clear) ?? HANDS.at(-1)!).clone().applyQuaternion(quaternion);
  }

  /** Takes a frame and returns the arrays that it replaces. arrays: null if the organ has not moved. */
  update(frame: Frame, arrays: NodeArrays | null): NodeArrays | null {
    this.newest = frame;
    const idle = frame.contact.every((state) => state === ContactState.idle);
    const still = arrays === null && idle;
    if (!still || !this.wasStill) this.needsRedraw = true;
    this.wasStill = still;
    this.toolMeshes.update(frame, (point) => this.gapeAt(point), (contact) => this.approach(contact), this.turntable.camera.quaternion);
    this.toolMeshes.spheres.forEach((sphere, i) => {
      const force = frame.contact[i] === ContactState.closed ? length(toolVector(frame.force, i)) : 0;
      this.tissue.setTool(i, sphere, new Vector3(...toolVector(frame.point, i)), force);
    });
    if (!arrays) return null;
    this.hasArrays = true;
    const [position, normal, color] = ["position", "normal", "color"].map((name) => this.geometry.getAttribute(name) as BufferAttribute);
    const old = { positions: position.array, normals: normal.array, colors: color.array } as NodeArrays;
    position.array = arrays.positions;
    normal.array = arrays.normals;
    color.array = arrays.colors;
    position.needsUpdate = normal.needsUpdate = color.needsUpdate = true;
    return old;
  }

  /** Takes the tools of the other people in a room. */
  showHands(hands: OtherHand[]): void {
    if (this.otherHands.update(hands, (point) => this.gapeAt(point))) this.needsRedraw = true;
  }

  /** Takes where the pieces are that cuts have freed. */
  showPieces(poses: PiecePose[]): void {
    if (this.pieces.update(poses)) this.needsRedraw = true;
  }

  /** Draws the coupling between a guiding tool and a guided one, mm, or none. */
  showGuidance(ends: [Vector, Vector] | null, color: number): void {
    if (this.guidanceLine.show(ends, color, this.size)) this.needsRedraw = true;
  }

  set drawWireframe(wireframe: boolean) {
    this.wireframe = wireframe;
    this.updateVisibility();
  }
  set drawTranslucent(translucent: boolean) {
    this.translucent = translucent;
    this.updateVisibility();
  }

  /** Draws as tissue, in steps, or plainly. */
  private updateLook(): void {
    const level = this.material.inside ? 0 : this.appearance.level;
    if (level === this.shownLevel) return;
    this.shownLevel = level;
    if (level) this.tissue.level = level;
    this.surface.material = this.pieces.material = level ? this.tissue : this.material;
    this.toolMeshes.shaped = level > 0;
    if (this.newest) this.update(this.newest, null);
    this.needsRedraw = true;
  }

  private updateVisibility(): void {
    const { wireframe, translucent } = this;
    this.wire.visible = wireframe;
    this.surface.visible = !wireframe;
    this.depthOnly.visible = wireframe !== translucent;
    this.depthOnly.renderOrder = translucent ? 1 : -1; // after the inner regions, before the translucent surface
    this.material.translucent = this.tissue.translucent = translucent;
    for (const mesh of this.inner) mesh.visible = translucent;
    this.needsRedraw = true;
  }

  /** The view from inside: a guest moves the camera, light fades with the distance, tools are drawn for a lumen of so many mm. */
  enterEndoscope(guest: CameraGuest, size: number): void {
    this.turntable.setGuest(guest);
    this.material.inside = size;
    this.toolMeshes.size = size;
    this.toolMeshes.hidesEndoscope = true;
    this.setBackground();
  }
  leaveEndoscope(): void {
    this.turntable.setGuest(null);
    this.material.inside = 0;
    this.toolMeshes.size = this.size;
    this.toolMeshes.hidesEndoscope = false;
    this.setBackground();
  }
  placeCamera(): void {
    this.turntable.update();
    this.needsRedraw = true;
  }

  /** Positions of the nodes as drawn, mm. */
  get positions(): Float32Array {
    return this.geometry.getAttribute("position").array as Float32Array;
  }

  /** From a pixel of the window to clip coordinates, -1..1, and from a position to its pixel. */
  toClip(x: number, y: number): [number, number] {
    const { left, top, width, height } = this.box;
    return [(2 * (x - left)) / width - 1, 1 - (2 * (y - top)) / height];
  }
  toPixel(point: Vector): [number, number] {
    const { left, top, width, height } = this.box;
    const [x, y] = this.turntable.project(point);
    return [left + ((x + 1) * width) / 2, top + ((1 - y) * height) / 2];
  }

  private measure(): void {
    this.box = this.canvas.getBoundingClientRect();
  }

  resize(): void {
    if (this.renderer.xr.isPresenting) return; // a headset has its own size; the session's end calls this again
    this.measure();
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height, false);
    this.turntable.resize(width, height);
    this.needsRedraw = true;
  }

  private get ratio(): number {
    return (this.sharp ? 1 : MOVING_RATIO) * Math.min(devicePixelRatio, 2);
  }

  /** Full resolution only after a while without changes. */
  private updateSharpness(): void {
    clearTimeout(this.timer);
    if (!this.atRest)
      this.timer = setTimeout(() => (this.needsRedraw = this.atRest = true), REST_TIME);
    if (this.sharp !== this.atRest) {
      this.sharp = this.atRest;
      this.renderer.setPixelRatio(this.ratio);
    }
    this.atRest = false;
  }

  requestRedraw(): void {
    this.needsRedraw = true;
  }

  /** Draws if anything has changed and returns whether it did. A headset passes its own camera, and always draws. */
  draw(camera: Camera = this.turntable.camera): boolean {
    this.updateLook();
    if (!this.hasArrays || (!this.needsRedraw && camera === this.turntable.camera)) return false;
    this.needsRedraw = false;
    if (this.softwareRendered && camera === this.turntable.camera) this.updateSharpness();
    if (this.shownLevel) this.tissue.followCamera(camera);
    else this.material.followCamera(camera);
    this.renderer.render(this.root, camera);
    return true;
  }
}
