// Messages with a text: it follows the part of fixed length.
import { NOTES_BYTES, NOTE_BYTES, TIMELINE_BYTES, decodeNote, encodeNote, encodeNotes, type Note, type NoteText, type TimelineTrack } from "./server-messages";

const joined = (head: ArrayBuffer, text: string): ArrayBuffer => {
  const tail = new TextEncoder().encode(text), whole = new Uint8Array(head.byteLength + tail.length);
  whole.set(new Uint8Array(head));
  whole.set(tail, head.byteLength);
  return whole.buffer;
};
const tail = (data: ArrayBuffer, from: number): string => new TextDecoder().decode(new Uint8Array(data, from));

export const noteMessage = (note: Note, text: string): ArrayBuffer => joined(encodeNote(note), text);
export const notesMessage = (notes: NoteText[]): ArrayBuffer => joined(encodeNotes({ count: notes.length }), JSON.stringify(notes));
export const readNote = (data: ArrayBuffer): { note: Note; text: string } => ({ note: decodeNote(new DataView(data)), text: tail(data, NOTE_BYTES) });
export const readTimeline = (data: ArrayBuffer): TimelineTrack[] => JSON.parse(tail(data, TIMELINE_BYTES)) as TimelineTrack[];
export const readNotes = (data: ArrayBuffer): NoteText[] => JSON.parse(tail(data, NOTES_BYTES)) as NoteText[];
