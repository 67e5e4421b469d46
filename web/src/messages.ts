// Written by web/messages.py from palpate.server.messages; do not edit.

export type Vector = [number, number, number];

/** Page to server: what one hand wants. kind: `KINDS`' number; 0 lets go. */
export interface Tool {
  tool: number;
  kind: number;
  serial: number;
  point: Vector;
  displacement: Vector;
}
export const TOOL_KIND = 1, TOOL_BYTES = 32;
export function encodeTool(message: Tool): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(TOOL_BYTES));
  view.setUint8(0, 1);
  view.setUint8(1, message.tool);
  view.setUint8(2, message.kind);
  view.setUint32(3, message.serial, true);
  for (let i = 0; i < 3; i++) view.setFloat32(7 + 4 * i, message.point[i], true);
  for (let i = 0; i < 3; i++) view.setFloat32(19 + 4 * i, message.displacement[i], true);
  return view.buffer;
}
export function decodeTool(view: DataView): Tool {
  if (view.getUint8(0) !== 1) throw new Error(`not a Tool: kind ${view.getUint8(0)}`);
  return {
    tool: view.getUint8(1),
    kind: view.getUint8(2),
    serial: view.getUint32(3, true),
    point: Array.from({ length: 3 }, (_, i) => view.getFloat32(7 + 4 * i, true)) as Vector,
    displacement: Array.from({ length: 3 }, (_, i) => view.getFloat32(19 + 4 * i, true)) as Vector,
  };
}

/** Server to page: one tick, for each of four tools. mm; force in N, of the tissue on the tool. */
export interface Frame {
  model: number;
  tick: number;
  late: number;
  faults: number;
  serial: number;
  seconds: number;
  busy: number;
  energy: number;
  grip: number[];
  point: number[];
  displacement: number[];
  force: number[];
  inside: number[];
  step: number;
  count: number;
}
export const FRAME_KIND = 2, FRAME_BYTES = 216;
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
  for (let i = 0; i < 4; i++) view.setUint8(42 + i, message.grip[i]);
  for (let i = 0; i < 12; i++) view.setFloat32(46 + 4 * i, message.point[i], true);
  for (let i = 0; i < 12; i++) view.setFloat32(94 + 4 * i, message.displacement[i], true);
  for (let i = 0; i < 12; i++) view.setFloat32(142 + 4 * i, message.force[i], true);
  for (let i = 0; i < 4; i++) view.setFloat32(190 + 4 * i, message.inside[i], true);
  view.setFloat32(206, message.step, true);
  view.setUint32(210, message.count, true);
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
    grip: Array.from({ length: 4 }, (_, i) => view.getUint8(42 + i)),
    point: Array.from({ length: 12 }, (_, i) => view.getFloat32(46 + 4 * i, true)),
    displacement: Array.from({ length: 12 }, (_, i) => view.getFloat32(94 + 4 * i, true)),
    force: Array.from({ length: 12 }, (_, i) => view.getFloat32(142 + 4 * i, true)),
    inside: Array.from({ length: 4 }, (_, i) => view.getFloat32(190 + 4 * i, true)),
    step: view.getFloat32(206, true),
    count: view.getUint32(210, true),
  };
}

/** Page to server: what 0 is a model of the scene's `models`, 1 an organ (a resolution) of its `organs`, by index. */
export interface Choose {
  what: number;
  index: number;
}
export const CHOOSE_KIND = 3, CHOOSE_BYTES = 4;
export function encodeChoose(message: Choose): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(CHOOSE_BYTES));
  view.setUint8(0, 3);
  view.setUint8(1, message.what);
  view.setUint8(2, message.index);
  return view.buffer;
}
export function decodeChoose(view: DataView): Choose {
  if (view.getUint8(0) !== 3) throw new Error(`not a Choose: kind ${view.getUint8(0)}`);
  return {
    what: view.getUint8(1),
    index: view.getUint8(2),
  };
}

/** Page to server: what 0 says that a lump was found under a tool, 1 that its needle takes a sample here. */
export interface Mark {
  what: number;
  tool: number;
}
export const MARK_KIND = 4, MARK_BYTES = 4;
export function encodeMark(message: Mark): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(MARK_BYTES));
  view.setUint8(0, 4);
  view.setUint8(1, message.what);
  view.setUint8(2, message.tool);
  return view.buffer;
}
export function decodeMark(view: DataView): Mark {
  if (view.getUint8(0) !== 4) throw new Error(`not a Mark: kind ${view.getUint8(0)}`);
  return {
    what: view.getUint8(1),
    tool: view.getUint8(2),
  };
}

/** Page to server: on 1 asks for a `Difference` now and then from here on, 0 for no more. */
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

/** Server to page, if it asks: how far what one tick shows is from linear finite elements under the same contacts. */
export interface Difference {
  state: number;
  tick: number;
  force: number[];
  off: number;
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
  view.setFloat32(58, message.off, true);
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
    off: view.getFloat32(58, true),
    step: view.getFloat32(62, true),
    count: view.getUint32(66, true),
  };
}

/** Triangles first..first + count of the scene: the organ, or a region inside it. */
export interface Part {
  name: string;
  first: number;
  count: number;
  inside: boolean;
}

/** Server to page, once, as JSON of `header` bytes (a 32-bit number before it), padded with blanks to 4 bytes. */
export interface Scene {
  title: string;
  model: string;
  nodes: number;
  triangles: number;
  parts: Part[];
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
  images: boolean;
}

/** Values from low (black) to high (white), and what the choice rests on. */
export interface Window {
  name: string;
  low: number;
  high: number;
  hint: string;
}

/** Values of one kind, (z, y, x) or (view, row, column), little-endian, fetched on their own; NaN is not measured. */
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

/** Server to page, once, as JSON: what is viewed, one image or two to compare. */
export interface Album {
  images: Image[];
}
