// A session in the page itself, in place of a server: it takes and sends the same messages.
import {
  AT_REST, DISPLACEMENT_STEPS, FRAME_BYTES, MARK_KIND, MOST_NOTES, NOTE_KIND, NoteStep, TOOLCOMMAND_KIND, TOOLS, decodeMark, decodeToolCommand, encodeFrame, type Frame, type ToolCommand,
} from "../protocol/server-messages";
import { notesMessage, readNote } from "../protocol/text-messages";
import { SessionRecord } from "./session-record";
import type { EngineFrame, TouchEngine } from "./touch-engine";

const RATE = 1000; // ticks a second
const BATCH = 8; // ticks at most before the clock is read again
const LATE = 16; // ms behind the clock, from which a tick counts as late: a batch begins some ms after its first tick is due
const SLIP = 1000; // ms behind the clock, beyond which time is given up: the page was stopped
const FRAME_TIME = 12; // ms between two frames at least
const ANSWER_TIME = 3; // ms, if it is the first to obey a command

export class LocalSession {
  private began = 0; // ms of the clock, at tick 0
  private ticks = 0;
  private late = 0;
  private busy = 0; // s a tick, smoothed
  private answered = 0; // serial number that the last frame obeys
  private serial = 0; // of the newest command
  private shownAt = -Infinity; // ms, the last frame
  private frameTime = 0; // ms that it took
  private readonly waiting: (ToolCommand | null)[] = Array(TOOLS).fill(null); // newest commands, for the next tick
  private readonly record: SessionRecord;

  constructor(private readonly engine: TouchEngine, private readonly post: (message: ArrayBuffer) => void) {
    this.record = new SessionRecord(engine);
  }

  /** Runs a millisecond's tick for every millisecond of the clock, in batches, from now on. */
  start(): void {
    this.began = performance.now();
    const channel = new MessageChannel(); // a timer would wait for 4 ms or more
    const run = () => {
      if (!this.advance()) setTimeout(run, 1);
      else channel.port2.postMessage(null); // after the commands that wait
    };
    channel.port1.onmessage = run;
    run();
  }

  /** Takes a message of the page. */
  send(data: ArrayBuffer): void {
    const kind = new DataView(data).getUint8(0);
    if (kind === NOTE_KIND) return this.note(data);
    if (kind === MARK_KIND) this.record.addMark(this.ticks, decodeMark(new DataView(data)));
    if (kind !== TOOLCOMMAND_KIND) return; // there is nothing to compare with and nothing to select
    const command = decodeToolCommand(new DataView(data));
    this.waiting[command.tool] = command;
    this.serial = command.serial;
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

  /** Runs the ticks that are due, BATCH at most, or does other work. False: there was none. */
  private advance(): boolean {
    let now = performance.now();
    if (now - this.began - this.ticks > SLIP) {
      this.late += Math.floor(now - this.began - this.ticks);
      this.began = now - this.ticks;
    }
    const behind = now - this.began - this.ticks; // ms, and ticks
    const due = Math.min(BATCH, Math.floor(behind * (RATE / 1000)));
    if (due >= 1) {
      if (behind > LATE) this.late += due;
      this.obey();
      for (let i = 0; i < due; i++) {
        this.engine.step(1);
        this.record.addTick(++this.ticks);
      }
      const done = performance.now();
      this.busy += (1 - 0.99 ** due) * ((done - now) / 1000 / due - this.busy);
      now = done;
    }
    const interval = this.serial === this.answered ? FRAME_TIME : ANSWER_TIME;
    if (now - this.shownAt > Math.max(interval, 2 * this.frameTime)) this.show(now);
    else if (due < 1) return this.engine.prepare();
    return true;
  }

  private show(now: number): void {
    const state = this.engine.frame();
    this.post(this.message(state));
    this.answered = state.serial;
    this.frameTime = performance.now() - now;
    this.shownAt = performance.now();
  }

  private message({ shown, ...state }: EngineFrame): ArrayBuffer {
    let largest = 0;
    for (const x of shown) largest = Math.max(largest, Math.abs(x));
    const step = largest < AT_REST ? 0 : largest / DISPLACEMENT_STEPS;
    const unknown = { mesh_error: NaN, linearisation: NaN, least_volume: NaN, solution_age: 0, solution_error: 0, body: 0 };
    const frame: Frame = {
      ...state, ...unknown, model: 0, chosen: 0, late: this.late, busy: this.busy, seconds: this.ticks / RATE, step, count: step && shown.length / 3,
    };
    const head = new Uint8Array(encodeFrame(frame));
    if (!step) return head.buffer;
    const whole = new Uint8Array(FRAME_BYTES + 2 * shown.length);
    whole.set(head);
    const displacements = new Int16Array(whole.buffer, FRAME_BYTES);
    for (let i = 0; i < shown.length; i++) displacements[i] = Math.round(shown[i] / step);
    return whole.buffer;
  }
}
