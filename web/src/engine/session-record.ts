// The record of a session in the page, as JSON that `palpate score` reads: what palpate.simulation.page_record expects.
import type { Mark, NoteText, ToolCommand } from "../protocol/server-messages";
import type { TouchEngine } from "./touch-engine";

const DIGEST_TICKS = 100; // between two digests
const FORMAT = "palpate page session", VERSION = 1;

type Row = (number | string)[];

export class SessionRecord {
  private readonly commands: Row[] = []; // tick, tool, kind, point, displacement
  private readonly digests: Row[] = []; // ticks, hexadecimal digits
  private readonly switches: Row[] = []; // tick, what it lacked
  private readonly marks: Row[] = []; // tick, what, tool
  private readonly cuts: unknown[][] = []; // tick, "cut", "extend" or "undo", points and triangles of the blade
  readonly notes: NoteText[] = [];
  private readonly last: string[] = []; // command of each tool
  private missing = 0;

  /** lesson: which lesson and case it is, as JSON, or nothing. */
  constructor(private readonly engine: TouchEngine, private readonly lesson: string) {}

  /** A command that is obeyed from this tick on. */
  addCommand(tick: number, { tool, kind, point, displacement }: ToolCommand): void {
    const row = [kind, ...point, ...displacement];
    if (this.last[tool] === String(row)) return;
    this.last[tool] = String(row);
    this.commands.push([tick, tool, ...row]);
  }

  addMark(tick: number, { kind, tool }: Mark): void {
    this.marks.push([tick, kind, tool]);
  }

  /** A cut before this tick, or more of the last one; corners: of its blade's triangles, (triangles, 3, 3) mm. */
  addCut(tick: number, corners: Float64Array, further: boolean): void {
    const points = Array.from({ length: corners.length / 3 }, (_, i) => [...corners.subarray(3 * i, 3 * i + 3)]);
    const triangles = Array.from({ length: points.length / 3 }, (_, i) => [3 * i, 3 * i + 1, 3 * i + 2]);
    this.cuts.push([tick, further ? "extend" : "cut", points, triangles]);
  }

  /** The last cut is taken back before this tick. */
  addUndo(tick: number): void {
    this.cuts.push([tick, "undo"]);
  }

  /** A tick has run: now there are so many. */
  addTick(ticks: number): void {
    const missing = this.engine.missingTables;
    if (missing !== this.missing) this.switches.push([ticks - 1, missing]);
    this.missing = missing;
    if (ticks % DIGEST_TICKS === 0) this.digests.push([ticks, this.engine.digest()]);
  }

  text(length: number): string {
    const { commands, digests, switches, marks, cuts, lesson } = this;
    const notes = this.notes.map(({ tick, point, text }) => [tick, ...point, text]);
    return JSON.stringify({ format: FORMAT, version: VERSION, ...this.engine.description, length, commands, digests, switches, marks, notes, ...(cuts.length > 0 && { cuts }), ...(lesson && { lesson }) });
  }
}
