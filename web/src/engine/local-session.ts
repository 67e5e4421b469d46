// A session in the page itself, in place of a server: it takes and sends the same messages.
import { CommandKind, MARK_KIND, MOST_NOTES, NOTE_KIND, NoteStep, RATE, SCALPEL_KIND, TOOLCOMMAND_KIND, TOOLS, decodeMark, decodeToolCommand, type ToolCommand } from "../protocol/server-messages";
import { Exam, type ExamRules } from "./exam";
import { examFrameMessage, frameMessage } from "./frame-message";
import { notesMessage, readNote } from "../protocol/text-messages";
import type { SceneArrays } from "../protocol/scene-arrays";
import type { BodyBuilder } from "./body-builder";
import { LocalCuts } from "./local-cuts";
import { SessionRecord } from "./session-record";
import { TickClock } from "./tick-clock";
import type { EngineFrame, TouchEngine } from "./touch-engine";

export class LocalSession {
  private ticks = 0;
  private readonly waiting: (ToolCommand | null)[] = Array(TOOLS).fill(null); // newest commands, for the next tick
  private readonly record: SessionRecord;
  private readonly exam: Exam | null;
  private readonly cuts: LocalCuts;
  private readonly clock = new TickClock((ticks) => this.run(ticks), () => this.show(), () => this.cuts.prepare() || this.engine.prepare());

  /** builder: of the bodies that cuts make. organ: what is drawn first. present: shows what is drawn from now on. rules: of the lesson whose case it is. tell: shows the person a text. */
  constructor(
    private readonly engine: TouchEngine, builder: BodyBuilder, organ: SceneArrays, private readonly post: (message: ArrayBuffer) => void,
    present: (organ: SceneArrays) => void, rules: ExamRules | null, private readonly tell: (text: string) => void,
  ) {
    this.record = new SessionRecord(engine, rules?.lesson ?? "");
    this.exam = rules && new Exam(rules);
    this.cuts = new LocalCuts(engine, builder, this.record, organ, (command) => this.queue({ ...command, serial: this.clock.asked }), present, tell);
  }

  /** Runs by the clock from now on. */
  start(): void {
    this.clock.start();
  }

  /** Takes a message of the page. */
  send(data: ArrayBuffer): void {
    const kind = new DataView(data).getUint8(0);
    if (kind === NOTE_KIND) return this.exam ? undefined : this.note(data);
    if (kind === MARK_KIND) return this.mark(data);
    if (kind === SCALPEL_KIND) return this.exam ? undefined : this.cuts.obey(data);
    if (kind !== TOOLCOMMAND_KIND) return; // there is nothing to compare with and nothing to select
    const command = decodeToolCommand(new DataView(data));
    if (this.exam && !this.exam.allows(command.kind)) return;
    this.queue(command);
  }

  private queue(command: ToolCommand): void {
    this.waiting[command.tool] = command;
    this.clock.asked = command.serial;
  }

  /** A lump was found or a sample taken. */
  private mark(data: ArrayBuffer): void {
    const refused = this.exam?.claim();
    if (refused) return this.tell(refused);
    this.record.addMark(this.ticks, decodeMark(new DataView(data)));
  }

  /** The time of the exam is over: all tools let go. */
  private end(): void {
    this.waiting.forEach((_, tool) => {
      this.waiting[tool] = { tool, kind: CommandKind.away, serial: this.clock.asked, point: [0, 0, 0], displacement: [0, 0, 0] };
    });
    this.tell("The time is over.");
  }

  /** Keeps a note, or removes one, and says which there are. The page has cleaned its text. */
  private note(data: ArrayBuffer): void {
    const { note: { step, index, point }, text } = readNote(data), { notes } = this.record;
    if (step === NoteStep.add && notes.length < MOST_NOTES) notes.push({ tick: this.ticks, point, text });
    else if (step === NoteStep.remove && notes[index]?.text === text) notes.splice(index, 1);
    this.post(notesMessage(notes));
  }

  /** The session up to now, which `palpate score` reads. */
  recorded(): string {
    return this.record.text(this.ticks);
  }

  private obey(): void {
    for (const command of this.waiting) {
      if (!command) continue;
      this.waiting[command.tool] = null;
      this.engine.command(command.tool, command.kind, command.point, command.displacement, command.serial);
      this.record.addCommand(this.ticks, command);
    }
  }

  private run(due: number): void {
    this.cuts.change(this.ticks);
    this.obey();
    for (let i = 0; i < due; i++) {
      this.engine.step(1);
      this.record.addTick(++this.ticks);
    }
  }

  private show(): number {
    const state = this.engine.frame();
    if (this.exam?.ends(state.tick, state.contact)) this.end();
    this.post(this.message(state));
    return state.serial;
  }

  private message({ shown, ...state }: EngineFrame): ArrayBuffer {
    const unknown = { mesh_error: NaN, linearisation: NaN, stiffness_spread: NaN, least_volume: NaN, solution_age: 0, solution_error: 0, body: this.cuts.bodies };
    const { late, busy } = this.clock;
    const frame = { ...state, ...unknown, model: 0, chosen: 0, late, busy, seconds: this.ticks / RATE };
    return this.exam ? examFrameMessage({ ...frame, late: 0, busy: 0 }, shown) : frameMessage(frame, shown);
  }
}
