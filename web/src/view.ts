// Draws the organ, what lies inside, and the instruments.
import {
  BufferAttribute, BufferGeometry, DirectionalLight, DoubleSide, DynamicDrawUsage, HemisphereLight, LineBasicMaterial,
  LineSegments, Mesh, MeshBasicMaterial, MeshPhongMaterial, Scene as World, WebGLRenderer, type Camera,
} from "three";
import { Turntable } from "./camera";
import { Flesh } from "./gouraud";
import { Instruments } from "./instruments";
import type { Organ, Shape } from "./link";
import type { Frame, Vector } from "./messages";
import { software } from "./software";

// Drawn by the processor, the picture is coarser while it moves: half the pixels, and the hand's delay a fifth less.
const MOVING = 0.7;
const RESTED = 250; // ms without a new picture until it is drawn sharp
const INSIDE = [0x5a3fc0, 0x0a7f6a, 0xb8860b];

export class View {
  readonly turntable = new Turntable();
  readonly renderer: WebGLRenderer;
  readonly world = new World();
  readonly instruments = new Instruments();
  private readonly geometry = new BufferGeometry();
  private readonly flesh = new Flesh();
  private readonly lines = new LineBasicMaterial({ vertexColors: true });
  private skin = new Mesh(this.geometry, this.flesh);
  // Fills the depth buffer only: hides lines behind the organ, and lets one layer of translucent skin through.
  private veil = new Mesh(this.geometry, new MeshBasicMaterial({ colorWrite: false, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
  private wire = new LineSegments(new BufferGeometry(), this.lines);
  private inner: Mesh[] = [];
  private wireframe = false;
  private translucent = false;
  private due = true;
  private still = true; // the last frame showed the organ at rest and untouched
  private shown = false; // a shape of this organ has come
  private readonly slow = software();
  private sharp = true;
  private rested = true;
  private timer = 0;
  private box = { left: 0, top: 0, width: 1, height: 1 };
  size = 0; // mm, radius of the organ
  thin = 1; // mm, its smallest side
  centre: Vector = [0, 0, 0];

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: !this.slow, alpha: !this.slow });
    if (this.slow) this.backdrop();
    const sun = new DirectionalLight(0xffffff, 2.3);
    sun.position.set(-0.5, 0.8, 1);
    this.turntable.camera.add(sun, sun.target); // a lamp over the left shoulder
    sun.target.position.set(0, 0, -1);
    this.world.add(this.turntable.camera, new HemisphereLight(0xffffff, 0x8a8fa0, 1.5), this.instruments.group);
    new ResizeObserver(() => this.resize()).observe(canvas);
    addEventListener("resize", () => this.measure());
    addEventListener("scroll", () => this.measure(), true);
    this.resize();
  }

  /** A canvas that nothing shines through has the stage's colour itself. */
  private backdrop(): void {
    const dark = matchMedia("(prefers-color-scheme: dark)");
    const fill = () => {
      this.renderer.setClearColor(getComputedStyle(this.canvas).getPropertyValue("--ground").trim());
      this.due = true;
    };
    fill();
    dark.addEventListener("change", fill);
  }

  /** Another organ: all arrays anew. A finer mesh of the same one is seen from where the last was. */
  show(organ: Organ): void {
    const { scene, rest, triangles } = organ;
    this.shown = false;
    this.world.remove(this.skin, this.wire, ...this.inner);
    for (const old of [this.skin, this.wire, ...this.inner]) old.geometry.dispose();
    const attribute = (array: Float32Array | Int16Array | Uint8Array, items: number) =>
      new BufferAttribute(array, items, items === 4).setUsage(DynamicDrawUsage);
    const nodes = rest.length / 3;
    const position = attribute(rest.slice(), 3), normal = attribute(new Int16Array(4 * nodes), 4), color = attribute(new Uint8Array(4 * nodes), 4);
    const drawn = (geometry: BufferGeometry, index: Uint32Array) =>
      geometry.setIndex(new BufferAttribute(index, 1)).setAttribute("position", position).setAttribute("normal", normal).setAttribute("color", color);
    const part = (first: number, count: number) => triangles.slice(3 * first, 3 * (first + count));
    const skin = scene.parts.find((p) => !p.inside)!;
    this.skin = new Mesh(drawn(this.geometry, part(skin.first, skin.count)), this.flesh);
    this.wire = new LineSegments(drawn(new BufferGeometry(), organ.edges), this.lines);
    this.inner = scene.parts.filter((p) => p.inside).map((p, i) => {
      const material = new MeshPhongMaterial({ color: INSIDE[i % INSIDE.length], emissive: INSIDE[i % INSIDE.length], emissiveIntensity: 0.4, side: DoubleSide });
      return new Mesh(drawn(new BufferGeometry(), part(p.first, p.count)), material);
    });
    for (const thing of [this.skin, this.veil, this.wire, ...this.inner]) thing.frustumCulled = false; // it moves
    this.world.add(this.skin, this.veil, this.wire, ...this.inner);
    this.style();
    this.frame(rest, scene.front);
  }

  private frame(rest: Float32Array, front: number): void {
    const low: Vector = [Infinity, Infinity, Infinity], high: Vector = [-Infinity, -Infinity, -Infinity];
    rest.forEach((x, i) => ((low[i % 3] = Math.min(low[i % 3], x)), (high[i % 3] = Math.max(high[i % 3], x))));
    const centre = low.map((x, k) => (x + high[k]) / 2) as Vector;
    const size = Math.hypot(...low.map((x, k) => high[k] - x)) / 2;
    const other = Math.hypot(...centre.map((x, k) => x - this.centre[k])) > 0.1 * size || Math.abs(size - this.size) > 0.1 * size;
    this.centre = centre;
    this.size = size;
    this.thin = Math.min(...low.map((x, k) => high[k] - x));
    this.instruments.size = size;
    if (other) this.turntable.frame(centre, size, front);
  }

  /** Takes a frame in; gives the shape it no longer needs. No shape: the organ has not moved. */
  move(frame: Frame, shape: Shape | null): Shape | null {
    const idle = frame.grip.every((grip) => grip === 0);
    const still = shape === null && idle;
    if (!still || !this.still) this.due = true;
    this.still = still;
    this.instruments.move(frame);
    if (!shape) return null;
    this.shown = true;
    const [position, normal, color] = ["position", "normal", "color"].map((name) => this.geometry.getAttribute(name) as BufferAttribute);
    const old = { positions: position.array, normals: normal.array, colours: color.array } as Shape;
    position.array = shape.positions;
    normal.array = shape.normals;
    color.array = shape.colours;
    position.needsUpdate = normal.needsUpdate = color.needsUpdate = true;
    return old;
  }

  set drawing(wireframe: boolean) {
    this.wireframe = wireframe;
    this.style();
  }
  set seeInside(translucent: boolean) {
    this.translucent = translucent;
    this.style();
  }

  private style(): void {
    const { wireframe, translucent } = this;
    this.wire.visible = wireframe;
    this.skin.visible = !wireframe;
    this.veil.visible = wireframe !== translucent;
    this.veil.renderOrder = translucent ? 1 : -1; // behind the skin, but not behind what lies inside
    this.flesh.translucent = translucent;
    for (const mesh of this.inner) mesh.visible = translucent;
    this.due = true;
  }

  /** Where each shown node is drawn, mm. */
  get positions(): Float32Array {
    return this.geometry.getAttribute("position").array as Float32Array;
  }

  /** Pixel of the window to -1..1, and back. */
  toView(x: number, y: number): [number, number] {
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
    if (this.renderer.xr.isPresenting) return; // the headset's own size; measured again when it is taken off
    this.measure();
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height, false);
    this.turntable.resize(width, height);
    this.due = true;
  }

  private get ratio(): number {
    return (this.sharp ? 1 : MOVING) * Math.min(devicePixelRatio, 2);
  }

  /** Sharp only once nothing has moved for a while. */
  private focus(): void {
    clearTimeout(this.timer);
    if (!this.rested)
      this.timer = setTimeout(() => (this.due = this.rested = true), RESTED);
    if (this.sharp !== this.rested) {
      this.sharp = this.rested;
      this.renderer.setPixelRatio(this.ratio);
    }
    this.rested = false;
  }

  touched(): void {
    this.due = true;
  }

  /** Draws if anything has changed; says whether it did. A headset draws through a camera of its own. */
  draw(camera: Camera = this.turntable.camera): boolean {
    if (!this.shown || (!this.due && camera === this.turntable.camera)) return false;
    this.due = false;
    if (this.slow && camera === this.turntable.camera) this.focus();
    this.flesh.light(camera);
    this.renderer.render(this.world, camera);
    return true;
  }
}
