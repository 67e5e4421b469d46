// Written by web/generate_messages.py from palpate.server.messages; do not edit.

export type Vector = [number, number, number];
export const TOOLS = 4;
export const DISTANCE_STEPS = 65535;
export const DISPLACEMENT_STEPS = 32767;
export const AT_REST = 0.0001;
export const GUIDANCE_LIMIT = 1.0;
export const EXAM_LENGTH = 0.05;
export const EXAM_FORCE = 0.01;
export const EXAM_WORK = 0.1;
export const LONGEST_NOTE = 200;
export const MOST_NOTES = 100;
export const RATE = 1000;
export const SLOWEST = 0.25;
export const FASTEST = 4.0;

/** What a tool is asked to do. */
export const CommandKind = { away: 0, hold: 1, needle: 2, free: 3, blade: 4, carry: 5 } as const;

/** What a tool's proxy is doing. */
export const ContactState = { idle: 0, closed: 1, refused: 2, open: 3, cutting: 4, carrying: 5 } as const;

/** Where a piece is that a cut has freed. */
export const PieceState = { lying: 0, carried: 1, falling: 2, gone: 3 } as const;

/** What a `Selection` selects. */
export const SelectionKind = { model: 0, organ: 1 } as const;

/** What a `Mark` says. */
export const MarkKind = { lump: 0, sample: 1 } as const;

/** What a `Note` does. */
export const NoteStep = { add: 0, remove: 1 } as const;

/** What a `Play` does. */
export const PlayStep = { pause: 0, play: 1, speed: 2, seek: 3 } as const;

/** What a `Scalpel` does. */
export const CutStep = { begin: 0, move: 1, end: 2, undo: 3 } as const;

/** What a `Difference` holds. */
export const ComparisonState = { preparing: 0, compared: 1, no_reference: 2, contacts_overlap: 3 } as const;

/** What a forced-choice trial waits for: palpate, the answer, the end of a break, nothing any more. */
export const TrialState = { preparing: 0, asking: 1, pause: 2, ended: 3 } as const;

/** What is told of the last answer. */
export const Feedback = { none: 0, right: 1, wrong: 2 } as const;

/** What a `Choice` does. */
export const ChoiceKind = { show: 0, answer: 1, go_on: 2 } as const;

/** What a person may do in a room: watch, touch, or lead as well. */
export const Role = { viewer: 0, trainee: 1, teacher: 2 } as const;

/** What a `Lead` does. */
export const LeadStep = { freeze: 0, resume: 1, reset: 2, take_over: 3, release: 4, guide: 5, end_guidance: 6 } as const;

/** Whether a teacher guides a hand: nobody does, one will once both hold the organ, one does. */
export const GuidanceState = { none: 0, waiting: 1, on: 2 } as const;

/** Codes with which the server closes a page's WebSocket (RFC 6455; from 4000 on they are the application's). */
export const CloseCode = { refused: 1008, too_many_pages: 1013, scene_changed: 4001, room_lost: 4002 } as const;

/** Page to server: the command of one tool. kind: a `CommandKind`; serial: the number of the command. */
export interface ToolCommand {
  tool: number;
  kind: number;
  serial: number;
  point: Vector;
  displacement: Vector;
}
export const TOOLCOMMAND_KIND = 1, TOOLCOMMAND_BYTES = 32;
export function encodeToolCommand(message: ToolCommand): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(TOOLCOMMAND_BYTES));
  view.setUint8(0, 1);
  view.setUint8(1, message.tool);
  view.setUint8(2, message.kind);
  view.setUint32(3, message.serial, true);
  for (let i = 0; i < 3; i++) view.setFloat32(7 + 4 * i, message.point[i], true);
  for (let i = 0; i < 3; i++) view.setFloat32(19 + 4 * i, message.displacement[i], true);
  return view.buffer;
}
export function decodeToolCommand(view: DataView): ToolCommand {
  if (view.getUint8(0) !== 1) throw new Error(`not a ToolCommand: kind ${view.getUint8(0)}`);
  return {
    tool: view.getUint8(1),
    kind: view.getUint8(2),
    serial: view.getUint32(3, true),
    point: Array.from({ length: 3 }, (_, i) => view.getFloat32(7 + 4 * i, true)) as Vector,
    displacement: Array.from({ length: 3 }, (_, i) => view.getFloat32(19 + 4 * i, true)) as Vector,
  };
}

/** Server to page: the state after one tick. Lengths in mm; force in N, of the tissue on the tool. */
export interface Frame {
  model: number;
  tick: number;
  late: number;
  faults: number;
  serial: number;
  seconds: number;
  busy: number;
  energy: number;
  contact: number[];
  point: number[];
  displacement: number[];
  force: number[];
  insertion: number[];
  chosen: number;
  mesh_error: number;
  linearisation: number;
  stiffness_spread: number;
  least_volume: number;
  solution_age: number;
  solution_error: number;
  body: number;
  step: number;
  count: number;
}
export const FRAME_KIND = 2, FRAME_BYTES = 244;
export function encodeFrame(message: Frame): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(FRAME_BYTES));
  view.setUint8(0, 2);
  view.setUint8(1, message.model);
  view.setFloat64(2, message.tick, true);
  view.setFloat64(10, message.late, true);
  view.setUint32(18, message.faults, true);
  view.setUint32(22, message.serial, true);
  view.setFloat64(26, message.seconds, true);
  view.setFloat32(34, message.busy, true);
  view.setFloat32(38, message.energy, true);
  for (let i = 0; i < 4; i++) view.setUint8(42 + i, message.contact[i]);
  for (let i = 0; i < 12; i++) view.setFloat32(46 + 4 * i, message.point[i], true);
  for (let i = 0; i < 12; i++) view.setFloat32(94 + 4 * i, message.displacement[i], true);
  for (let i = 0; i < 12; i++) view.setFloat32(142 + 4 * i, message.force[i], true);
  for (let i = 0; i < 4; i++) view.setFloat32(190 + 4 * i, message.insertion[i], true);
  view.setUint8(206, message.chosen);
  view.setFloat32(207, message.mesh_error, true);
  view.setFloat32(211, message.linearisation, true);
  view.setFloat32(215, message.stiffness_spread, true);
  view.setFloat32(219, message.least_volume, true);
  view.setFloat32(223, message.solution_age, true);
  view.setFloat32(227, message.solution_error, true);
  view.setUint32(231, message.body, true);
  view.setFloat32(235, message.step, true);
  view.setUint32(239, message.count, true);
  return view.buffer;
}
export function decodeFrame(view: DataView): Frame {
  if (view.getUint8(0) !== 2) throw new Error(`not a Frame: kind ${view.getUint8(0)}`);
  return {
    model: view.getUint8(1),
    tick: view.getFloat64(2, true),
    late: view.getFloat64(10, true),
    faults: view.getUint32(18, true),
    serial: view.getUint32(22, true),
    seconds: view.getFloat64(26, true),
    busy: view.getFloat32(34, true),
    energy: view.getFloat32(38, true),
    contact: Array.from({ length: 4 }, (_, i) => view.getUint8(42 + i)),
    point: Array.from({ length: 12 }, (_, i) => view.getFloat32(46 + 4 * i, true)),
    displacement: Array.from({ length: 12 }, (_, i) => view.getFloat32(94 + 4 * i, true)),
    force: Array.from({ length: 12 }, (_, i) => view.getFloat32(142 + 4 * i, true)),
    insertion: Array.from({ length: 4 }, (_, i) => view.getFloat32(190 + 4 * i, true)),
    chosen: view.getUint8(206),
    mesh_error: view.getFloat32(207, true),
    linearisation: view.getFloat32(211, true),
    stiffness_spread: view.getFloat32(215, true),
    least_volume: view.getFloat32(219, true),
    solution_age: view.getFloat32(223, true),
    solution_error: view.getFloat32(227, true),
    body: view.getUint32(231, true),
    step: view.getFloat32(235, true),
    count: view.getUint32(239, true),
  };
}

/** Page to server: selects one of the scene's `models` or `organs` by index. kind: a `SelectionKind`. */
export interface Selection {
  kind: number;
  index: number;
}
export const SELECTION_KIND = 3, SELECTION_BYTES = 4;
export function encodeSelection(message: Selection): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(SELECTION_BYTES));
  view.setUint8(0, 3);
  view.setUint8(1, message.kind);
  view.setUint8(2, message.index);
  return view.buffer;
}
export function decodeSelection(view: DataView): Selection {
  if (view.getUint8(0) !== 3) throw new Error(`not a Selection: kind ${view.getUint8(0)}`);
  return {
    kind: view.getUint8(1),
    index: view.getUint8(2),
  };
}

/** Page to server: the user found a lump under this tool, or takes a sample with it. kind: a `MarkKind`. */
export interface Mark {
  kind: number;
  tool: number;
}
export const MARK_KIND = 4, MARK_BYTES = 4;
export function encodeMark(message: Mark): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(MARK_BYTES));
  view.setUint8(0, 4);
  view.setUint8(1, message.kind);
  view.setUint8(2, message.tool);
  return view.buffer;
}
export function decodeMark(view: DataView): Mark {
  if (view.getUint8(0) !== 4) throw new Error(`not a Mark: kind ${view.getUint8(0)}`);
  return {
    kind: view.getUint8(1),
    tool: view.getUint8(2),
  };
}

/** Page to server: 1 asks the server to send a `Difference` from time to time, 0 asks it to stop. */
export interface Compare {
  on: number;
}
export const COMPARE_KIND = 5, COMPARE_BYTES = 4;
export function encodeCompare(message: Compare): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(COMPARE_BYTES));
  view.setUint8(0, 5);
  view.setUint8(1, message.on);
  return view.buffer;
}
export function decodeCompare(view: DataView): Compare {
  if (view.getUint8(0) !== 5) throw new Error(`not a Compare: kind ${view.getUint8(0)}`);
  return {
    on: view.getUint8(1),
  };
}

/** Server to page, on request: the distance of one tick's state from linear finite elements under the same contacts. */
export interface Difference {
  state: number;
  tick: number;
  force: number[];
  force_error: number;
  step: number;
  count: number;
}
export const DIFFERENCE_KIND = 6, DIFFERENCE_BYTES = 72;
export function encodeDifference(message: Difference): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(DIFFERENCE_BYTES));
  view.setUint8(0, 6);
  view.setUint8(1, message.state);
  view.setFloat64(2, message.tick, true);
  for (let i = 0; i < 12; i++) view.setFloat32(10 + 4 * i, message.force[i], true);
  view.setFloat32(58, message.force_error, true);
  view.setFloat32(62, message.step, true);
  view.setUint32(66, message.count, true);
  return view.buffer;
}
export function decodeDifference(view: DataView): Difference {
  if (view.getUint8(0) !== 6) throw new Error(`not a Difference: kind ${view.getUint8(0)}`);
  return {
    state: view.getUint8(1),
    tick: view.getFloat64(2, true),
    force: Array.from({ length: 12 }, (_, i) => view.getFloat32(10 + 4 * i, true)),
    force_error: view.getFloat32(58, true),
    step: view.getFloat32(62, true),
    count: view.getUint32(66, true),
  };
}

/** Page to server: the blade goes to `point` (mm, on the surface at rest), `depth` mm deep. step: a `CutStep`. */
export interface Scalpel {
  step: number;
  depth: number;
  point: Vector;
  direction: Vector;
}
export const SCALPEL_KIND = 7, SCALPEL_BYTES = 32;
export function encodeScalpel(message: Scalpel): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(SCALPEL_BYTES));
  view.setUint8(0, 7);
  view.setUint8(1, message.step);
  view.setFloat32(2, message.depth, true);
  for (let i = 0; i < 3; i++) view.setFloat32(6 + 4 * i, message.point[i], true);
  for (let i = 0; i < 3; i++) view.setFloat32(18 + 4 * i, message.direction[i], true);
  return view.buffer;
}
export function decodeScalpel(view: DataView): Scalpel {
  if (view.getUint8(0) !== 7) throw new Error(`not a Scalpel: kind ${view.getUint8(0)}`);
  return {
    step: view.getUint8(1),
    depth: view.getFloat32(2, true),
    point: Array.from({ length: 3 }, (_, i) => view.getFloat32(6 + 4 * i, true)) as Vector,
    direction: Array.from({ length: 3 }, (_, i) => view.getFloat32(18 + 4 * i, true)) as Vector,
  };
}

/** Page to server: shows an interval (1 or 2) of a trial, answers with it, or ends a break. kind: a `ChoiceKind`. */
export interface Choice {
  kind: number;
  interval: number;
  trial: number;
}
export const CHOICE_KIND = 8, CHOICE_BYTES = 8;
export function encodeChoice(message: Choice): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(CHOICE_BYTES));
  view.setUint8(0, 8);
  view.setUint8(1, message.kind);
  view.setUint8(2, message.interval);
  view.setUint32(3, message.trial, true);
  return view.buffer;
}
export function decodeChoice(view: DataView): Choice {
  if (view.getUint8(0) !== 8) throw new Error(`not a Choice: kind ${view.getUint8(0)}`);
  return {
    kind: view.getUint8(1),
    interval: view.getUint8(2),
    trial: view.getUint32(3, true),
  };
}

/** Server to page: where a forced-choice experiment is. state: a `TrialState`; told: a `Feedback`. */
export interface TrialStatus {
  state: number;
  trial: number;
  trials: number;
  shown: number;
  touched: number;
  told: number;
}
export const TRIALSTATUS_KIND = 9, TRIALSTATUS_BYTES = 16;
export function encodeTrialStatus(message: TrialStatus): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(TRIALSTATUS_BYTES));
  view.setUint8(0, 9);
  view.setUint8(1, message.state);
  view.setUint32(2, message.trial, true);
  view.setUint32(6, message.trials, true);
  view.setUint8(10, message.shown);
  view.setUint8(11, message.touched);
  view.setUint8(12, message.told);
  return view.buffer;
}
export function decodeTrialStatus(view: DataView): TrialStatus {
  if (view.getUint8(0) !== 9) throw new Error(`not a TrialStatus: kind ${view.getUint8(0)}`);
  return {
    state: view.getUint8(1),
    trial: view.getUint32(2, true),
    trials: view.getUint32(6, true),
    shown: view.getUint8(10),
    touched: view.getUint8(11),
    told: view.getUint8(12),
  };
}

/** Page to server: a note at `point` (mm, on the surface at rest). step: a `NoteStep`. index: of the one to be removed. */
export interface Note {
  step: number;
  index: number;
  point: Vector;
}
export const NOTE_KIND = 10, NOTE_BYTES = 16;
export function encodeNote(message: Note): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(NOTE_BYTES));
  view.setUint8(0, 10);
  view.setUint8(1, message.step);
  view.setUint8(2, message.index);
  for (let i = 0; i < 3; i++) view.setFloat32(3 + 4 * i, message.point[i], true);
  return view.buffer;
}
export function decodeNote(view: DataView): Note {
  if (view.getUint8(0) !== 10) throw new Error(`not a Note: kind ${view.getUint8(0)}`);
  return {
    step: view.getUint8(1),
    index: view.getUint8(2),
    point: Array.from({ length: 3 }, (_, i) => view.getFloat32(3 + 4 * i, true)) as Vector,
  };
}

/** Server to page, when it connects and at each change: then JSON, a list of `NoteText`, all that there are. */
export interface Notes {
  count: number;
}
export const NOTES_KIND = 11, NOTES_BYTES = 8;
export function encodeNotes(message: Notes): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(NOTES_BYTES));
  view.setUint8(0, 11);
  view.setUint32(1, message.count, true);
  return view.buffer;
}
export function decodeNotes(view: DataView): Notes {
  if (view.getUint8(0) !== 11) throw new Error(`not a Notes: kind ${view.getUint8(0)}`);
  return {
    count: view.getUint32(1, true),
  };
}

/** Page to server: plays a replay, pauses it, sets its speed, goes to a tick. step: a `PlayStep`; value: speed or tick. */
export interface Play {
  step: number;
  value: number;
}
export const PLAY_KIND = 12, PLAY_BYTES = 12;
export function encodePlay(message: Play): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(PLAY_BYTES));
  view.setUint8(0, 12);
  view.setUint8(1, message.step);
  view.setFloat64(2, message.value, true);
  return view.buffer;
}
export function decodePlay(view: DataView): Play {
  if (view.getUint8(0) !== 12) throw new Error(`not a Play: kind ${view.getUint8(0)}`);
  return {
    step: view.getUint8(1),
    value: view.getFloat64(2, true),
  };
}

/** Server to page: where a replay is. there: share of the way to `tick` that is computed; less than 1: not there yet. */
export interface Position {
  playing: number;
  speed: number;
  tick: number;
  there: number;
  sought: number;
}
export const POSITION_KIND = 13, POSITION_BYTES = 24;
export function encodePosition(message: Position): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(POSITION_BYTES));
  view.setUint8(0, 13);
  view.setUint8(1, message.playing);
  view.setFloat32(2, message.speed, true);
  view.setFloat64(6, message.tick, true);
  view.setFloat32(14, message.there, true);
  view.setUint32(18, message.sought, true);
  return view.buffer;
}
export function decodePosition(view: DataView): Position {
  if (view.getUint8(0) !== 13) throw new Error(`not a Position: kind ${view.getUint8(0)}`);
  return {
    playing: view.getUint8(1),
    speed: view.getFloat32(2, true),
    tick: view.getFloat64(6, true),
    there: view.getFloat32(14, true),
    sought: view.getUint32(18, true),
  };
}

/** Server to page: then JSON, a list of `TimelineTrack`, one for each replay. */
export interface Timeline {
  count: number;
}
export const TIMELINE_KIND = 14, TIMELINE_BYTES = 8;
export function encodeTimeline(message: Timeline): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(TIMELINE_BYTES));
  view.setUint8(0, 14);
  view.setUint32(1, message.count, true);
  return view.buffer;
}
export function decodeTimeline(view: DataView): Timeline {
  if (view.getUint8(0) !== 14) throw new Error(`not a Timeline: kind ${view.getUint8(0)}`);
  return {
    count: view.getUint32(1, true),
  };
}

/** Page to server: what a teacher does in a room. step: a `LeadStep`; person: whom it is about, else 0. */
export interface Lead {
  step: number;
  person: number;
}
export const LEAD_KIND = 15, LEAD_BYTES = 8;
export function encodeLead(message: Lead): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(LEAD_BYTES));
  view.setUint8(0, 15);
  view.setUint8(1, message.step);
  view.setUint32(2, message.person, true);
  return view.buffer;
}
export function decodeLead(view: DataView): Lead {
  if (view.getUint8(0) !== 15) throw new Error(`not a Lead: kind ${view.getUint8(0)}`);
  return {
    step: view.getUint8(1),
    person: view.getUint32(2, true),
  };
}

/** Server to page, in a room, at each change: then JSON, a list of `Person`. you: the page's own number. */
export interface People {
  you: number;
  frozen: number;
}
export const PEOPLE_KIND = 16, PEOPLE_BYTES = 8;
export function encodePeople(message: People): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(PEOPLE_BYTES));
  view.setUint8(0, 16);
  view.setUint32(1, message.you, true);
  view.setUint8(5, message.frozen);
  return view.buffer;
}
export function decodePeople(view: DataView): People {
  if (view.getUint8(0) !== 16) throw new Error(`not a People: kind ${view.getUint8(0)}`);
  return {
    you: view.getUint32(1, true),
    frozen: view.getUint8(5),
  };
}

/** Server to page, in a room, before each `Frame`: the tools of all others. */
export interface Hands {
  count: number;
}
export const HANDS_KIND = 17, HANDS_BYTES = 8;
export function encodeHands(message: Hands): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(HANDS_BYTES));
  view.setUint8(0, 17);
  view.setUint32(1, message.count, true);
  return view.buffer;
}
export function decodeHands(view: DataView): Hands {
  if (view.getUint8(0) !== 17) throw new Error(`not a Hands: kind ${view.getUint8(0)}`);
  return {
    count: view.getUint32(1, true),
  };
}

/** Page to server, in a room: 0 asks for frames without displacements, since it computes them, 1 for whole ones. */
export interface Detail {
  whole: number;
}
export const DETAIL_KIND = 18, DETAIL_BYTES = 4;
export function encodeDetail(message: Detail): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(DETAIL_BYTES));
  view.setUint8(0, 18);
  view.setUint8(1, message.whole);
  return view.buffer;
}
export function decodeDetail(view: DataView): Detail {
  if (view.getUint8(0) !== 18) throw new Error(`not a Detail: kind ${view.getUint8(0)}`);
  return {
    whole: view.getUint8(1),
  };
}

/** Page to server, some ten times a second: so many frames have come on this connection. */
export interface Seen {
  count: number;
}
export const SEEN_KIND = 19, SEEN_BYTES = 8;
export function encodeSeen(message: Seen): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(SEEN_BYTES));
  view.setUint8(0, 19);
  view.setUint32(1, message.count, true);
  return view.buffer;
}
export function decodeSeen(view: DataView): Seen {
  if (view.getUint8(0) !== 19) throw new Error(`not a Seen: kind ${view.getUint8(0)}`);
  return {
    count: view.getUint32(1, true),
  };
}

/** Server to page, in a room, at each change, and before each `Frame` while a teacher guides: who guides whose hand. */
export interface Guidance {
  state: number;
  number: number;
  teacher: number;
  trainee: number;
  teacher_tool: number;
  trainee_tool: number;
  teacher_at: Vector;
  trainee_at: Vector;
  teacher_given: number;
  trainee_given: number;
  teacher_force: Vector;
  trainee_force: Vector;
}
export const GUIDANCE_KIND = 20, GUIDANCE_BYTES = 80;
export function encodeGuidance(message: Guidance): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(GUIDANCE_BYTES));
  view.setUint8(0, 20);
  view.setUint8(1, message.state);
  view.setUint32(2, message.number, true);
  view.setUint32(6, message.teacher, true);
  view.setUint32(10, message.trainee, true);
  view.setUint8(14, message.teacher_tool);
  view.setUint8(15, message.trainee_tool);
  for (let i = 0; i < 3; i++) view.setFloat32(16 + 4 * i, message.teacher_at[i], true);
  for (let i = 0; i < 3; i++) view.setFloat32(28 + 4 * i, message.trainee_at[i], true);
  view.setFloat64(40, message.teacher_given, true);
  view.setFloat64(48, message.trainee_given, true);
  for (let i = 0; i < 3; i++) view.setFloat32(56 + 4 * i, message.teacher_force[i], true);
  for (let i = 0; i < 3; i++) view.setFloat32(68 + 4 * i, message.trainee_force[i], true);
  return view.buffer;
}
export function decodeGuidance(view: DataView): Guidance {
  if (view.getUint8(0) !== 20) throw new Error(`not a Guidance: kind ${view.getUint8(0)}`);
  return {
    state: view.getUint8(1),
    number: view.getUint32(2, true),
    teacher: view.getUint32(6, true),
    trainee: view.getUint32(10, true),
    teacher_tool: view.getUint8(14),
    trainee_tool: view.getUint8(15),
    teacher_at: Array.from({ length: 3 }, (_, i) => view.getFloat32(16 + 4 * i, true)) as Vector,
    trainee_at: Array.from({ length: 3 }, (_, i) => view.getFloat32(28 + 4 * i, true)) as Vector,
    teacher_given: view.getFloat64(40, true),
    trainee_given: view.getFloat64(48, true),
    teacher_force: Array.from({ length: 3 }, (_, i) => view.getFloat32(56 + 4 * i, true)) as Vector,
    trainee_force: Array.from({ length: 3 }, (_, i) => view.getFloat32(68 + 4 * i, true)) as Vector,
  };
}

/** Page to server, while its hand guides or is guided: what a `Guidance` tells of this end. number: of the guidance. */
export interface Guided {
  number: number;
  given: number;
  force: Vector;
}
export const GUIDED_KIND = 21, GUIDED_BYTES = 28;
export function encodeGuided(message: Guided): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(GUIDED_BYTES));
  view.setUint8(0, 21);
  view.setUint32(1, message.number, true);
  view.setFloat64(5, message.given, true);
  for (let i = 0; i < 3; i++) view.setFloat32(13 + 4 * i, message.force[i], true);
  return view.buffer;
}
export function decodeGuided(view: DataView): Guided {
  if (view.getUint8(0) !== 21) throw new Error(`not a Guided: kind ${view.getUint8(0)}`);
  return {
    number: view.getUint32(1, true),
    given: view.getFloat64(5, true),
    force: Array.from({ length: 3 }, (_, i) => view.getFloat32(13 + 4 * i, true)) as Vector,
  };
}

/** Server to page, before each `Frame` while there are pieces that cuts have freed. body: of the `Scene` that has them. */
export interface Pieces {
  body: number;
  count: number;
}
export const PIECES_KIND = 22, PIECES_BYTES = 12;
export function encodePieces(message: Pieces): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(PIECES_BYTES));
  view.setUint8(0, 22);
  view.setUint32(1, message.body, true);
  view.setUint32(5, message.count, true);
  return view.buffer;
}
export function decodePieces(view: DataView): Pieces {
  if (view.getUint8(0) !== 22) throw new Error(`not a Pieces: kind ${view.getUint8(0)}`);
  return {
    body: view.getUint32(1, true),
    count: view.getUint32(5, true),
  };
}

/** Triangles first to first + count of a `DisplayedSurface` or a scene: the organ, or a region inside it. */
export interface Part {
  name: string;
  first: number;
  count: number;
  inside: boolean;
}

/** A note: the tick at which it was made, its place on the surface at rest (mm), its text. */
export interface NoteText {
  tick: number;
  point: number[];
  text: string;
}

/** An event of a recorded session. kind: touch, release, cut, undo, model, claim, note or limit. */
export interface TimelineEvent {
  tick: number;
  kind: string;
  text: string;
}

/** A recorded session. length: ticks. forces: N, the greatest in each `bin` ticks, as far as they are computed. */
export interface TimelineTrack {
  title: string;
  length: number;
  bin: number;
  events: TimelineEvent[];
  forces: number[];
}

/** Somebody in a room. role: a `Role`. */
export interface Person {
  number: number;
  name: string;
  role: number;
}

/** A piece that a cut has freed. lips: numbers of the first vertex on its cut faces, as in a `Scene`. */
export interface PieceShape {
  nodes: number;
  triangles: number;
  lips: number[];
}

/** Server to page, once: a 32-bit length, then JSON of that length, padded with blanks to a multiple of 4 bytes. */
export interface Scene {
  title: string;
  model: string;
  nodes: number;
  triangles: number;
  parts: Part[];
  gapes: boolean;
  lips: number[];
  beside: string[];
  body: number;
  made: number;
  depth: number;
  tools: string[];
  views: string[];
  exam: boolean;
  question: string;
  channel: string;
  place: number[];
  recorded: boolean;
  lumen: number[];
  openings: number[];
  elements: number;
  radius: number;
  reach: number;
  limit: number;
  rate: number;
  replay: boolean;
  front: number;
  models: string[];
  organs: string[];
  organ: number;
  task: string;
  reason: string;
  images: boolean;
  room: string;
  pieces: PieceShape[];
}

/** A display window: values from low (black) to high (white). hint: how they were chosen. */
export interface Window {
  name: string;
  low: number;
  high: number;
  hint: string;
}

/** An array (z, y, x) or (view, row, column), little-endian, fetched separately; NaN: not measured. */
export interface Stack {
  name: string;
  unit: string;
  kind: string;
  windows: Window[];
}

/** A volume or a scan for `palpate view`. spacing: (z, y, x) mm, of a scan (1, row, column). origin: (x, y, z) mm. */
export interface Image {
  title: string;
  scan: boolean;
  shape: number[];
  spacing: number[];
  origin: number[];
  direction: number[];
  patient: boolean;
  file: number[];
  water: number;
  note: string;
  captions: string[];
  stacks: Stack[];
}

/** Server to page, once, as JSON: the images to view, one or two. */
export interface Album {
  images: Image[];
}
