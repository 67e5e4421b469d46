// The worker of the page: it owns the WebSocket or, in an exported file, the session; keeps only the newest frame, and
// decodes it when the page asks for one.
import { ColorMap, FIRST_ENDS } from "./organ/color-map";
import { LocalSession } from "./engine/local-session";
import { TouchEngine } from "./engine/touch-engine";
import { borderEdges, normalize, normals, packNormals, uniqueEdges } from "./organ/mesh-geometry";
import { buffersOf, type ColorMode, type FromWorker, type NodeArrays, type Organ, type Scale, type ToWorker } from "./protocol/worker-messages";
import {
  CloseCode, ComparisonState, DIFFERENCE_BYTES, DIFFERENCE_KIND, DISTANCE_STEPS, FRAME_BYTES, decodeDifference, decodeFrame,
  encodeCompare, encodeMark, encodeScalpel, encodeSelection, encodeToolCommand, type Frame, type Scene,
} from "./protocol/server-messages";

const page = self as unknown as {
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
  onmessage: (event: MessageEvent<ToWorker>) => void;
};

const FAST_DECODE = 4; // ms
const FIRST_RETRY = 250, LAST_RETRY = 4000; // ms

let organ: Organ | null = null;
let colorMap: ColorMap | null = null;
let normalSums: Float32Array<ArrayBuffer>;
let socket: WebSocket | null = null;
let local: LocalSession | null = null; // in place of the socket
let sceneAddress = "";
let fetching = false; // the scene after a cut
let newest: ArrayBuffer | null = null; // frame that was not sent to the page yet
let last: ArrayBuffer | null = null; // frame that was sent last
let lastAtRest = false; // and whether it shows the organ at rest
let mode: ColorMode = "plain";
let scale: Scale = null; // of the colors sent last
const ends = { ...FIRST_ENDS }; // of the scales
let waiting = false; // the page has asked for a frame
let lastSerial = 0; // of the newest command that the last frame obeys
let decodeTime = 0; // ms, of the last frame
let pressing = false; // the first tool measures stiffness
const pool: NodeArrays[] = []; // arrays that the page has returned

async function load(address: string, cut = false): Promise<void> {
  sceneAddress = address;
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(answer.status === 403 ? "refused" : `the server answers ${answer.status}`);
  show(await answer.arrayBuffer(), cut);
}

/** The organ was cut, or a cut was taken back: fetches what is to be drawn now. A failure is that of the socket too. */
function followCut(): void {
  if (fetching) return;
  fetching = true;
  load(sceneAddress, true)
    .catch(() => {})
    .finally(() => (fetching = false));
}

/** Shows an organ, from a `Scene` message. */
function show(data: ArrayBuffer, cut = false): void {
  const header = new DataView(data).getUint32(0, true);
  const scene = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, header))) as Scene;
  const rest = new Float32Array(data.slice(4 + header, 4 + header + 12 * scene.nodes));
  const arrays = scene.gapes ? 2 : 1, open = rest.slice();
  if (scene.gapes) new Float32Array(data.slice(4 + header + 12 * scene.nodes, 4 + header + 24 * scene.nodes)).forEach((x, i) => (open[i] += x));
  const at = 4 + header + 12 * arrays * scene.nodes, end = at + 12 * scene.triangles;
  const triangles = new Uint32Array(data.slice(at, end)), beside = scene.beside.length ? new Uint32Array(data.slice(end)) : null;
  const outer = scene.parts.find((p) => !p.inside) ?? scene.parts[0];
  const surface = triangles.subarray(3 * outer.first, 3 * (outer.first + outer.count));
  const unitNormals = new Float32Array(rest.length);
  // Of the outer surface only: nodes of the inner regions that are not on it keep a zero normal.
  normals(rest, surface, unitNormals);
  normalize(unitNormals);
  const edges = uniqueEdges(triangles, outer.first, outer.count);
  organ = { scene, rest, open, triangles, beside, normals: unitNormals, edges, rims: borderEdges(surface, scene.lips[0]) };
  colorMap = new ColorMap(organ, surface, ends);
  colorMap.mode = mode;
  normalSums = new Float32Array(rest.length);
  pool.length = 0;
  last = newest = null;
  lastAtRest = false;
  page.postMessage({ kind: "organ", organ, cut });
}

function connect(address: string): void {
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    page.postMessage({ kind: "status", good: true, text: "" });
    if (mode === "error") requestComparison(true);
  };
  socket.onmessage = (event: MessageEvent<ArrayBuffer | string>) => {
    if (typeof event.data === "string") return page.postMessage({ kind: "notice", text: event.data });
    if (new DataView(event.data).getUint8(0) === DIFFERENCE_KIND) return takeDifference(event.data);
    takeFrame(event.data);
  };
}

function takeFrame(data: ArrayBuffer): void {
  newest = data;
  if (waiting || supersedes(data)) sendFrame();
}

/** Starts a session of an exported organ: two parts, the scene and the solid, each after its length. */
async function openFile(data: ArrayBuffer, module: ArrayBuffer): Promise<void> {
  const length = new DataView(data).getUint32(0, true);
  const engine = await TouchEngine.load(module);
  show(data.slice(4, 4 + length));
  engine.make(new Uint8Array(data, 8 + length));
  local = new LocalSession(engine, takeFrame);
  local.start();
  page.postMessage({ kind: "status", good: true, text: "" });
}

/** Does the frame obey a newer command than the one that the page has not drawn yet? Then it is sent at once, if decoding
 * it takes little time. */
const supersedes = (data: ArrayBuffer): boolean => decodeTime < FAST_DECODE && decodeFrame(new DataView(data)).serial > lastSerial;

function send(message: ArrayBuffer): void {
  if (local) local.send(message);
  else if (socket?.readyState === WebSocket.OPEN) socket.send(message);
}

/** Asks the server to compare with finite elements, or to stop. */
function requestComparison(on: boolean): void {
  if (colorMap) colorMap.error = null;
  send(encodeCompare({ on: Number(on) }));
}

/** Takes the newest difference: the next frame is colored by it. */
function takeDifference(data: ArrayBuffer): void {
  const difference = decodeDifference(new DataView(data)), { state, step, count } = difference;
  const nodes = organ?.scene.nodes ?? 0;
  if (mode !== "error" || !colorMap || (count !== 0 && count !== nodes)) return;
  const values = new Float32Array(nodes), distances = new Uint16Array(data, DIFFERENCE_BYTES, count);
  for (let i = 0; i < count; i++) values[i] = step * distances[i];
  colorMap.error = state === ComparisonState.compared ? { values, largest: step * DISTANCE_STEPS } : null;
  lastAtRest = false;
  page.postMessage({ kind: "difference", difference });
}

/** Stays connected. Fetches the scene at each connection, since the server may have changed it. */
async function stayConnected(scene: string, address: string): Promise<void> {
  for (let pause = FIRST_RETRY; ; pause = Math.min(2 * pause, LAST_RETRY)) {
    try {
      await load(scene);
      connect(address);
      pause = FIRST_RETRY;
      const code = await new Promise<number>((closed) => (socket!.onclose = (event) => closed(event.code)));
      if (code === CloseCode.scene_changed) {
        page.postMessage({ kind: "status", good: false, text: "Loading another mesh…" });
        continue;
      }
      page.postMessage({ kind: "status", good: false, text: "Connection lost. Trying again…" });
    } catch (problem) {
      const refused = problem instanceof Error && problem.message === "refused";
      const text = refused ? "palpate was restarted: open the new address that it printed." : "palpate is not running. Trying again…";
      page.postMessage({ kind: "status", good: false, text });
    }
    newest = null;
    await new Promise((again) => setTimeout(again, pause));
  }
}

function sendFrame(): void {
  if (!newest || !organ || !colorMap) return;
  const began = performance.now();
  const frame = decodeFrame(new DataView(newest));
  if (frame.body !== organ.scene.body) return followCut();
  if (frame.count !== 0 && frame.count !== organ.scene.nodes) return; // of another scene
  if (pressing) colorMap.addStiffness(frame);
  const unchanged = frame.count === 0 && lastAtRest && !(pressing && mode === "stiffness");
  const arrays = unchanged ? null : computeArrays(newest, frame);
  lastAtRest = frame.count === 0;
  last = newest;
  newest = null;
  waiting = false;
  lastSerial = frame.serial;
  decodeTime = performance.now() - began;
  page.postMessage({ kind: "frame", frame, arrays, scale, work: decodeTime }, arrays ? buffersOf(arrays) : []);
}

function computeArrays(data: ArrayBuffer, { count, step, model }: Frame): NodeArrays {
  const { open, triangles, scene } = organ!;
  const arrays = pool.pop() ?? allocate(open.length / 3);
  const { positions } = arrays;
  if (count) {
    const displacements = new Int16Array(data, FRAME_BYTES, 3 * count);
    for (let i = 0; i < positions.length; i++) positions[i] = open[i] + step * displacements[i];
  } else positions.set(open);
  normals(positions, triangles, normalSums);
  packNormals(normalSums, arrays.normals);
  scale = colorMap!.apply(positions, scene.models[model] ?? scene.model, arrays.colors);
  return arrays;
}

const allocate = (nodes: number): NodeArrays => ({
  positions: new Float32Array(3 * nodes),
  normals: new Int16Array(4 * nodes),
  colors: new Uint8Array(4 * nodes),
});

function recycle(arrays: NodeArrays | null): void {
  if (arrays && arrays.positions.length === organ?.rest.length) pool.push(arrays);
}

function setColorMode(next: ColorMode): void {
  const before = mode;
  mode = next;
  if ((mode === "error") !== (before === "error")) requestComparison(mode === "error");
  if (colorMap) colorMap.mode = mode;
  colorAgain();
}

/** Colors the last frame again. */
function colorAgain(): void {
  lastAtRest = false;
  newest ??= last;
  if (waiting) sendFrame();
}

page.onmessage = ({ data }) => {
  if (data.kind === "open") void stayConnected(data.scene, data.socket);
  else if (data.kind === "return") recycle(data.arrays);
  else if (data.kind === "next") {
    recycle(data.arrays);
    waiting = true;
    pressing = data.pressing;
    sendFrame();
  } else if (data.kind === "color") setColorMode(data.mode);
  else if (data.kind === "ends") {
    ends[data.mode] = data.ends;
    colorAgain();
  } else if (data.kind === "open-file") {
    openFile(data.organ, data.engine).catch((problem: unknown) => page.postMessage({ kind: "status", good: false, text: String(problem) }));
  } else if (data.kind === "save") {
    if (local) page.postMessage({ kind: "record", text: local.recorded() });
  } else if (data.kind === "command") send(encodeToolCommand(data.command));
  else if (data.kind === "select") send(encodeSelection(data.selection));
  else if (data.kind === "scalpel") send(encodeScalpel(data.scalpel));
  else send(encodeMark(data.mark));
};
