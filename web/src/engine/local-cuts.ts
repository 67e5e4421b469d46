// Cuts in the page's own session: the stroke of a hand, the cut that follows it, and undo. A worker makes each body that
// comes, while the session goes on.
import type { SceneArrays } from "../protocol/scene-arrays";
import { CommandKind, CutStep, decodeScalpel, type ToolCommand, type Vector } from "../protocol/server-messages";
import type { BodyBuilder } from "./body-builder";
import { CuttingStroke } from "./cutting-stroke";
import type { SessionRecord } from "./session-record";
import { Change, CutRefused, type OpenedBody, type TouchEngine } from "./touch-engine";

const BLADE = 0; // the tool that feels as the blade does
const NO_BLADE = new Float64Array();
const MOST_CUTS = 100; // changes of the body, whose cost grows with their number

/** A change of the body that is being made. */
interface Making {
  how: Change;
  blade: Float64Array; // empty: a cut is taken back
  arrived: boolean; // the body's arrays, or the engine has kept the body
}

export class LocalCuts {
  private stroke: CuttingStroke | null = null;
  private undoing = false; // a cut is to be taken back
  private making: Making | null = null;
  private readonly blades: Float64Array[] = []; // of the cuts that there are, beside those that the organ came with
  private area: number; // mm² of all of these
  private taken: number[]; // mm³ that they have freed, by region
  private before = { area: 0, taken: 0 }; // the stroke
  bodies = 0; // how often the body has been changed

  /** first: the organ as it came. command: to the loop's tools. present: the organ that is drawn from now on. tell: a text. */
  constructor(
    private readonly engine: TouchEngine,
    private readonly builder: BodyBuilder,
    private readonly record: SessionRecord,
    private readonly first: SceneArrays,
    private readonly command: (command: Omit<ToolCommand, "serial">) => void,
    private readonly present: (organ: SceneArrays) => void,
    private readonly tell: (text: string) => void,
  ) {
    this.area = engine.first?.area ?? 0;
    this.taken = engine.first?.taken ?? engine.parts.map(() => 0);
  }

  /** Takes a `Scalpel` message. */
  obey(data: ArrayBuffer): void {
    const { step, depth, point, direction } = decodeScalpel(new DataView(data)), { stroke } = this;
    if (step === CutStep.undo) this.undoing ||= !stroke && !this.making && this.blades.length > 0;
    else if (step === CutStep.begin) this.enter(new CuttingStroke(point, Math.min(depth, 2 * this.first.scene.reach), direction, this.engine.edge)); // through all of it
    else if (stroke && !stroke.ended) {
      stroke.add(point);
      stroke.ended = step === CutStep.end;
      this.feel(stroke);
    }
    this.makeNext();
  }

  /** Between two ticks: changes the body, if the next one is there. ticks: that have run. */
  change(ticks: number): void {
    const { making, engine, blades } = this;
    if (!making?.arrived || engine.copy()) return; // some of it here too: a clock that is behind leaves no time between
    this.making = null;
    const { how, blade } = making, left = blades.length + (how === Change.once ? 1 : how === Change.undone ? -1 : 0);
    this.attempt(() => {
      const opened = this.keeps(left) ? engine.change(how, left) : engine.adopt(how, left, blade);
      this.takeOver(ticks, how, blade, opened);
    });
    this.makeNext();
  }

  /** Some of the work for the next body, while no tick is due. False: there was none. */
  prepare(): boolean {
    return this.making?.arrived === true && this.engine.copy();
  }

  private enter(stroke: CuttingStroke): void {
    if (this.stroke || this.making || this.undoing) return;
    if (this.bodies >= MOST_CUTS) return this.tell(`The organ was cut, or a cut taken back, ${MOST_CUTS} times: begin another session.`);
    this.stroke = stroke;
    this.before = { area: this.area, taken: sum(this.taken) };
    this.builder.begin();
    this.engine.enter();
    this.feel(stroke);
  }

  /** Has the next body made, if one is due and none is being made. */
  private makeNext(): void {
    const { stroke, blades } = this;
    if (this.making) return;
    if (this.undoing) {
      this.undoing = false;
      if (this.keeps(blades.length - 1)) this.making = { how: Change.undone, blade: NO_BLADE, arrived: true };
      else this.make(Change.undone, NO_BLADE, blades.slice(0, -1));
    } else if (stroke?.due) {
      const further = stroke.cut > 0;
      this.attempt(() => {
        const blade = this.engine.incision(stroke.follow(), stroke.depth, stroke.direction);
        this.make(further ? Change.further : Change.once, blade, [...blades.slice(0, further ? -1 : undefined), blade]);
      });
    } else if (stroke?.ended) {
      this.stroke = null;
      const { area, taken } = this.before;
      if (this.area > area) this.tell(`Cut of ${Math.round(this.area - area)} mm².${this.toldOfPieces(sum(this.taken) - taken)}`);
    }
  }

  /** Whether the engine still has the body with so many cuts: that before all. */
  private keeps(left: number): boolean {
    return left === 0 && this.engine.first === null;
  }

  private make(how: Change, blade: Float64Array, cuts: Float64Array[]): void {
    const making: Making = (this.making = { how, blade, arrived: false });
    this.builder.build(cuts).then(
      (arrays) => {
        this.engine.receive(arrays);
        making.arrived = true;
      },
      (text: string) => {
        this.making = null;
        this.refuse(text);
      },
    );
  }

  private takeOver(ticks: number, how: Change, blade: Float64Array, opened: OpenedBody | null): void {
    const { blades, record } = this;
    if (how !== Change.once) blades.pop();
    if (how === Change.undone) record.addUndo(ticks);
    else {
      blades.push(blade);
      record.addCut(ticks, blade, how === Change.further);
    }
    this.show(opened);
  }

  /** Does what the engine may refuse. */
  private attempt(act: () => void): void {
    try {
      act();
    } catch (problem) {
      const refused = problem instanceof CutRefused;
      this.refuse(refused ? problem.message : "The engine has failed, perhaps for want of memory: save the session, and open the page again.");
      if (!refused) throw problem; // no tick runs any more
    }
  }

  /** The cut is not made: the blade comes out. */
  private refuse(text: string): void {
    const { stroke } = this;
    this.tell(text);
    this.stroke = null;
    if (stroke && !stroke.ended) {
      stroke.ended = true;
      this.feel(stroke);
    }
  }

  /** The loop's blade goes to the end of the way, or out of the tissue. */
  private feel({ way, end, depth, direction, ended }: CuttingStroke): void {
    const displacement: Vector = ended ? [0, 0, 0] : this.engine.bladeEdge(way[0], depth, direction);
    this.command({ tool: BLADE, kind: ended ? CommandKind.away : CommandKind.blade, point: end, displacement });
  }

  private show(opened: OpenedBody | null): void {
    this.bodies++;
    const { first, bodies } = this, now = opened ?? this.engine.first;
    this.area = now?.area ?? 0;
    this.taken = now?.taken ?? this.taken.map(() => 0);
    const { scene, ...arrays } = opened ? withBody(first, opened) : first;
    this.present({ scene: { ...scene, body: bodies, made: this.blades.length }, ...arrays });
  }

  /** What of the organ has come free now, mm³, and how much of each part inside is out by now. */
  private toldOfPieces(now: number): string {
    if (!(now > 0)) return "";
    const { parts } = this.engine, out = parts.flatMap(({ name, volume }, i) => (i > 0 && this.taken[i] > 0 ? [`${Math.round((100 * this.taken[i]) / volume)}% of ${name}`] : []));
    return ` ${Number((now / 1000).toPrecision(2))} ml came free and were taken away${out.length ? `: ${out.join(", ")}` : ""}.`;
  }
}

const sum = (values: number[]): number => values.reduce((total, x) => total + x, 0);

/** The organ as it is drawn once it was cut. */
export function withBody({ scene }: SceneArrays, { rest, triangles, lips }: OpenedBody): SceneArrays {
  const count = triangles.length / 3, parts = [{ name: "organ", first: 0, count, inside: false }];
  return { scene: { ...scene, nodes: rest.length / 3, triangles: count, parts, lips, gapes: false }, rest, open: rest.slice(), triangles, beside: null };
}
