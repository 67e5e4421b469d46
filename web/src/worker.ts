// Owns the socket. Of the frames that arrive only the newest is kept, and decoded when the page asks for one.
import { Painter, type Colouring } from "./colour";
import { edges, normalised, normals, packed } from "./geometry";
import { buffers, type FromWorker, type Organ, type Scale, type Shape, type ToWorker } from "./link";
import { DIFFERENCE_BYTES, DIFFERENCE_KIND, FRAME_BYTES, decodeDifference, decodeFrame, encodeChoose, encodeCompare, encodeMark, encodeTool, type Scene } from "./messages";

const page = self as unknown as {
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
  onmessage: (event: MessageEvent<ToWorker>) => void;
};

const QUICK = 4; // ms
const COMPARED = 1; // state of a `Difference` that says something
const STEPS = 65535; // of its biggest distance
const ANOTHER = 4001; // the server closes with this when it serves another organ from now on

let organ: Organ | null = null;
let painter: Painter | null = null;
let sums: Float32Array<ArrayBuffer>; // of normals
let socket: WebSocket | null = null;
let newest: ArrayBuffer | null = null;
let last: ArrayBuffer | null = null; // shown last
let home = false; // what was shown last is the organ at rest
let colouring: Colouring = "plain";
let ends: Scale = null; // of the colours shown last
let waiting = false; // the page has asked for a frame
let obeyed = 0; // serial of the last command that the frame shown last obeys
let took = 0; // ms, to decode it
let pressing = false; // and says that the first tool feels
const spare: Shape[] = []; // arrays that the page has done with

async function load(address: string): Promise<void> {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(answer.status === 403 ? "refused" : `the server answers ${answer.status}`);
  const data = await answer.arrayBuffer();
  const header = new DataView(data).getUint32(0, true);
  const scene = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, header))) as Scene;
  const rest = new Float32Array(data.slice(4 + header, 4 + header + 12 * scene.nodes));
  const triangles = new Uint32Array(data.slice(4 + header + 12 * scene.nodes));
  const skin = scene.parts.find((p) => !p.inside) ?? scene.parts[0];
  const outer = triangles.subarray(3 * skin.first, 3 * (skin.first + skin.count));
  const normal = new Float32Array(rest.length);
  // Of the organ's own surface; what lies inside has normals of its own, which need not be right to be felt.
  normals(rest, outer, normal);
  normalised(normal);
  const all: Organ = { scene, rest, triangles, normals: normal, edges: edges(triangles, skin.first, skin.count) };
  organ = all;
  painter = new Painter(all, outer);
  painter.colouring = colouring;
  sums = new Float32Array(rest.length);
  spare.length = 0;
  last = newest = null;
  home = false;
  page.postMessage({ kind: "organ", organ: all });
}

function connect(address: string): void {
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    page.postMessage({ kind: "status", good: true, text: "" });
    if (colouring === "error") compare(true);
  };
  socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
    if (new DataView(event.data).getUint8(0) === DIFFERENCE_KIND) return differ(event.data);
    newest = event.data;
    if (waiting || overtakes(event.data)) show();
  };
}

/** Does a frame obey what the one that the page has not drawn yet does not? Then it goes as well, if it is quickly decoded. */
const overtakes = (data: ArrayBuffer): boolean => took < QUICK && decodeFrame(new DataView(data)).serial > obeyed;

/** Asks the server for differences from finite elements, or for no more. */
function compare(on: boolean): void {
  if (painter) painter.error = null;
  if (socket?.readyState === WebSocket.OPEN) socket.send(encodeCompare({ on: Number(on) }));
}

/** The newest difference: the next frame is painted by it. */
function differ(data: ArrayBuffer): void {
  const difference = decodeDifference(new DataView(data)), { state, step, count } = difference;
  const nodes = organ?.scene.nodes ?? 0;
  if (colouring !== "error" || !painter || (count !== 0 && count !== nodes)) return;
  const values = new Float32Array(nodes), distances = new Uint16Array(data, DIFFERENCE_BYTES, count);
  for (let i = 0; i < count; i++) values[i] = step * distances[i];
  painter.error = state === COMPARED ? { values, most: step * STEPS } : null;
  home = false;
  page.postMessage({ kind: "difference", difference });
}

/** Stays connected: asks for the scene anew each time, since another organ may be open by then. */
async function keep(scene: string, address: string): Promise<void> {
  for (let pause = 250; ; pause = Math.min(2 * pause, 4000)) {
    try {
      await load(scene);
      connect(address);
      pause = 250;
      const code = await new Promise<number>((closed) => (socket!.onclose = (event) => closed(event.code)));
      if (code === ANOTHER) {
        page.postMessage({ kind: "status", good: false, text: "Another mesh is coming…" });
        continue;
      }
      page.postMessage({ kind: "status", good: false, text: "Connection lost. Trying again…" });
    } catch (problem) {
      const refused = problem instanceof Error && problem.message === "refused";
      const text = refused ? "palpate was started anew: open the address it printed." : "palpate is not running. Trying again…";
      page.postMessage({ kind: "status", good: false, text });
    }
    newest = null;
    await new Promise((again) => setTimeout(again, pause));
  }
}

function show(): void {
  if (!newest || !organ || !painter) return;
  const began = performance.now();
  const frame = decodeFrame(new DataView(newest));
  if (frame.count !== 0 && frame.count !== organ.scene.nodes) return; // of another scene
  if (pressing) painter.feel(frame);
  const still = frame.count === 0 && home && !(pressing && colouring === "felt");
  const shape = still ? null : shaped(newest, frame.count, frame.step);
  home = frame.count === 0;
  last = newest;
  newest = null;
  waiting = false;
  obeyed = frame.serial;
  took = performance.now() - began;
  page.postMessage({ kind: "frame", frame, shape, scale: ends, work: took }, shape ? buffers(shape) : []);
}

function shaped(data: ArrayBuffer, count: number, step: number): Shape {
  const { rest, triangles } = organ!;
  const shape = spare.pop() ?? fresh(rest.length / 3);
  const { positions } = shape;
  if (count) {
    const moved = new Int16Array(data, FRAME_BYTES, 3 * count);
    for (let i = 0; i < positions.length; i++) positions[i] = rest[i] + step * moved[i];
  } else positions.set(rest);
  normals(positions, triangles, sums);
  packed(sums, shape.normals);
  ends = painter!.paint(positions, shape.colours);
  return shape;
}

const fresh = (nodes: number): Shape => ({
  positions: new Float32Array(3 * nodes),
  normals: new Int16Array(4 * nodes),
  colours: new Uint8Array(4 * nodes),
});

function reuse(shape: Shape | null): void {
  if (shape && shape.positions.length === organ?.rest.length) spare.push(shape);
}

/** Paints what is shown anew. */
function again(): void {
  home = false;
  newest ??= last;
  if (waiting) show();
}

page.onmessage = ({ data }) => {
  if (data.kind === "open") void keep(data.scene, data.socket);
  else if (data.kind === "back") reuse(data.shape);
  else if (data.kind === "next") {
    reuse(data.shape);
    waiting = true;
    pressing = data.pressing;
    show();
  } else if (data.kind === "colour") {
    const before = colouring;
    colouring = data.colouring;
    if ((colouring === "error") !== (before === "error")) compare(colouring === "error");
    if (painter) painter.colouring = colouring;
    again();
  } else if (socket?.readyState !== WebSocket.OPEN) return;
  else if (data.kind === "say") socket.send(encodeTool(data.tool));
  else if (data.kind === "choose") socket.send(encodeChoose(data.choose));
  else socket.send(encodeMark(data.mark));
};
