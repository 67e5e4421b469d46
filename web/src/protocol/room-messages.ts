// What a page is told beside the organ: in a room who is there, and the tools of all others; where loose pieces are.
import { HANDS_BYTES, PEOPLE_BYTES, PIECES_BYTES, decodeHands, decodePeople, decodePieces, type Person, type Vector } from "./server-messages";

/** you: the page's own number; frozen: the teacher has stopped all other hands. */
export interface RoomState {
  you: number;
  frozen: boolean;
  people: Person[];
}

/** A tool in another hand. person: whose; number: which of that person's tools; lengths in mm, force in N. */
export interface OtherHand {
  person: number;
  contact: number;
  point: Vector;
  displacement: Vector;
  force: Vector;
  insertion: number;
  number: number;
}

/** Where a piece is that a cut has freed. state: a `PieceState`. offset: mm, from where it came free. */
export interface PiecePose {
  state: number;
  offset: Vector;
}

const NUMBERS = 13; // of a hand

export function readPeople(data: ArrayBuffer): RoomState {
  const { you, frozen } = decodePeople(new DataView(data));
  return { you, frozen: frozen === 1, people: JSON.parse(new TextDecoder().decode(new Uint8Array(data, PEOPLE_BYTES))) as Person[] };
}

/** body: of the `Scene` that has these pieces. */
export function readPieces(data: ArrayBuffer): { body: number; poses: PiecePose[] } {
  const { body, count } = decodePieces(new DataView(data)), all = new Float32Array(data, PIECES_BYTES, 4 * count);
  return { body, poses: Array.from({ length: count }, (_, i) => ({ state: all[4 * i], offset: [...all.subarray(4 * i + 1, 4 * i + 4)] as Vector })) };
}

export function readHands(data: ArrayBuffer): OtherHand[] {
  const { count } = decodeHands(new DataView(data)), all = new Float32Array(data, HANDS_BYTES, NUMBERS * count);
  return Array.from({ length: count }, (_, i) => {
    const row = [...all.subarray(NUMBERS * i, NUMBERS * (i + 1))], three = (at: number) => row.slice(at, at + 3) as Vector;
    return { person: row[0], contact: row[1], point: three(2), displacement: three(5), force: three(8), insertion: row[11], number: row[12] };
  });
}
