// Draws the tools of the other people in a room: a ball or a needle in the person's color, and the force as an arrow.
import { ArrowHelper, CylinderGeometry, Group, Mesh, MeshPhongMaterial, SphereGeometry, Vector3 } from "three";
import { add, length, scale, unit } from "../organ/mesh-geometry";
import type { OtherHand } from "../protocol/room-messages";
import { ContactState, TOOLS, type Vector } from "../protocol/server-messages";
import { personColor } from "./person-colors";

const MIN_FORCE = 0.005; // N: no arrow below
const OUT = new Vector3(0, 0, 1), UP = new Vector3(0, 1, 0);

interface Drawn {
  tip: Mesh<SphereGeometry, MeshPhongMaterial>;
  shaft: Mesh<CylinderGeometry, MeshPhongMaterial>;
  arrow: ArrowHelper;
}

export class OtherHands {
  readonly group = new Group();
  size = 1; // mm, radius of the organ
  /** Where the hands are drawn, mm, and whose they are. */
  places: { person: number; number: number; at: Vector; force: number }[] = [];
  private readonly drawn: Drawn[];

  constructor() {
    this.drawn = Array.from({ length: TOOLS }, () => {
      const material = new MeshPhongMaterial({ shininess: 60 });
      const one = { tip: new Mesh(new SphereGeometry(1, 20, 12), material), shaft: new Mesh(new CylinderGeometry(1, 0.3, 1, 10), material), arrow: new ArrowHelper(OUT, new Vector3(), 1) };
      this.group.add(one.tip, one.shaft, one.arrow);
      return one;
    });
    this.update([], (point) => point);
  }

  /** Moves them. gape: how far the organ has opened at a point, mm. Returns whether anything is drawn, or was. */
  update(hands: OtherHand[], gape: (point: Vector) => Vector): boolean {
    const before = this.places.length;
    const shown = hands.filter(({ contact }) => contact === ContactState.closed || contact === ContactState.open || contact === ContactState.carrying);
    this.places = shown.map(({ person, number, point, displacement, force }) => ({ person, number, at: add(add(point, gape(point)), displacement), force: length(force) }));
    this.drawn.forEach(({ tip, shaft, arrow }, i) => {
      const hand = shown[i], place = this.places[i];
      tip.visible = hand !== undefined && hand.insertion === 0;
      shaft.visible = hand !== undefined && hand.insertion > 0;
      arrow.visible = hand !== undefined && place.force > MIN_FORCE;
      if (!hand) return;
      const color = personColor(hand.person);
      tip.material.color.setHex(color);
      arrow.setColor(color);
      tip.position.set(...place.at);
      tip.scale.setScalar(0.035 * this.size);
      if (shaft.visible) {
        const along = unit(hand.displacement), long = 1.7 * this.size, outside = add(place.at, scale(along, hand.insertion - long / 2));
        shaft.position.set(...outside);
        shaft.scale.set(0.012 * this.size, long, 0.012 * this.size);
        shaft.quaternion.setFromUnitVectors(UP, new Vector3(...along).negate());
      }
      if (!arrow.visible) return;
      arrow.position.set(...place.at);
      arrow.setDirection(new Vector3(...hand.force).normalize());
      arrow.setLength(this.size * (0.12 + 0.45 * (place.force / (place.force + 1))), 0.1 * this.size, 0.05 * this.size);
    });
    return before > 0 || shown.length > 0;
  }
}
