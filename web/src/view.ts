// Draws the organ, what lies inside, and the tool.
import {
  ArrowHelper, BufferAttribute, BufferGeometry, DirectionalLight, DoubleSide, DynamicDrawUsage, HemisphereLight,
  LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, MeshPhongMaterial, Scene as World, SphereGeometry, Vector3, WebGLRenderer,
} from "three";
import { Turntable } from "./camera";
import { Felt, moved, type Colouring } from "./colour";
import { edges, length } from "./geometry";
import type { Organ, Shape } from "./link";
import type { Frame, Vector } from "./messages";

const FLESH: Vector = [0.56, 0.2, 0.17]; // linear light
const INSIDE = [0x5a3fc0, 0x0a7f6a, 0xb8860b];

export class View {
  readonly turntable = new Turntable();
  private readonly renderer: WebGLRenderer;
  private readonly world = new World();
  private readonly geometry = new BufferGeometry();
  private readonly flesh = new MeshPhongMaterial({ vertexColors: true, shininess: 26, specular: 0x332a2a });
  private readonly lines = new LineBasicMaterial({ vertexColors: true });
  private skin = new Mesh(this.geometry, this.flesh);
  // Fills the depth buffer only: hides lines behind the organ, and lets one layer of translucent skin through.
  private veil = new Mesh(this.geometry, new MeshBasicMaterial({ colorWrite: false, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
  private wire = new LineSegments(new BufferGeometry(), this.lines);
  private inner: Mesh[] = [];
  private readonly tip = new Mesh(new SphereGeometry(1, 24, 16), new MeshPhongMaterial({ color: 0x0b7480, shininess: 60 }));
  private readonly arrow = new ArrowHelper(new Vector3(0, 0, 1), new Vector3(), 1, 0x0b7480);
  private organ: Organ | null = null;
  private felt: Felt | null = null;
  private wireframe = false;
  private translucent = false;
  private colouring: Colouring = "plain";
  private due = true;
  private still = true; // the last frame showed the organ at rest and untouched
  size = 1; // mm, radius of the organ
  thin = 1; // mm, its smallest side

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    const sun = new DirectionalLight(0xffffff, 2.3);
    sun.position.set(-0.5, 0.8, 1);
    this.turntable.camera.add(sun, sun.target); // a lamp over the left shoulder
    sun.target.position.set(0, 0, -1);
    this.world.add(this.turntable.camera, new HemisphereLight(0xffffff, 0x8a8fa0, 1.5), this.tip, this.arrow);
    this.tip.visible = this.arrow.visible = false;
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  /** Another organ: all arrays anew. */
  show(organ: Organ): void {
    const { scene, rest, triangles } = organ;
    const same = this.organ?.rest.length === rest.length;
    this.organ = organ;
    this.felt = new Felt(organ);
    this.world.remove(this.skin, this.wire, ...this.inner);
    const attribute = (array: Float32Array) => new BufferAttribute(array, 3).setUsage(DynamicDrawUsage);
    const position = attribute(rest.slice()), normal = attribute(organ.normals.slice()), color = attribute(rest.slice());
    const drawn = (geometry: BufferGeometry, index: Uint32Array) =>
      geometry.setIndex(new BufferAttribute(index, 1)).setAttribute("position", position).setAttribute("normal", normal).setAttribute("color", color);
    const part = (first: number, count: number) => triangles.slice(3 * first, 3 * (first + count));
    const skin = scene.parts.find((p) => !p.inside)!;
    this.skin = new Mesh(drawn(this.geometry, part(skin.first, skin.count)), this.flesh);
    this.wire = new LineSegments(drawn(new BufferGeometry(), edges(triangles, skin.first, skin.count)), this.lines);
    this.inner = scene.parts.filter((p) => p.inside).map((p, i) => {
      const material = new MeshPhongMaterial({ color: INSIDE[i % INSIDE.length], emissive: INSIDE[i % INSIDE.length], emissiveIntensity: 0.4, side: DoubleSide });
      return new Mesh(drawn(new BufferGeometry(), part(p.first, p.count)), material);
    });
    for (const thing of [this.skin, this.veil, this.wire, ...this.inner]) thing.frustumCulled = false; // it moves
    this.world.add(this.skin, this.veil, this.wire, ...this.inner);
    this.style();
    this.paint();
    if (!same) this.frame(rest, scene.front);
  }

  private frame(rest: Float32Array, front: number): void {
    const low: Vector = [Infinity, Infinity, Infinity], high: Vector = [-Infinity, -Infinity, -Infinity];
    rest.forEach((x, i) => ((low[i % 3] = Math.min(low[i % 3], x)), (high[i % 3] = Math.max(high[i % 3], x))));
    const centre = low.map((x, k) => (x + high[k]) / 2) as Vector;
    this.size = Math.hypot(...low.map((x, k) => high[k] - x)) / 2;
    this.thin = Math.min(...low.map((x, k) => high[k] - x));
    this.turntable.frame(centre, this.size, front);
  }

  /** Takes a frame in (pressing: by the tool that feels); gives the shape it no longer needs. */
  move(frame: Frame, shape: Shape, pressing: boolean): Shape {
    const position = this.geometry.getAttribute("position") as BufferAttribute;
    const normal = this.geometry.getAttribute("normal") as BufferAttribute;
    const old = { positions: position.array, normals: normal.array } as Shape;
    position.array = shape.positions;
    normal.array = shape.normals;
    position.needsUpdate = normal.needsUpdate = true;
    if (pressing) this.felt?.add(frame);
    if (this.colouring !== "plain" && !this.still) this.paint();
    this.point(frame);
    const still = frame.count === 0 && frame.grip !== 1;
    if (!still || !this.still) this.due = true;
    this.still = still;
    return old;
  }

  /** The tool, where the contact's mean is, and the force that it feels. */
  private point(frame: Frame): void {
    this.tip.visible = this.arrow.visible = frame.grip === 1;
    if (frame.grip !== 1) return;
    const radius = 0.035 * this.size, force = length(frame.force);
    const place = new Vector3(...frame.point).add(new Vector3(...frame.displacement));
    this.tip.position.copy(place);
    this.tip.scale.setScalar(radius);
    this.arrow.visible = force > 0.005;
    this.arrow.position.copy(place);
    this.arrow.setDirection(new Vector3(...frame.force).normalize());
    this.arrow.setLength(this.size * (0.12 + 0.45 * (force / (force + 1))), 0.1 * this.size, 0.05 * this.size);
  }

  private paint(): void {
    if (!this.organ) return;
    const color = this.geometry.getAttribute("color") as BufferAttribute;
    const out = color.array as Float32Array;
    if (this.colouring === "moved") this.scale(0, moved(this.organ.rest, this.positions, FLESH, out), "mm");
    else if (this.colouring === "felt") {
      const range = this.felt!.colours(FLESH, out);
      this.scale(range?.[0], range?.[1], "N/mm");
    } else for (let i = 0; i < out.length; i += 3) out.set(FLESH, i);
    color.needsUpdate = true;
    this.due = true;
  }

  /** Called with the ends of the colour scale; undefined when there is nothing to show. */
  scale: (low: number | undefined, high: number | undefined, unit: string) => void = () => undefined;

  set colours(colouring: Colouring) {
    this.colouring = colouring;
    this.paint();
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
    this.flesh.transparent = translucent;
    this.flesh.opacity = translucent ? 0.45 : 1;
    this.flesh.needsUpdate = true;
    for (const mesh of this.inner) mesh.visible = translucent;
    this.due = true;
  }

  /** Where each shown node is drawn, mm. */
  get positions(): Float32Array {
    return this.geometry.getAttribute("position").array as Float32Array;
  }

  /** Pixel of the window to -1..1, and back. */
  toView(x: number, y: number): [number, number] {
    const box = this.canvas.getBoundingClientRect();
    return [(2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height];
  }
  toPixel(point: Vector): [number, number] {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = this.turntable.project(point);
    return [box.left + ((x + 1) * box.width) / 2, box.top + ((1 - y) * box.height) / 2];
  }

  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.turntable.resize(width, height);
    this.due = true;
  }

  touched(): void {
    this.due = true;
  }

  /** Draws if anything has changed; says whether it did. */
  draw(): boolean {
    if (!this.due) return false;
    this.due = false;
    this.renderer.render(this.world, this.turntable.camera);
    return true;
  }
}
