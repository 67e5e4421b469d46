// What the hands hold: a tip with the arrow of its force for each tool, a needle, and the keyboard's cursor.
import { ArrowHelper, CylinderGeometry, Group, Mesh, MeshBasicMaterial, MeshPhongMaterial, RingGeometry, SphereGeometry, Vector3 } from "three";
import { add, length, slot, times, unit } from "./geometry";
import type { Frame, Vector } from "./messages";

const TEAL = 0x0b7480, STEEL = 0xc9d2d8, FREE = 3;
const UP = new Vector3(0, 1, 0), OUT = new Vector3(0, 0, 1);

/** The tool that is a needle; the others are tips. */
export const NEEDLE = 3;

export class Instruments {
  readonly group = new Group();
  size = 1; // mm, radius of the organ
  private readonly tips: Mesh[] = [];
  private readonly arrows: ArrowHelper[] = [];
  private readonly shaft = new Mesh(new CylinderGeometry(1, 1, 1, 12), new MeshPhongMaterial({ color: STEEL, shininess: 120 }));
  private readonly point = new Mesh(new CylinderGeometry(1, 0.05, 1, 12), new MeshPhongMaterial({ color: STEEL, shininess: 120 }));
  private readonly hub = new Mesh(new CylinderGeometry(1, 1, 1, 16), new MeshPhongMaterial({ color: TEAL, shininess: 60 }));
  private readonly ring = new Mesh(new RingGeometry(0.75, 1, 40), new MeshBasicMaterial({ color: TEAL, depthTest: false, transparent: true, side: 2 }));
  private readonly dot = new Mesh(new RingGeometry(0, 0.2, 20), this.ring.material);

  /** Where each tool ends, mm; a needle at its point. */
  readonly ends: Vector[] = [0, 1, 2, 3].map(() => [0, 0, 0]);
  private readonly axes: (Vector | null)[] = [null, null, null, null]; // of needles, seen before they pierced

  constructor() {
    for (let i = 0; i < 4; i++) {
      this.tips.push(new Mesh(new SphereGeometry(1, 24, 16), new MeshPhongMaterial({ color: TEAL, shininess: 60 })));
      this.arrows.push(new ArrowHelper(OUT, new Vector3(), 1, TEAL));
    }
    this.ring.add(this.dot);
    this.ring.renderOrder = 9;
    this.dot.renderOrder = 9;
    this.group.add(...this.tips, ...this.arrows, this.shaft, this.point, this.hub, this.ring);
    for (const each of this.group.children) each.visible = false;
  }

  /** Puts each tool where the frame says it is, with its force. */
  move(frame: Frame): void {
    let needle = false;
    for (let i = 0; i < this.tips.length; i++) {
      const there = frame.grip[i] === 1 || frame.grip[i] === FREE;
      const way = slot(frame.displacement, i), start = slot(frame.point, i), force = slot(frame.force, i);
      const pierces = there && (i === NEEDLE || frame.inside[i] > 0);
      this.tips[i].visible = there && !pierces;
      this.arrows[i].visible = there && length(force) > 0.005;
      if (!there) {
        this.axes[i] = null;
        continue;
      }
      const held = add(start, way); // where the tissue goes with the tool
      const axis = this.axis(i, way, frame.inside[i]);
      this.ends[i] = pierces ? add(held, times(axis, frame.inside[i])) : held;
      this.tips[i].position.set(...held);
      this.tips[i].scale.setScalar(0.035 * this.size);
      if (pierces) this.pierce(new Vector3(...this.ends[i]), axis);
      needle ||= pierces;
      this.arrow(this.arrows[i], new Vector3(...held), force);
    }
    this.shaft.visible = this.point.visible = this.hub.visible = needle;
  }

  /** A needle's direction: until it pierces the tissue goes before it, and shows. */
  private axis(tool: number, way: Vector, inside: number): Vector {
    if (inside === 0 && length(way) > 0.01) this.axes[tool] = unit(way);
    return this.axes[tool] ?? unit(way);
  }

  private arrow(arrow: ArrowHelper, place: Vector3, force: Vector): void {
    const size = length(force);
    if (!arrow.visible) return;
    arrow.position.copy(place);
    arrow.setDirection(new Vector3(...force).normalize());
    arrow.setLength(this.size * (0.12 + 0.45 * (size / (size + 1))), 0.1 * this.size, 0.05 * this.size);
  }

  /** A thin shaft that ends at its point; the organ hides what is inside it, unless it is translucent. */
  private pierce(tip: Vector3, way: Vector): void {
    const along = new Vector3(...way), thick = 0.009 * this.size, sharp = 6 * thick, long = 1.7 * this.size, hub = 0.16 * this.size;
    const put = (mesh: Mesh, from: number, to: number, radius: number) => {
      mesh.position.copy(tip).addScaledVector(along, -(from + to) / 2);
      mesh.scale.set(radius, to - from, radius);
      mesh.quaternion.setFromUnitVectors(UP, along.clone().negate());
    };
    put(this.point, 0, sharp, thick);
    put(this.shaft, sharp, long, thick);
    put(this.hub, long, long + hub, 3.2 * thick);
  }

  /** The cursor on the surface, or none. Gives whether that changed the picture. */
  cursor(place: Vector | null, normal: Vector = [0, 0, 1]): boolean {
    const before = this.ring.visible, old = this.ring.position.toArray();
    this.ring.visible = place !== null;
    if (!place) return before;
    this.ring.position.set(...place);
    this.ring.scale.setScalar(0.075 * this.size);
    this.ring.quaternion.setFromUnitVectors(OUT, new Vector3(...normal).normalize());
    return !before || old.some((x, i) => x !== place[i]);
  }
}
