// The worker of the page: it hears the server or, in an exported file, runs the session; keeps only the newest frame, and
// decodes it when the page asks for one.
import { ColorMap, FIRST_ENDS } from "./organ/color-map";
import { BodyBuilder } from "./engine/body-builder";
import { makeBodies } from "./engine/body-worker";
import { withBody } from "./engine/local-cuts";
import { LocalSession } from "./engine/local-session";
import { Prediction } from "./engine/prediction";
import { TouchEngine } from "./engine/touch-engine";
import { allocate, described, looseOrgan, outerSurface } from "./organ/described-organ";
import { normals, packNormals } from "./organ/mesh-geometry";
import { noteMessage, readNotes, readTimeline } from "./protocol/text-messages";
import { readScene, type SceneArrays } from "./protocol/scene-arrays";
import { readHands, readPeople, readPieces, type OtherHand, type PiecePose, type RoomState } from "./protocol/room-messages";
import { ServerConnection } from "./protocol/server-connection";
import { buffersOf, type ColorMode, type FromWorker, type NodeArrays, type Organ, type Scale, type ToWorker } from "./protocol/worker-messages";
import {
  ComparisonState, DIFFERENCE_BYTES, DIFFERENCE_KIND, DISTANCE_STEPS, FRAME_BYTES, decodeDifference, decodeFrame,
  GUIDANCE_KIND, HANDS_KIND, NOTES_KIND, PEOPLE_KIND, PIECES_KIND, POSITION_KIND, TIMELINE_KIND, TRIALSTATUS_KIND, Role, decodeGuidance, decodePosition, decodeTrialStatus, encodeChoice, encodePlay, encodeCompare, encodeMark,
  encodeGuided, encodeLead, encodeScalpel, encodeSelection, encodeToolCommand, type Frame,
} from "./protocol/server-messages";

const page = self as unknown as {
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
  onmessage: (event: MessageEvent<ToWorker>) => void;
};

const FAST_DECODE = 4; // ms

let organ: Organ | null = null;
let colorMap: ColorMap | null = null;
let normalSums: Float32Array<ArrayBuffer>;
let server: ServerConnection | null = null;
let local: LocalSession | null = null; // in place of the server
let fetching = false; // the scene after a cut
let newest: ArrayBuffer | null = null; // frame that was not sent to the page yet
let last: ArrayBuffer | null = null; // frame that was sent last
let lastAtRest = false; // and whether it shows the organ at rest
let mode: ColorMode = "plain";
let scale: Scale = null; // of the colors sent last
const ends = { ...FIRST_ENDS }; // of the scales
let waiting = false; // the page has asked for a frame
let told: OtherHand[] = []; // in a room, of the frame that comes next
let hands: OtherHand[] = []; // of the newest frame
let loose: { body: number; poses: PiecePose[] } = { body: 0, poses: [] }; // the pieces that cuts have freed
let prediction: Prediction | null = null; // in a room
let predictionWanted: boolean | null = null; // by the person
let frozen = false; // the room has stopped this hand
let lastSerial = 0; // of the newest command that the last frame obeys
let decodeTime = 0; // ms, of the last frame
let pressing = false; // the first tool measures stiffness
const pool: NodeArrays[] = []; // arrays that the page has returned

/** The organ was cut, or a cut was taken back: fetches what is to be drawn now. A failure is that of the socket too. */
function followCut(): void {
  if (fetching || !server) return; // a session in the page has shown it
  fetching = true;
  const frame = newest; // a replay that is paused sends no other one
  server
    .fetchScene(true)
    .then(() => (newest ??= frame))
    .catch(() => {})
    .finally(() => (fetching = false));
}

/** Shows an organ, of a `Scene` message or one that was cut in the page. */
function show({ scene, rest, open, triangles, beside, pieces = [] }: SceneArrays, cut = false): void {
  const made = described({ scene, rest, open, triangles, beside }), surface = outerSurface(scene, triangles);
  organ = { ...made, pieces: pieces.map((piece) => looseOrgan(scene, piece)) };
  colorMap = new ColorMap(organ, surface, ends);
  colorMap.mode = mode;
  normalSums = new Float32Array(rest.length);
  pool.length = 0;
  last = newest = null;
  hands = told = [];
  lastAtRest = false;
  page.postMessage({ kind: "organ", organ, cut });
  prediction?.close();
  prediction = scene.room && !scene.replay && server ? new Prediction(scene, rest, server.predictionAddresses, showFrame, (state) => page.postMessage({ kind: "prediction", state }), send, predictionWanted) : null;
  prediction?.stop(frozen);
}

function openServer(scene: string, address: string): void {
  server = new ServerConnection({
    scene: show,
    opened: () => mode === "error" && requestComparison(true),
    message: takeMessage,
    notice: (text) => page.postMessage({ kind: "notice", text }),
    status: (good, text) => page.postMessage({ kind: "status", good, text }),
    stale: () => page.postMessage({ kind: "stale" }),
    silent: (on) => prediction?.hush(on),
    closed: () => (newest = null),
  });
  void server.open(scene, address);
}

/** Tells how long the way is, if a frame obeys the command whose answer is being timed. */
function timeRoundTrip(serial: number): void {
  const milliseconds = server?.liveness.answer(serial) ?? null;
  if (milliseconds === null) return;
  prediction?.measure(milliseconds);
  page.postMessage({ kind: "way", milliseconds });
}

function takeMessage(data: ArrayBuffer): void {
  const kind = new DataView(data).getUint8(0);
  if (kind === DIFFERENCE_KIND) takeDifference(data);
  else if (kind === TRIALSTATUS_KIND) page.postMessage({ kind: "trial", status: decodeTrialStatus(new DataView(data)) });
  else if (kind === HANDS_KIND) told = readHands(data);
  else if (kind === PIECES_KIND) loose = readPieces(data);
  else if (kind === GUIDANCE_KIND) page.postMessage({ kind: "guidance", told: decodeGuidance(new DataView(data)) });
  else if (kind === PEOPLE_KIND) takePeople(readPeople(data));
  else if (kind === NOTES_KIND) page.postMessage({ kind: "notes", notes: readNotes(data) });
  else if (kind === TIMELINE_KIND) page.postMessage({ kind: "timeline", tracks: readTimeline(data) });
  else if (kind === POSITION_KIND) page.postMessage({ kind: "position", position: decodePosition(new DataView(data)) });
  else takeFrame(data);
}

function takePeople(room: RoomState): void {
  frozen = room.frozen && room.people.find(({ number }) => number === room.you)?.role !== Role.teacher;
  prediction?.stop(frozen);
  page.postMessage({ kind: "people", room });
}

/** A frame of the room or of the session in the page. */
function takeFrame(data: ArrayBuffer): void {
  server?.countFrame();
  if (server?.liveness.asking) timeRoundTrip(decodeFrame(new DataView(data)).serial);
  prediction?.hear(data, told);
  if (!prediction?.active) showFrame(data, told);
}

function showFrame(data: ArrayBuffer, others: OtherHand[]): void {
  newest = data;
  hands = others;
  if (waiting || supersedes(data)) sendFrame();
}

/** Starts a session of an exported organ: scene, solid and, of a lesson's case, its rules as JSON, each after its length. */
async function openFile(data: ArrayBuffer, module: ArrayBuffer): Promise<void> {
  const view = new DataView(data), parts: Uint8Array<ArrayBuffer>[] = [];
  for (let at = 0; at < data.byteLength; at += 4 + view.getUint32(at, true)) parts.push(new Uint8Array(data, at + 4, view.getUint32(at, true)));
  const [scene, solid, rules] = parts;
  const engine = await TouchEngine.load(module);
  let first = readScene(scene.slice().buffer);
  show(first);
  engine.make(solid);
  if (engine.first) show((first = withBody(first, engine.first)));
  local = new LocalSession(engine, new BodyBuilder((port) => page.postMessage({ kind: "bodies", port }, [port]), module, solid), first, takeMessage, (opened) => show(opened, true), rules ? JSON.parse(new TextDecoder().decode(rules)) : null, (text) => page.postMessage({ kind: "notice", text }));
  local.start();
  page.postMessage({ kind: "status", good: true, text: "" });
}

/** Does the frame obey a newer command than the one that the page has not drawn yet? Then it is sent at once, if decoding
 * it takes little time. */
const supersedes = (data: ArrayBuffer): boolean => decodeTime < FAST_DECODE && decodeFrame(new DataView(data)).serial > lastSerial;

function send(message: ArrayBuffer): void {
  (local ?? server)?.send(message);
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

function sendFrame(): void {
  if (!newest || !organ || !colorMap) return;
  const began = performance.now();
  const frame = decodeFrame(new DataView(newest));
  if (frame.body !== organ.scene.body) return followCut();
  if (frame.step && !frame.count) return; // without displacements: prediction has just ended
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
  page.postMessage({ kind: "frame", frame, arrays, hands, pieces: loose.body === frame.body ? loose.poses : [], scale, work: decodeTime }, arrays ? buffersOf(arrays) : []);
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
  if (data.kind === "bodies") makeBodies(data.port, () => self.close());
  else if (data.kind === "open") openServer(data.scene, data.socket);
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
    if (local) page.postMessage({ kind: "record", text: local.recorded(), file: data.file });
  } else if (data.kind === "command") {
    server?.liveness.ask(data.command.serial);
    send(encodeToolCommand(data.command));
    prediction?.command(data.command);
  } else if (data.kind === "predict") prediction?.ask((predictionWanted = data.on));
  else if (data.kind === "lead") send(encodeLead(data.lead));
  else if (data.kind === "guided") send(encodeGuided(data.guided));
  else if (data.kind === "select") send(encodeSelection(data.selection));
  else if (data.kind === "choose") send(encodeChoice(data.choice));
  else if (data.kind === "scalpel") send(encodeScalpel(data.scalpel));
  else if (data.kind === "play") send(encodePlay(data.play));
  else if (data.kind === "note") send(noteMessage(data.note, data.text));
  else send(encodeMark(data.mark));
};
