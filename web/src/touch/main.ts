// Entry point of the touch page: connects the worker, the view, the tools, the input devices and the panel.
import { buffersOf, type ColorMode, type FromWorker, type NodeArrays, type ToWorker } from "../protocol/worker-messages";
import { ContactState, SelectionKind, type Frame, type Mark, type Scene } from "../protocol/server-messages";
import type { OtherHand, PiecePose } from "../protocol/room-messages";
import { addresses, takeToken } from "../protocol/access-token";
import { embeddedFile, isExported, workerAddress } from "../protocol/embedded-file";
import { Appearance } from "../rendering/appearance";
import { OrganView } from "../rendering/organ-view";
import { CommandQueue } from "../tools/command-queue";
import { MeasureTool } from "../tools/measure-tool";
import { TOOL_KINDS, TOOL_NUMBERS, ToolController, type ToolKind } from "../tools/tool-controller";
import { Endoscope } from "../endoscopy/endoscope";
import { GamepadInput } from "../input/gamepad";
import { HELP, listenToKeys } from "../input/keyboard";
import { PointerInput } from "../input/pointer";
import { SurfaceCursor } from "../input/surface-cursor";
import { WebXRInput } from "../input/webxr";
import { element, helpRow, saveText, SelectList, selector, toggle, write } from "../ui/controls";
import { ColorLegend } from "../ui/color-legend";
import { DepthSlider } from "../ui/depth-slider";
import { ErrorReadout } from "../ui/error-readout";
import { ForceReadout, measure } from "../ui/force-readout";
import { AudioFeedback, SOUND_MODES, type SoundMode } from "../sound/audio-feedback";
import { aboutText, showHint, showMessage } from "./hint";
import { markLump, takeSample } from "./claims";
import { LookSwitch } from "./look-switch";
import { Measuring } from "./measuring";
import { Notes } from "./notes";
import { Guidance } from "./guidance";
import { EndoscopePanel } from "./endoscope-panel";
import { offersColor, offersTool, showOffers } from "./offers";
import { Pictures } from "./pictures";
import { ReplayControls } from "./replay-controls";
import { RoomPanel } from "./room-panel";
import { NotebookValues } from "./notebook-values";
import { SideSlices } from "./side-slices";
import { TrialPanel } from "./trial-panel";
import { exposeTestHooks } from "./test-hooks";

const beginWorker = () => new Worker(workerAddress(), isExported ? {} : { type: "module" });
const worker = beginWorker();
const post = (message: ToWorker, transfer: Transferable[] = []) => worker.postMessage(message, transfer);
const token = isExported ? "" : takeToken();

const canvas = element<HTMLCanvasElement>("view");
const appearance = new Appearance(showMessage);
const view = new OrganView(canvas, appearance);
const guidance: Guidance = new Guidance(() => commands, (guided) => post({ kind: "guided", guided }));
const commands: CommandQueue = new CommandQueue((command, hand) => {
  guidance.moved(command, hand);
  post({ kind: "command", command });
});
const notes = new Notes((note, text) => post({ kind: "note", note, text }), () => measuring.changed());
const measureTool: MeasureTool = new MeasureTool(view, () => measuring.changed(), showMessage, (hit) => notes.write(hit));
const measuring: Measuring = new Measuring(view, measureTool, notes);
const controller = new ToolController(view, commands, measureTool, (scalpel) => post({ kind: "scalpel", scalpel }));
const cursor = new SurfaceCursor(canvas, view, controller);
const depthSlider = new DepthSlider(controller);
const readout = new ForceReadout(commands);
const replay = new ReplayControls(view, (play) => post({ kind: "play", play }), () => addresses(`${token}&beside=1`));
const sideSlices = new SideSlices(token);
const errorReadout = new ErrorReadout();
const legend = new ColorLegend((mode, ends) => post({ kind: "ends", mode, ends }));
const sound = new AudioFeedback();
const trials = new TrialPanel(view, (choice) => post({ kind: "choose", choice }), () => releaseAll());
const room: RoomPanel = new RoomPanel(view, (lead) => post({ kind: "lead", lead }), () => scene && describe(scene), () => {
  releaseAll();
  newest?.contact.forEach((state, tool) => state !== ContactState.idle && commands.release(tool, true)); // what was taken over
}, (on) => post({ kind: "predict", on }));
const webxr = new WebXRInput(view, commands, () => newest);

const endoscope = new Endoscope(view, commands, () => controller.kind === "grasp");
const leaveEndoscope = () => {
  endoscope.leave();
  cursor.clear();
  if (controller.kind === "camera") selectTool(tools()[0]);
};
const endoscopePanel = new EndoscopePanel(endoscope, leaveEndoscope);

const pictures = new Pictures(() => [view, ...replay.views], () => ({
  title: scene?.title ?? "organ", seconds: (newest?.tick ?? 0) / 1000, force: (newest && measure(newest, controller.kind)?.force) ?? 0, mode: colorMode, scale: legend.scale,
}), showMessage);

let scene: Scene | null = null;
let newest: Frame | null = null;
let hands: OtherHand[] = []; // of others in a room
let pending: { frame: Frame; arrays: NodeArrays | null; hands: OtherHand[]; pieces: PiecePose[] } | null = null; // arrived, not drawn yet
let colorMode: ColorMode = "plain";

const models = new SelectList("model", (index) => post({ kind: "select", selection: { kind: SelectionKind.model, index } }));
element("use-neo-hookean").addEventListener("click", () => models.select("neo-hookean"));
const organs = new SelectList("organ", (index) => post({ kind: "select", selection: { kind: SelectionKind.organ, index } }));
const changeAmount = (steps: number) => (controller.kind === "camera" ? endoscope.step(steps) : depthSlider.change(steps));
const hover = (x: number, y: number): boolean => {
  const hit = controller.pick(x, y);
  if (hit && !controller.needleInserted) sideSlices.moveTo(controller.drawnPoint(hit).position);
  return hit !== null || controller.pieceAt(x, y) !== null;
};
const pointer = new PointerInput(canvas, view, controller, hover, changeAmount);
const gamepad = new GamepadInput(canvas, view, controller, cursor, {
  changeAmount,
  selectTool: (by) => trials.active ? trials.show(by < 0 ? 1 : 2) : selectTool(tools()[(tools().indexOf(controller.kind) + by + tools().length) % tools().length]),
  mark: (button) => trials.active ? trials.button(button) : [claimLump, releaseAll, claimSample][button](),
});

worker.onmessage = ({ data }: MessageEvent<FromWorker>) => {
  if (data.kind === "frame") {
    if (scene) sound.add(data.frame, scene.limit);
    const undrawn = pending?.arrays ?? null;
    pending = { frame: data.frame, arrays: data.arrays ?? undrawn, hands: data.hands, pieces: data.pieces };
    if (data.arrays && undrawn) post({ kind: "return", arrays: undrawn }, buffersOf(undrawn));
    legend.update(data.scale, colorMode, scene?.models[data.frame.model] ?? scene?.model ?? "");
    if (colorMode === "error") errorReadout.update(scene, newest);
  } else if (data.kind === "difference") {
    errorReadout.setDifference(data.difference);
  } else if (data.kind === "record") {
    if (data.file) saveText(data.text, "session.json", "application/json");
    else notebook.setRecord(data.text);
  } else if (data.kind === "bodies") {
    const bodies: ToWorker = data; // a worker that a file has begun may begin none
    beginWorker().postMessage(bodies, [data.port]);
  } else if (data.kind === "trial") {
    trials.update(data.status);
  } else if (data.kind === "timeline" || data.kind === "position") {
    replay.take(data);
  } else if (data.kind === "people") {
    room.take(data.room);
  } else if (data.kind === "guidance") {
    guidance.take(data.told, room.you);
  } else if (data.kind === "prediction") {
    room.predicts(data.state);
  } else if (data.kind === "way") {
    room.setWay(data.milliseconds);
  } else if (data.kind === "notes") {
    notes.take(data.notes);
  } else if (data.kind === "stale") {
    sound.clear();
    guidance.lose();
    if (scene) readout.lose(scene.limit);
  } else if (data.kind === "notice") {
    showMessage(data.text);
  } else if (data.kind === "status") {
    element("status").classList.toggle("good", data.good);
    write("status", data.text);
    if (!data.good) {
      releaseAll();
      sound.clear();
      guidance.drop();
      if (scene) readout.lose(scene.limit);
    }
  } else if (data.cut && scene) {
    scene = data.organ.scene;
    controller.setCutOrgan(data.organ);
    view.show(data.organ);
    measuring.setOrgan(data.organ);
    endoscope.setOrgan(data.organ, true);
    cursor.followCut();
    view.toolMeshes.forgetWay();
    describe(scene);
    pending = null;
    post({ kind: "next", arrays: null, pressing: false });
  } else {
    scene = data.organ.scene;
    guidance.reset();
    view.show(data.organ);
    controller.setOrgan(data.organ);
    measuring.setOrgan(data.organ);
    endoscope.setOrgan(data.organ, false);
    endoscopePanel.setOrgan();
    cursor.clear();
    sound.clear();
    commands.clearPending();
    depthSlider.setOrgan(scene, view);
    errorReadout.clear();
    trials.setOrgan(data.organ);
    if (trials.active) selectSound(scene.channel === "sound" ? "pitch" : "off");
    sideSlices.lookAt(view.center, view.size);
    describe(scene);
    pending = null;
    post({ kind: "next", arrays: null, pressing: false });
  }
};

/** What the hand can take in this session. */
const tools = (): ToolKind[] => TOOL_KINDS.filter((kind) => !scene || offersTool(scene, kind, room.watches));
/** Colors that this session may show, in the order of their buttons. */
const colors = (): ColorMode[] => COLOR_MODES.filter((mode) => !scene || offersColor(scene, mode, room.leads));

function describe(scene: Scene): void {
  write("title", scene.title);
  write("about", aboutText(scene));
  document.title = `${scene.title} – palpate`;
  models.setEntries(scene.models);
  organs.setEntries(scene.organs);
  organs.show(scene.organ);
  room.setOrgan(scene.room, scene.replay);
  replay.following = !room.leads;
  showOffers(scene, room);
  if (!tools().includes(controller.kind)) selectTool(tools()[0]);
  updateHint();
}

/** Called once a display frame: takes the newest frame, draws it, and asks for the next. */
function renderLoop(now: number): void {
  const began = performance.now();
  gamepad.poll(now);
  const frame = pending && takeFrame(pending);
  pending = null;
  cursor.draw();
  trials.draw();
  endoscope.update(now);
  endoscopePanel.update();
  const drawn = !webxr.active && view.draw();
  appearance.count(now, drawn);
  if (webxr.active) webxr.update();
  if (drawn) readout.framesDrawn++;
  replay.draw();
  guidance.update(now);
  room.draw(now, guidance);
  measuring.draw(drawn, newest !== null && newest.count > 0, now);
  pictures.update(now);
  const done = performance.now();
  if (frame) commands.frameDrawn(frame.serial, done);
  sideSlices.draw(now);
  notebook.update(now);
  if (frame) testHooks.recordWork(performance.now() - began);
}

function takeFrame({ frame, arrays, hands: others, pieces }: { frame: Frame; arrays: NodeArrays | null; hands: OtherHand[]; pieces: PiecePose[] }): Frame {
  newest = frame;
  hands = others;
  view.showHands(hands);
  view.showPieces(pieces);
  const replaced = view.update(frame, arrays);
  const pressing = controller.pressing || scene?.replay === true;
  post({ kind: "next", arrays: replaced, pressing }, replaced ? buffersOf(replaced) : []);
  readout.add(frame, controller.kind, scene!, performance.now());
  models.show(frame.chosen);
  describeModel(frame);
  const measurement = measure(frame, controller.kind);
  if (measurement) sideSlices.moveTo(view.toolMeshes.tipPositions[measurement.tool]);
  if (!frame.contact.includes(ContactState.carrying)) controller.correctGain();
  depthSlider.update();
  notes.update(frame.tick);
  replay.update(frame);
  updateHint();
  return frame;
}

function describeModel({ model, chosen }: Frame): void {
  const { models, reason } = scene!;
  write("model-note", model === chosen ? reason && `Began with ${reason}.` : `Making ${models[chosen]}; until then ${models[model]}.`);
}

function updateHint(): void {
  const refused = newest !== null && TOOL_NUMBERS[controller.kind].some((tool) => newest!.contact[tool] === ContactState.refused);
  showHint(controller.kind, measureTool.kind, refused, scene?.replay === true);
}

function releaseAll(): void {
  pointer.release();
  cursor.release();
  controller.releaseAll();
}
const sendMark = (mark: Mark) => {
  post({ kind: "mark", mark });
  notebook.addMark();
};
const claimLump = () => scene?.task && markLump(newest, controller.kind, sendMark);
const claimSample = () => takeSample(newest, sendMark);

const chooseTool = selector<ToolKind>("tool", (kind) => {
  pointer.release();
  cursor.release();
  controller.kind = kind;
  view.toolMeshes.pulls = kind === "pull";
  element("needle-row").hidden = kind !== "needle";
  element("cut-row").hidden = kind !== "cut";
  element("measure-row").hidden = kind !== "measure";
  if (kind === "camera") {
    cursor.clear();
    endoscope.enter();
  }
  measuring.changed();
  depthSlider.update(true);
  updateHint();
});
const selectTool = (kind: ToolKind) => tools().includes(kind) && chooseTool(kind);
const selectNeedleDirection = selector<string>("needle-direction", (value) => controller.setNeedleDirection(value === "inward"));
const looks = new LookSwitch(appearance, (on) => (view.drawWireframe = replay.wireframe = on));
const COLOR_MODES: ColorMode[] = ["plain", "displacement", "strain", "stiffness", "error"];
const selectColorMode = selector<ColorMode>("color-mode", (mode) => {
  colorMode = mode;
  appearance.colored = mode !== "plain";
  errorReadout.show(mode === "error");
  post({ kind: "color", mode });
  replay.show(mode);
});
const selectSound = selector<SoundMode>("sound", (mode) => sound.select(mode));
const translucentToggle = toggle("translucent", (on) => (view.drawTranslucent = replay.translucent = on));
const slicesToggle = toggle("slices-toggle", (on) => {
  document.body.classList.toggle("with-slices", on);
  sideSlices.shown = on;
});
const moreToggle = toggle("more", (on) => {
  moreToggle.setAttribute("aria-expanded", String(on));
  document.body.classList.toggle("with-more", on);
});
const resetView = () => {
  view.turntable.reset();
  view.requestRedraw();
};
/** The view, the tools and what is shown as they were at first; what was measured and written stays. */
const resetAll = () => {
  endoscope.leave();
  measureTool.abandon();
  releaseAll();
  depthSlider.reset();
  chooseTool(tools()[0]);
  looks.reset();
  selectColorMode("plain");
  selectNeedleDirection("inward");
  if (translucentToggle.getAttribute("aria-pressed") === "true") translucentToggle.click();
  resetView();
};
const help = element<HTMLDialogElement>("help");
const onClick: Record<string, () => void> = {
  reset: resetView, "save-session": () => post({ kind: "save", file: true }), found: claimLump, sample: claimSample, "reset-all": () => resetAll(), "needle-out": () => controller.withdrawNeedle(), "undo-cut": () => controller.blade.undo(), "help-open": () => help.showModal(),
  headset: () => void webxr.enter(scene?.reach ?? 1).catch((problem: unknown) => showMessage(String(problem))),
};
for (const [id, action] of Object.entries(onClick)) element(id).addEventListener("click", action);
element("help-keys").replaceChildren(...HELP.map(([key, text]) => helpRow(key, text)));

listenToKeys(canvas, view, cursor, {
  ...Object.fromEntries(TOOL_KINDS.map((kind, i) => [String(i + 1), () => trials.active ? trials.answer(i + 1) : selectTool(kind)])),
  w: () => scene?.views.includes("wireframe") && looks.toggleWires(),
  a: () => looks.toggleLook(),
  c: () => selectColorMode(colors()[(colors().indexOf(colorMode) + 1) % colors().length]),
  x: () => trials.other(),
  m: () => !trials.active && selectSound(SOUND_MODES[(SOUND_MODES.indexOf(sound.mode) + 1) % SOUND_MODES.length]),
  n: () => selectNeedleDirection(controller.inward ? "view" : "inward"),
  i: () => scene?.views.includes("inside") && translucentToggle.click(),
  s: () => scene?.images && slicesToggle.click(),
  o: () => controller.withdrawNeedle(),
  z: () => (controller.kind === "measure" ? measureTool.undo() : scene?.tools.includes("cut") && room.leads && controller.blade.undo()),
  h: () => room.toggleFreeze(),
  g: () => endoscopePanel.toggleFlight(),
  q: () => endoscope.active && leaveEndoscope(),
  k: () => controller.kind === "measure" && measuring.nextKind(),
  ...replay.keys,
  ...pictures.keys,
  0: resetAll,
  f: claimLump,
  r: resetView,
  Enter: () => (controller.kind === "measure" ? measureTool.finish() : claimSample()),
  Escape: () => (measureTool.abandon(), releaseAll()),
  "?": () => help.showModal(),
}, changeAmount);

const notebook = new NotebookValues({
  view, controller, commands, depthSlider, selectTool, selectColor: selectColorMode,
  frame: () => newest, color: () => colorMode, requestRecord: () => post({ kind: "save", file: false }),
});
const testHooks = exposeTestHooks({
  view, controller, cursor, commands, endoscope, measuring, replay, sideSlices, readout, sound,
  frame: () => newest,
  scene: () => scene,
  hands: () => hands,
  guidance: () => ({ told: guidance.told, force: guidance.force }),
});
void WebXRInput.isSupported().then((supported) => (element("headset").hidden = !supported));
if (isExported) {
  write("status", "Preparing the organ…");
  element("save-session").hidden = false;
  // Comparing with finite elements takes a solver that the file does not have.
  document.querySelector('#color-mode [data-value="error"]')?.remove();
  COLOR_MODES.splice(COLOR_MODES.indexOf("error"), 1);
  void embeddedFile().then(({ organ, engine }) => post({ kind: "open-file", organ, engine }, [organ, engine]));
} else {
  const [scene, socket] = addresses(token);
  post({ kind: "open", scene, socket });
}
updateHint();
view.renderer.setAnimationLoop(renderLoop);
