// Cuts in the page's own session: the stroke of a hand, the cut at its end, and undo.
import type { SceneArrays } from "../protocol/scene-arrays";
import { CommandKind, CutStep, decodeScalpel, type ToolCommand } from "../protocol/server-messages";
import { CuttingStroke } from "./cutting-stroke";
import type { SessionRecord } from "./session-record";
import { CutRefused, type OpenedBody, type TouchEngine } from "./touch-engine";

const BLADE = 0; // the tool that feels as the blade does
const MOST_CUTS = 100; // changes of the body, whose cost grows with their number

export class LocalCuts {
  private stroke: CuttingStroke | null = null;
  private due: CuttingStroke | "undo" | null = null; // a change of the body before the next tick
  private made = 0; // cuts that there are
  private area: number; // mm² of these, and of those that the organ came with
  private taken: number[]; // mm³ that these have freed, by region
  bodies = 0; // how often the body has been changed

  /** first: the organ as it came. command: to the loop's tools. present: the organ that is drawn from now on. tell: a text. */
  constructor(
    private readonly engine: TouchEngine,
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
    const { step, depth, point, direction } = decodeScalpel(new DataView(data));
    if (step === CutStep.undo) {
      if (!this.stroke && !this.due && this.made > 0) this.due = "undo";
    } else if (step === CutStep.begin) {
      if (this.stroke || this.due) return;
      this.stroke = new CuttingStroke(point, Math.min(depth, 2 * this.first.scene.reach), direction, this.engine.edge); // through all of it
      this.feel(true);
    } else if (this.stroke) {
      this.stroke.add(point);
      this.feel(step !== CutStep.end);
      if (step === CutStep.end) this.end(this.stroke);
    }
  }

  /** Between two ticks: changes the body, if that is due. ticks: that have run. */
  change(ticks: number): void {
    const { due } = this;
    if (!due) return;
    this.due = null;
    try {
      if (due === "undo") {
        const opened = this.engine.undo(this.made - 1);
        this.record.addUndo(ticks);
        this.made--;
        this.show(opened);
      } else {
        const blade = this.engine.incision(due.path(), due.depth, due.direction), opened = this.engine.cut(blade);
        this.record.addCut(ticks, blade);
        this.made++;
        this.show(opened);
      }
    } catch (problem) {
      const refused = problem instanceof CutRefused;
      this.tell(refused ? problem.message : "The engine has failed, perhaps for want of memory: save the session, and open the page again.");
      if (!refused) throw problem; // no tick runs any more
    }
  }

  private end(stroke: CuttingStroke): void {
    this.stroke = null;
    if (stroke.path().length === 0) return;
    if (this.bodies >= MOST_CUTS) this.tell(`The organ was cut, or a cut taken back, ${MOST_CUTS} times: begin another session.`);
    else this.due = stroke;
  }

  /** The loop's blade goes to the end of the way, or out of the tissue. */
  private feel(cuts: boolean): void {
    const { end, depth } = this.stroke!;
    this.command({ tool: BLADE, kind: cuts ? CommandKind.blade : CommandKind.away, point: end, displacement: [0, 0, cuts ? -depth : 0] });
  }

  private show(opened: OpenedBody | null): void {
    this.bodies++;
    const { first, made, bodies } = this, change = { body: bodies, made };
    const { area, taken } = this, now = opened ?? this.engine.first;
    this.area = now?.area ?? 0;
    this.taken = now?.taken ?? taken.map(() => 0);
    if (this.area > area) this.tell(`Cut of ${Math.round(this.area - area)} mm².${this.toldOfPieces(sum(this.taken) - sum(taken))}`);
    const { scene, ...arrays } = opened ? withBody(first, opened) : first;
    this.present({ scene: { ...scene, ...change }, ...arrays });
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
