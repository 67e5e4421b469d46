// Notes: texts at points of the surface, kept with the record of the session. Their form, their list and their marks.
import { interpolate, locate, type Hit } from "../organ/mesh-geometry";
import { LONGEST_NOTE, MOST_NOTES, NoteStep, RATE, type Note, type NoteText, type Vector } from "../protocol/server-messages";
import type { Organ } from "../protocol/worker-messages";
import { element, saveText, write } from "../ui/controls";
import { MeasurementList } from "../ui/measurement-list";
import { offersNotes } from "./offers";

/** What no one sees but turns the text or the terminal that shows it: controls, and turns of the direction of writing. */
const UNSEEN = /[\p{Cc}\p{Cs}\p{Co}\p{Cn}\p{Z}\u00ad\u061c\u200b\u200e-\u200f\u202a-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb]+/gu;
export const cleanText = (text: string): string => text.replace(UNSEEN, " ").trim();

const LONGEST_LABEL = 36; // characters on the picture; the list has them all

export class Notes {
  private organ: Organ | null = null;
  private all: NoteText[] = [];
  private hits: Hit[] = [];
  private shown = 0; // of them, up to the tick of now
  private target: Hit | null = null; // of the note that is being written
  private readonly list: MeasurementList;
  private readonly input = element<HTMLInputElement>("note-text");

  /** send: a note and its text. onChange: called after every change. */
  constructor(private readonly send: (note: Note, text: string) => void, private readonly onChange: () => void) {
    this.list = new MeasurementList("note-list", (index) => send({ step: NoteStep.remove, index, point: this.all[index].point as Vector }, this.all[index].text));
    this.input.maxLength = LONGEST_NOTE;
    element("note-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.save();
    });
    element("note-cancel").addEventListener("click", () => this.cancel());
    this.input.addEventListener("keydown", (event) => event.key === "Escape" && this.cancel());
    element("notes-save").addEventListener("click", () => saveText(this.table(), "notes.csv", "text/csv"));
  }

  setOrgan(organ: Organ): void {
    this.organ = organ;
    this.cancel();
    this.locateAll();
  }

  take(notes: NoteText[]): void {
    this.all = notes;
    this.locateAll();
  }

  private locateAll(): void {
    if (!this.organ) return;
    const { rest, triangles, scene } = this.organ, surface = scene.parts.find((part) => !part.inside)!;
    this.hits = this.all.map((note) => locate(note.point as Vector, rest, triangles, surface.first, surface.count));
    this.shown = -1;
    this.onChange();
  }

  /** Asks for the text of a note at a point of the surface. */
  write(hit: Hit, text = ""): void {
    if (!this.organ || !offersNotes(this.organ.scene)) return;
    this.target = hit;
    element("note-form").hidden = false;
    const full = this.all.length >= MOST_NOTES;
    write("note-where", full ? `There are ${MOST_NOTES} notes: remove one first.` : this.organ.scene.recorded ? "Kept with the record of the session." : "This session is not recorded: save the notes to keep them.");
    this.input.value = text.slice(0, LONGEST_NOTE);
    this.input.focus();
    this.onChange();
  }

  private save(): void {
    const text = cleanText(this.input.value);
    if (!this.target || !text || this.all.length >= MOST_NOTES) return this.input.focus();
    const point = interpolate(this.target, this.organ!.rest, this.organ!.triangles);
    this.send({ step: NoteStep.add, index: 0, point }, text);
    this.cancel();
  }

  cancel(): void {
    const { activeElement } = document;
    this.target = null;
    element("note-form").hidden = true;
    if (activeElement === this.input) element("view").focus();
    this.onChange();
  }

  /** Shows what was written up to a tick. */
  update(tick: number): void {
    const replay = this.organ?.scene.replay === true, shown = replay ? this.all.filter((note) => note.tick <= tick).length : this.all.length;
    if (shown === this.shown) return;
    this.shown = shown;
    this.list.show(this.all.slice(0, shown).map(({ text, tick: at }, i) => ({ name: `Note ${i + 1}`, lines: [text, `After ${(at / RATE).toFixed(1)} s`] })), !replay);
    element("notes").hidden = !this.all.length;
    this.onChange();
  }

  /** Points and labels of what is shown, and the point of the one that is being written. */
  get marks(): { hit: Hit; label: string }[] {
    const short = (text: string) => ([...text].length > LONGEST_LABEL ? `${[...text].slice(0, LONGEST_LABEL - 1).join("")}…` : text);
    const marks = this.all.slice(0, Math.max(0, this.shown)).map(({ text }, i) => ({ hit: this.hits[i], label: short(text) }));
    return this.target ? [...marks, { hit: this.target, label: "" }] : marks;
  }

  private table(): string {
    // A cell that begins like a formula would be one in a spreadsheet.
    const cell = (value: string | number) => `"${String(value).replace(/^([=+@-])(?=\D)/, "'$1").replaceAll('"', '""')}"`;
    const rows = this.all.map(({ tick, point, text }) => [tick / RATE, ...point, text]);
    return [["seconds", "x, mm", "y, mm", "z, mm", "note"], ...rows].map((row) => row.map(cell).join(",")).join("\n") + "\n";
  }
}
