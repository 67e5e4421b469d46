// Written by web/messages.py from palpate.server.messages; do not edit.

export type Vector = [number, number, number];

/** Page to server: what the hand wants. point: mm, on the surface at rest; displacement: mm. */
export interface Tool {
  held: number;
  serial: number;
  point: Vector;
  displacement: Vector;
}
export const TOOL_BYTES = 32;
export function encodeTool(message: Tool): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(TOOL_BYTES));
  view.setUint8(0, 1);
  view.setUint8(1, message.held);
  view.setUint32(2, message.serial, true);
  view.setFloat32(6, message.point[0], true);
  view.setFloat32(10, message.point[1], true);
  view.setFloat32(14, message.point[2], true);
  view.setFloat32(18, message.displacement[0], true);
  view.setFloat32(22, message.displacement[1], true);
  view.setFloat32(26, message.displacement[2], true);
  return view.buffer;
}
export function decodeTool(view: DataView): Tool {
  if (view.getUint8(0) !== 1) throw new Error(`not a Tool: kind ${view.getUint8(0)}`);
  return {
    held: view.getUint8(1),
    serial: view.getUint32(2, true),
    point: [view.getFloat32(6, true), view.getFloat32(10, true), view.getFloat32(14, true)],
    displacement: [view.getFloat32(18, true), view.getFloat32(22, true), view.getFloat32(26, true)],
  };
}

/** Server to page: one tick. mm; force in N, of the tissue on the tool; grip 0 idle, 1 holding, 2 refused. */
export interface Frame {
  grip: number;
  tick: number;
  late: number;
  faults: number;
  serial: number;
  seconds: number;
  busy: number;
  point: Vector;
  displacement: Vector;
  force: Vector;
  step: number;
  count: number;
}
export const FRAME_BYTES = 84;
export function encodeFrame(message: Frame): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(FRAME_BYTES));
  view.setUint8(0, 2);
  view.setUint8(1, message.grip);
  view.setFloat64(2, message.tick, true);
  view.setFloat64(10, message.late, true);
  view.setUint32(18, message.faults, true);
  view.setUint32(22, message.serial, true);
  view.setFloat64(26, message.seconds, true);
  view.setFloat32(34, message.busy, true);
  view.setFloat32(38, message.point[0], true);
  view.setFloat32(42, message.point[1], true);
  view.setFloat32(46, message.point[2], true);
  view.setFloat32(50, message.displacement[0], true);
  view.setFloat32(54, message.displacement[1], true);
  view.setFloat32(58, message.displacement[2], true);
  view.setFloat32(62, message.force[0], true);
  view.setFloat32(66, message.force[1], true);
  view.setFloat32(70, message.force[2], true);
  view.setFloat32(74, message.step, true);
  view.setUint32(78, message.count, true);
  return view.buffer;
}
export function decodeFrame(view: DataView): Frame {
  if (view.getUint8(0) !== 2) throw new Error(`not a Frame: kind ${view.getUint8(0)}`);
  return {
    grip: view.getUint8(1),
    tick: view.getFloat64(2, true),
    late: view.getFloat64(10, true),
    faults: view.getUint32(18, true),
    serial: view.getUint32(22, true),
    seconds: view.getFloat64(26, true),
    busy: view.getFloat32(34, true),
    point: [view.getFloat32(38, true), view.getFloat32(42, true), view.getFloat32(46, true)],
    displacement: [view.getFloat32(50, true), view.getFloat32(54, true), view.getFloat32(58, true)],
    force: [view.getFloat32(62, true), view.getFloat32(66, true), view.getFloat32(70, true)],
    step: view.getFloat32(74, true),
    count: view.getUint32(78, true),
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
