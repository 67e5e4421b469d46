// Entry point of the touch page: connects the worker, the view, the tools, the input devices and the panel.
import { buffersOf, type ColorMode, type FromWorker, type NodeArrays, type ToWorker } from "../protocol/worker-messages";
import { ContactState, MarkKind, SelectionKind, type Frame, type Scene } from "../protocol/server-messages";
import { takeToken } from "../protocol/access-token";
import { embeddedFile, isExported, workerAddress } from "../protocol/embedded-file";
import { NEEDLE } from "../rendering/tool-meshes";
import { OrganView } from "../rendering/organ-view";
import { CommandQueue } from "../tools/command-queue";
import { MeasureTool } from "../tools/measure-tool";
import { TOOL_KINDS, TOOL_NUMBERS, ToolController, type ToolKind } from "../tools/tool-controller";
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
import { showHint, showMessage } from "./hint";
import { Measuring } from "./measuring";
import { SideSlices } from "./side-slices";
import { exposeTestHooks } from "./test-hooks";

const worker = new Worker(workerAddress(), isExported ? {} : { type: "module" });
const post = (message: ToWorker, transfer: Transferable[] = []) => worker.postMessage(message, transfer);
const token = isExported ? "" : takeToken();

const canvas = element<HTMLCanvasElement>("view");
const view = new OrganView(canvas);
const commands = new CommandQueue((command) => post({ kind: "command", command }));
const measureTool: MeasureTool = new MeasureTool(view, () => measuring.changed(), showMessage);
const measuring = new Measuring(view, measureTool);
const controller = new ToolController(view, commands, measureTool, (scalpel) => post({ kind: "scalpel", scalpel }));
const cursor = new SurfaceCursor(canvas, view, controller);
const depthSlider = new DepthSlider(controller);
const readout = new ForceReadout(commands);
const sideSlices = new SideSlices(token);
const errorReadout = new ErrorReadout();
const legend = new ColorLegend((mode, ends) => post({ kind: "ends", mode, ends }));
const sound = new AudioFeedback();
const webxr = new WebXRInput(view, commands, () => newest);

let scene: Scene | null = null;
let newest: Frame | null = null;
let pending: { frame: Frame; arrays: NodeArrays | null } | null = null; // arrived, not drawn yet
let colorMode: ColorMode = "plain";

const models = new SelectList("model", (index) => post({ kind: "select", selection: { kind: SelectionKind.model, index } }));
element("use-neo-hookean").addEventListener("click", () => models.select("neo-hookean"));
const organs = new SelectList("organ", (index) => post({ kind: "select", selection: { kind: SelectionKind.organ, index } }));
const changeAmount = (steps: number) => depthSlider.change(steps);
const hover = (x: number, y: number): boolean => {
  const hit = controller.pick(x, y);
  if (hit && !controller.needleInserted) sideSlices.moveTo(controller.drawnPoint(hit).position);
  return hit !== null;
};
const pointer = new PointerInput(canvas, view, controller, hover, changeAmount);
const gamepad = new GamepadInput(canvas, view, controller, cursor, {
  changeAmount,
  selectTool: (by) => selectTool(tools()[(tools().indexOf(controller.kind) + by + tools().length) % tools().length]),
  mark: (button) => [markLump, releaseAll, takeSample][button](),
});

worker.onmessage = ({ data }: MessageEvent<FromWorker>) => {
  if (data.kind === "frame") {
    if (scene) sound.add(data.frame, scene.limit);
    const undrawn = pending?.arrays ?? null;
    pending = { frame: data.frame, arrays: data.arrays ?? undrawn };
    if (data.arrays && undrawn) post({ kind: "return", arrays: undrawn }, buffersOf(undrawn));
    legend.update(data.scale, colorMode, scene?.models[data.frame.model] ?? scene?.model ?? "");
    if (colorMode === "error") errorReadout.update(scene, newest);
  } else if (data.kind === "difference") {
    errorReadout.setDifference(data.difference);
  } else if (data.kind === "record") {
    saveText(data.text, "session.json", "application/json");
  } else if (data.kind === "notice") {
    showMessage(data.text);
  } else if (data.kind === "status") {
    element("status").classList.toggle("good", data.good);
    write("status", data.text);
    if (!data.good) {
      releaseAll();
      sound.clear();
    }
  } else if (data.cut && scene) {
    scene = data.organ.scene;
    controller.setCutOrgan(data.organ);
    view.show(data.organ);
    measuring.setOrgan(data.organ);
    cursor.followCut();
    view.toolMeshes.forgetWay();
    describe(scene);
    pending = null;
    post({ kind: "next", arrays: null, pressing: false });
  } else {
    scene = data.organ.scene;
    view.show(data.organ);
    controller.setOrgan(data.organ);
    measuring.setOrgan(data.organ);
    cursor.clear();
    sound.clear();
    commands.clearPending();
    depthSlider.setOrgan(scene, view);
    errorReadout.clear();
    sideSlices.lookAt(view.center, view.size);
    describe(scene);
    pending = null;
    post({ kind: "next", arrays: null, pressing: false });
  }
};

/** What the hand can take in this session. */
const offers = (scene: Scene, kind: string) => (kind === "measure" ? !scene.exam : scene.tools.includes(kind));
const tools = (): ToolKind[] => TOOL_KINDS.filter((kind) => !scene || offers(scene, kind));
/** Colors that this session may show, in the order of their buttons. */
const colors = (): ColorMode[] => COLOR_MODES.filter((mode) => !scene || scene.views.includes(mode));

function describe(scene: Scene): void {
  write("title", scene.title);
  const inside = scene.parts.filter((part) => part.inside).map((part) => part.name);
  const about = [`${scene.elements.toLocaleString("en")} tetrahedra`];
  if (scene.models.length < 2) about.push(`model ${scene.model}`);
  if (scene.made) about.push(scene.made > 1 ? `${scene.made} cuts` : "1 cut");
  if (scene.beside.length) about.push(scene.beside.join(", "));
  if (inside.length) about.push(`inside: ${inside.join(", ")}`);
  if (scene.replay) about.push("replay");
  write("about", about.join(" · "));
  document.title = `${scene.title} – palpate`;
  models.setEntries(scene.models);
  organs.setEntries(scene.organs);
  organs.show(scene.organ);
  element("model-and-mesh").hidden = scene.models.length < 2 && scene.organs.length < 2;
  for (const button of document.querySelectorAll<HTMLElement>("#tool button")) button.hidden = !offers(scene, button.dataset.value!);
  for (const button of document.querySelectorAll<HTMLElement>("#color-mode button")) button.hidden = !scene.views.includes(button.dataset.value!);
  element("shading").parentElement!.hidden = !scene.views.includes("wireframe");
  element("color-mode").parentElement!.hidden = colors().length < 2;
  element("translucent").hidden = !scene.views.includes("inside");
  element("stiffness-row").hidden = element("linearity-row").hidden = element("mesh-error-row").hidden = scene.exam;
  if (!tools().includes(controller.kind)) selectTool(tools()[0]);
  element<HTMLButtonElement>("undo-cut").disabled = scene.made === 0;
  element("slices-toggle").hidden = !scene.images;
  element("task").hidden = element("found").hidden = !scene.task;
  write("task", scene.task);
  updateHint();
}

/** Called once a display frame: takes the newest frame, draws it, and asks for the next. */
function renderLoop(now: number): void {
  const began = performance.now();
  gamepad.poll(now);
  const frame = pending && takeFrame(pending);
  pending = null;
  cursor.draw();
  const drawn = !webxr.active && view.draw();
  if (webxr.active) webxr.update();
  if (drawn) readout.framesDrawn++;
  measuring.draw(drawn, newest !== null && newest.count > 0, now);
  const done = performance.now();
  if (frame) commands.frameDrawn(frame.serial, done);
  sideSlices.draw(now);
  if (frame) testHooks.recordWork(performance.now() - began);
}

function takeFrame({ frame, arrays }: { frame: Frame; arrays: NodeArrays | null }): Frame {
  newest = frame;
  const replaced = view.update(frame, arrays);
  const pressing = controller.pressing || scene?.replay === true;
  post({ kind: "next", arrays: replaced, pressing }, replaced ? buffersOf(replaced) : []);
  readout.add(frame, controller.kind, scene!, performance.now());
  models.show(frame.chosen);
  describeModel(frame);
  const measurement = measure(frame, controller.kind);
  if (measurement) sideSlices.moveTo(view.toolMeshes.tipPositions[measurement.tool]);
  controller.correctGain();
  depthSlider.update();
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
function markLump(): void {
  if (!scene?.task) return;
  const measurement = newest && measure(newest, controller.kind);
  post({ kind: "mark", mark: { kind: MarkKind.lump, tool: measurement?.tool ?? 0 } });
  showMessage(measurement ? "Noted: found, under the tool." : "Noted, but no tool touches the organ: press where the lump is.");
}
function takeSample(): void {
  if (!newest || !(newest.insertion[NEEDLE] > 0)) return showMessage("The needle is not in the tissue: insert it deeper.");
  post({ kind: "mark", mark: { kind: MarkKind.sample, tool: NEEDLE } });
  showMessage(`Sample taken ${newest.insertion[NEEDLE].toFixed(1)} mm deep.`);
}

const chooseTool = selector<ToolKind>("tool", (kind) => {
  pointer.release();
  cursor.release();
  controller.kind = kind;
  element("needle-row").hidden = kind !== "needle";
  element("cut-row").hidden = kind !== "cut";
  element("measure-row").hidden = kind !== "measure";
  measuring.changed();
  depthSlider.update(true);
  updateHint();
});
const selectTool = (kind: ToolKind) => tools().includes(kind) && chooseTool(kind);
const selectNeedleDirection = selector<string>("needle-direction", (value) => controller.setNeedleDirection(value === "inward"));
let shading = "smooth";
const selectShading = selector<string>("shading", (value) => {
  shading = value;
  view.drawWireframe = value === "wire";
});
const COLOR_MODES: ColorMode[] = ["plain", "displacement", "strain", "stiffness", "error"];
const selectColorMode = selector<ColorMode>("color-mode", (mode) => {
  colorMode = mode;
  errorReadout.show(mode === "error");
  post({ kind: "color", mode });
});
const selectSound = selector<SoundMode>("sound", (mode) => sound.select(mode));
const translucentToggle = toggle("translucent", (on) => (view.drawTranslucent = on));
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
const help = element<HTMLDialogElement>("help");
const onClick: Record<string, () => void> = {
  reset: resetView, "save-session": () => post({ kind: "save" }), found: markLump, sample: takeSample, "needle-out": () => controller.withdrawNeedle(), "undo-cut": () => controller.undoCut(), "help-open": () => help.showModal(),
  headset: () => void webxr.enter(scene?.reach ?? 1).catch((problem: unknown) => showMessage(String(problem))),
};
for (const [id, action] of Object.entries(onClick)) element(id).addEventListener("click", action);
element("help-keys").replaceChildren(...HELP.map(([key, text]) => helpRow(key, text)));

listenToKeys(canvas, view, cursor, {
  ...Object.fromEntries(TOOL_KINDS.map((kind, i) => [String(i + 1), () => selectTool(kind)])),
  w: () => scene?.views.includes("wireframe") && selectShading(shading === "wire" ? "smooth" : "wire"),
  c: () => selectColorMode(colors()[(colors().indexOf(colorMode) + 1) % colors().length]),
  m: () => selectSound(SOUND_MODES[(SOUND_MODES.indexOf(sound.mode) + 1) % SOUND_MODES.length]),
  n: () => selectNeedleDirection(controller.inward ? "view" : "inward"),
  i: () => scene?.views.includes("inside") && translucentToggle.click(),
  s: () => scene?.images && slicesToggle.click(),
  o: () => controller.withdrawNeedle(),
  z: () => (controller.kind === "measure" ? measureTool.undo() : scene?.tools.includes("cut") && controller.undoCut()),
  k: () => controller.kind === "measure" && measuring.nextKind(),
  f: markLump,
  r: resetView,
  Enter: () => (controller.kind === "measure" ? measureTool.finish() : takeSample()),
  Escape: () => (measureTool.abandon(), releaseAll()),
  "?": () => help.showModal(),
}, changeAmount);

const testHooks = exposeTestHooks({
  view, controller, cursor, commands, measuring, sideSlices, readout, sound,
  frame: () => newest,
  scene: () => scene,
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
  const secure = location.protocol === "https:" ? "wss" : "ws";
  post({ kind: "open", scene: `${location.origin}/scene?${token}`, socket: `${secure}://${location.host}/socket?${token}` });
}
updateHint();
view.renderer.setAnimationLoop(renderLoop);
