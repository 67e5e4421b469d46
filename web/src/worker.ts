// Owns the socket. Of the frames that arrive only the newest is kept, and decoded when the page asks for one.
import { normals } from "./geometry";
import type { FromWorker, Organ, Shape, ToWorker } from "./link";
import { FRAME_BYTES, decodeFrame, encodeTool, type Scene } from "./messages";

const page = self as unknown as {
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
  onmessage: (event: MessageEvent<ToWorker>) => void;
};

let organ: Organ | null = null;
let socket: WebSocket | null = null;
let newest: ArrayBuffer | null = null;
let waiting = false; // the page has asked for a frame
const spare: Shape[] = []; // arrays that the page has done with
const sent = new Map<number, number>(); // ms at which a command left, by serial

async function load(address: string): Promise<void> {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(answer.status === 403 ? "refused" : `the server answers ${answer.status}`);
  const data = await answer.arrayBuffer();
  const header = new DataView(data).getUint32(0, true);
  const scene = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, header))) as Scene;
  const rest = new Float32Array(data.slice(4 + header, 4 + header + 12 * scene.nodes));
  const triangles = new Uint32Array(data.slice(4 + header + 12 * scene.nodes));
  const normal = new Float32Array(rest.length);
  normals(rest, outer(scene, triangles), normal);
  organ = { scene, rest, triangles, normals: normal };
  page.postMessage({ kind: "organ", organ });
}

/** The organ's own surface; what lies inside has normals of its own, which need not be right to be felt. */
function outer(scene: Scene, triangles: Uint32Array): Uint32Array {
  const part = scene.parts.find((p) => !p.inside) ?? scene.parts[0];
  return triangles.subarray(3 * part.first, 3 * (part.first + part.count));
}

function connect(address: string): void {
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => page.postMessage({ kind: "status", good: true, text: "" });
  socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
    newest = event.data;
    if (waiting) show();
  };
}

/** Stays connected: asks for the scene anew each time, since another organ may be open by then. */
async function keep(scene: string, address: string): Promise<void> {
  for (let pause = 250; ; pause = Math.min(2 * pause, 4000)) {
    try {
      await load(scene);
      connect(address);
      pause = 250;
      await new Promise<void>((closed) => (socket!.onclose = () => closed()));
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
  if (!newest || !organ) return;
  const frame = decodeFrame(new DataView(newest));
  const { rest, triangles, scene } = organ;
  if (frame.count !== 0 && frame.count !== scene.nodes) return; // of another scene
  const shape = spare.pop() ?? { positions: new Float32Array(rest.length), normals: new Float32Array(rest.length) };
  const { positions } = shape;
  if (frame.count) {
    const moved = new Int16Array(newest, FRAME_BYTES, 3 * frame.count);
    for (let i = 0; i < positions.length; i++) positions[i] = rest[i] + frame.step * moved[i];
  } else positions.set(rest);
  normals(positions, triangles, shape.normals);
  newest = null;
  waiting = false;
  const left = sent.get(frame.serial);
  for (const serial of sent.keys()) if (serial <= frame.serial) sent.delete(serial);
  const delay = left === undefined ? NaN : performance.now() - left;
  page.postMessage({ kind: "frame", frame, shape, delay }, [shape.positions.buffer, shape.normals.buffer]);
}

page.onmessage = ({ data }) => {
  if (data.kind === "open") void keep(data.scene, data.socket);
  else if (data.kind === "tool") {
    if (socket?.readyState !== WebSocket.OPEN) return;
    sent.set(data.tool.serial, performance.now());
    socket.send(encodeTool(data.tool));
  } else {
    if (data.shape && data.shape.positions.length === organ?.rest.length) spare.push(data.shape);
    waiting = true;
    show();
  }
};
