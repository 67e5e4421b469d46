// The page: wires the worker, the view, the hand and the panel together.
import { Against } from "./against";
import { Beside } from "./beside";
import { UNITS, type Colouring } from "./colour";
import { Commands } from "./commands";
import { choice, element, Options, toggle, write } from "./controls";
import { Cursor } from "./cursor";
import { Gamepads } from "./gamepad";
import { Hand, KINDS, SLOTS, type Kind } from "./hand";
import { Headset } from "./headset";
import { NEEDLE } from "./instruments";
import { HELP, listen } from "./keyboard";
import { buffers, type FromWorker, type Scale, type Shape, type ToWorker } from "./link";
import type { Frame, Scene } from "./messages";
import { Pointer } from "./pointer";
import { Ranges } from "./ranges";
import { felt, Readout } from "./readout";
import { exposed } from "./seen";
import { View } from "./view";

const worker = new Worker("static/worker.js", { type: "module" });
const post = (message: ToWorker, transfer: Transferable[] = []) => worker.postMessage(message, transfer);
const here = new URL(location.href);
const token = `token=${encodeURIComponent(here.searchParams.get("token") ?? "")}`;

const canvas = element<HTMLCanvasElement>("view");
const view = new View(canvas);
const commands = new Commands((tool) => post({ kind: "say", tool }));
const hand = new Hand(view, commands);
const cursor = new Cursor(canvas, view, hand);
const ranges = new Ranges(hand);
const readout = new Readout(commands);
const beside = new Beside(token);
const against = new Against();
const headset = new Headset(view, commands, () => newest);

let scene: Scene | null = null;
let newest: Frame | null = null;
let handed: { frame: Frame; shape: Shape | null } | null = null; // arrived, not drawn yet
let colouring: Colouring = "plain";

const models = new Options("model", (index) => post({ kind: "choose", choose: { what: 0, index } }));
const organs = new Options("organ", (index) => post({ kind: "choose", choose: { what: 1, index } }));
const drive = (notches: number) => ranges.drive(notches);
const hovers = (x: number, y: number): boolean => {
  const hit = hand.under(x, y);
  if (hit && !hand.pierced) beside.at(hand.drawnAt(hit).place);
  return hit !== null;
};
const pointer = new Pointer(canvas, view, hand, hovers, drive);
const pads = new Gamepads(canvas, view, hand, cursor, {
  drive,
  choose: (by) => chooseTool(KINDS[(KINDS.indexOf(hand.kind) + by + KINDS.length) % KINDS.length]),
  mark: (button) => [found, letGo, sample][button](),
});

worker.onmessage = ({ data }: MessageEvent<FromWorker>) => {
  if (data.kind === "frame") {
    const undrawn = handed?.shape ?? null;
    handed = { frame: data.frame, shape: data.shape ?? undrawn };
    if (data.shape && undrawn) post({ kind: "back", shape: undrawn }, buffers(undrawn));
    legend(data.scale);
  } else if (data.kind === "difference") {
    against.take(data.difference);
  } else if (data.kind === "status") {
    element("status").classList.toggle("good", data.good);
    write("status", data.text);
    if (!data.good) letGo();
  } else {
    scene = data.organ.scene;
    view.show(data.organ);
    hand.show(data.organ);
    cursor.forget();
    commands.forget();
    ranges.show(scene, view);
    against.forget();
    beside.frame(view.centre, view.size);
    describe(scene);
    handed = null;
    post({ kind: "next", shape: null, pressing: false });
  }
};

function describe(scene: Scene): void {
  write("title", scene.title);
  const inside = scene.parts.filter((part) => part.inside).map((part) => part.name);
  const about = [`${scene.elements.toLocaleString("en")} tetrahedra`];
  if (scene.models.length < 2) about.push(`model ${scene.model}`);
  if (inside.length) about.push(`inside: ${inside.join(", ")}`);
  if (scene.replay) about.push("replay");
  write("about", about.join(" · "));
  document.title = `${scene.title} – palpate`;
  models.offer(scene.models);
  organs.offer(scene.organs);
  organs.show(scene.organ);
  element("choices").hidden = scene.models.length < 2 && scene.organs.length < 2;
  element("slices-toggle").hidden = !scene.images;
  element("task").hidden = element("found").hidden = !scene.task;
  write("task", scene.task);
  hint();
}

// One turn of the display: take the newest frame, draw, ask for the next.
function turn(now: number): void {
  const began = performance.now();
  pads.poll(now);
  const frame = handed && received(handed);
  handed = null;
  cursor.draw();
  if (headset.on) headset.turn();
  else if (view.draw()) readout.drawn++;
  const done = performance.now();
  if (frame) commands.drawn(frame.serial, done);
  beside.draw(now);
  if (frame) seen.work(performance.now() - began);
}

function received({ frame, shape }: { frame: Frame; shape: Shape | null }): Frame {
  newest = frame;
  const old = view.move(frame, shape);
  const pressing = hand.pressing || scene?.replay === true;
  post({ kind: "next", shape: old, pressing }, old ? buffers(old) : []);
  readout.feel(frame, hand.kind, scene!, performance.now());
  models.show(frame.model);
  const at = felt(frame, hand.kind);
  if (at) beside.at(view.instruments.ends[at.tool]);
  hand.drawn();
  ranges.draw();
  hint();
  return frame;
}

function legend(scale: Scale): void {
  element("scale").hidden = !scale;
  element("legend").hidden = !scale && colouring !== "error";
  if (colouring === "error") against.write(scene, newest);
  if (!scale) return;
  write("low", scale[0].toPrecision(2));
  write("high", `${scale[1].toPrecision(2)} ${UNITS[colouring]}`);
}

const HINTS: Record<Kind, string> = {
  press: "Hold on the organ to press, stroke to feel along; the wheel presses deeper.",
  pull: "Take hold of the organ and drag; the wheel lifts it.",
  grasp: "Two jaws take hold left and right; drag to move them, the wheel pinches.",
  needle: "Click where the needle goes in; the wheel or the slider drives it.",
};
let toldUntil = 0;
function tell(text: string): void {
  toldUntil = performance.now() + 3000;
  write("hint", text);
}
function hint(): void {
  if (performance.now() < toldUntil) return;
  const refused = newest && SLOTS[hand.kind].some((tool) => newest!.grip[tool] === 2);
  if (refused) write("hint", "Held still here: take the tissue somewhere else.");
  else write("hint", scene?.replay ? "A recorded session." : `${HINTS[hand.kind]} Drag beside it to turn.`);
}

function letGo(): void {
  pointer.release();
  cursor.release();
  hand.letGoOfAll();
}
function found(): void {
  if (!scene?.task) return;
  const at = newest && felt(newest, hand.kind);
  post({ kind: "mark", mark: { what: 0, tool: at?.tool ?? 0 } });
  tell(at ? "Noted: found, here under the tool." : "Noted, but no tool touches the organ: press where the lump is.");
}
function sample(): void {
  if (!newest || !(newest.inside[NEEDLE] > 0)) return tell("The needle is not in the tissue: drive it deeper.");
  post({ kind: "mark", mark: { what: 1, tool: NEEDLE } });
  tell(`Sample taken ${newest.inside[NEEDLE].toFixed(1)} mm deep.`);
}

const chooseTool = choice<Kind>("tool", (kind) => {
  pointer.release();
  cursor.release();
  hand.kind = kind;
  element("needle-row").hidden = kind !== "needle";
  ranges.draw(true);
  hint();
});
const chooseWay = choice<string>("way", (value) => hand.point(value === "inward"));
let drawing = "smooth";
const chooseDrawing = choice<string>("draw", (value) => {
  drawing = value;
  view.drawing = value === "wire";
});
const COLOURINGS: Colouring[] = ["plain", "moved", "strain", "felt", "error"];
const chooseColour = choice<Colouring>("colour", (value) => {
  colouring = value;
  against.show(value === "error");
  post({ kind: "colour", colouring });
});
const inside = toggle("inside", (on) => (view.seeInside = on));
const slices = toggle("slices-toggle", (on) => {
  document.body.classList.toggle("with-slices", on);
  beside.shown = on;
});
const more = toggle("more", (on) => {
  more.setAttribute("aria-expanded", String(on));
  document.body.classList.toggle("with-more", on);
});
const reset = () => {
  view.turntable.reset();
  view.touched();
};
const help = element<HTMLDialogElement>("help");
const clicks: Record<string, () => void> = {
  reset, found, sample, out: () => hand.withdraw(), "help-open": () => help.showModal(),
  headset: () => void headset.enter(scene?.reach ?? 1).catch((problem: unknown) => tell(String(problem))),
};
for (const [id, click] of Object.entries(clicks)) element(id).addEventListener("click", click);
element("help-keys").replaceChildren(...HELP.map(([key, what]) => {
  const row = document.createElement("tr"), head = document.createElement("th"), cell = document.createElement("td");
  head.scope = "row";
  head.textContent = key;
  cell.textContent = what;
  row.append(head, cell);
  return row;
}));

listen(canvas, view, cursor, {
  ...Object.fromEntries(KINDS.map((kind, i) => [String(i + 1), () => chooseTool(kind)])),
  w: () => chooseDrawing(drawing === "wire" ? "smooth" : "wire"),
  c: () => chooseColour(COLOURINGS[(COLOURINGS.indexOf(colouring) + 1) % COLOURINGS.length]),
  n: () => chooseWay(hand.inward ? "along" : "inward"),
  i: () => inside.click(),
  s: () => scene?.images && slices.click(),
  o: () => hand.withdraw(),
  f: found,
  r: reset,
  Enter: sample,
  Escape: letGo,
  "?": () => help.showModal(),
}, drive);

const seen = exposed({
  view, hand, cursor, commands, beside, readout,
  frame: () => newest,
  scene: () => scene,
});
void Headset.offered().then((there) => (element("headset").hidden = !there));
const secure = here.protocol === "https:" ? "wss" : "ws";
post({ kind: "open", scene: `${here.origin}/scene?${token}`, socket: `${secure}://${here.host}/socket?${token}` });
hint();
view.renderer.setAnimationLoop(turn);
