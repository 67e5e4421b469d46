// Entry point of the viewer page (`palpate view`): volumes as three planes, scans as a cine loop of projections.
import type { Album, Image, Vector } from "../protocol/server-messages";
import { Cine } from "./cine";
import { Gestures } from "./gestures";
import { HELP, listenToKeys, MOUSE } from "./keyboard";
import { Pane } from "./pane";
import { element, helpRow, saveBlob, write } from "../ui/controls";
import { ControlPanel } from "./control-panel";
import { exportPng } from "./export-png";
import { MeasurePanel } from "./measure-panel";
import type { PlaneName } from "./planes";
import { profileCsv, sampleProfile, type Profile } from "./line-profile";
import { VolumeRendering } from "./volume-rendering";
import { initialSide, ViewState, type Layout } from "./view-state";
import { asValues, fetchValues, ImageSource } from "./image-source";
import { takeToken } from "../protocol/access-token";
import { embeddedAlbum, embeddedValues } from "../protocol/embedded-file";
import { NotebookLink } from "../protocol/notebook-link";
import { setDark } from "../rendering/color-scheme";
import { formatMm, formatNumber } from "./number-format";

const album = embeddedAlbum();
const token = album ? "" : takeToken();
const stage = element("slices");
let state: ViewState, cine: Cine, controls: ControlPanel, measuring: MeasurePanel;
let panes: Pane[] = [];
let renderings: VolumeRendering[] = [];
let needsRedraw = true;
const WORLD = "Axes of the reconstruction: z from the panel to the source; left and right of the patient are not known.";

function showStatus(text: string, isError = false): void {
  write("status", text);
  element("status").classList.toggle("bad", isError);
  element("status").hidden = !text;
}

const sources = new Map<string, ImageSource>();
async function fetchSource(image: Image, i: number, s: number): Promise<ImageSource> {
  const stack = image.stacks[s], key = `${i} ${s}`;
  const onProgress = (share: number) => showStatus(`Loading ${image.title}, ${Math.round(100 * share)} %`);
  const values = () => album ? embeddedValues(i, s).then((bytes) => asValues(bytes, stack)) : fetchValues(`values/${i}/${s}?${token}`, image, stack, onProgress);
  if (!sources.has(key)) sources.set(key, new ImageSource(image, stack, await values()));
  return sources.get(key)!;
}

async function fetchAlbum(): Promise<Album> {
  const answer = await fetch(`album?${token}`);
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

async function open(): Promise<void> {
  const { images } = album ?? (await fetchAlbum());
  const source: ImageSource[] = [];
  for (const [i, image] of images.entries()) source.push(await fetchSource(image, i, 0));
  state = new ViewState(images.map((image, i) => initialSide(image, source[i])), () => (needsRedraw = true), (why) => measuring.tell(why));
  for (const side of state.sides) side.crosshair = [...state.sides[0].crosshair];
  cine = new Cine(state);
  measuring = new MeasurePanel(state, () => `${fileName()}-measurements.csv`);
  controls = new ControlPanel(state, cine, setLayout, (name) => void selectStack(name).catch(showError));
  wire();
  if (album) document.querySelector('#layout [data-value="render"]')!.remove();
  describe(images);
  setLayout(state.scan || innerWidth < 760 ? "axial" : "all");
  new ResizeObserver(() => state.changed()).observe(stage);
  showStatus("");
  notebook.open();
  requestAnimationFrame(renderLoop);
}

const notebook = new NotebookLink({
  dark: (dark: boolean) => (setDark(dark), state.changed()),
  position: (point: Vector) => state.moveCrosshair(state.side, point),
  window: ([low, high]: [number, number]) => state.window(state.side, low, high),
});
function reportToNotebook(now: number): void {
  const { side } = state, { crosshair: position, low, high, source } = side, value = source.at(source.index(position));
  notebook.report(now, { position, window: [low, high], _value: Number.isNaN(value) ? null : value });
}

function wire(): void {
  listenToKeys(state, {
    layout: setLayout,
    tool: (tool) => ((state.tool = tool), state.changed()),
    measure: () => measuring.next(),
    measureHere: () => measuring.addCrosshair(panes),
    play: () => void (state.scan && cine.toggle()),
    speed: (by) => cine.faster(by),
    exportPng: () => void savePng().catch(showError),
    help: showHelp,
  });
  element("reset").addEventListener("click", () => state.reset());
  element("keep").addEventListener("click", () => void savePng().catch(showError));
  element("help-open").addEventListener("click", showHelp);
  element("table").addEventListener("click", () => {
    const profile = sampleProfile(state);
    if (profile) saveBlob(new Blob([profileCsv(profile)], { type: "text/csv" }), `${fileName()}-profile.csv`);
  });
}

function describe(images: Image[]): void {
  write("title", images.map((image) => image.title).join("  |  "));
  document.title = `${images.map((image) => image.title).join(", ")} – palpate`;
  const size = (image: Image) => {
    const [z, y, x] = image.shape;
    if (image.scan) return `${z} views of ${y} × ${x} pixels of ${formatMm(image.spacing[1])}`;
    return `${x} × ${y} × ${z} voxels of ${[2, 1, 0].map((a) => +image.spacing[a].toPrecision(3)).join(" × ")} mm`;
  };
  write("about", [...new Set(images.map(size))].join("  |  "));
  const notes = images.map((image) => image.note);
  if (images.some((image) => !image.scan && !image.patient)) notes.push(WORLD);
  write("note", [...new Set(notes)].filter(Boolean).join(" "));
  const kind = images[0].scan ? "scan" : "volume";
  const keys = HELP.filter(([key, , shownFor]) => (shownFor === "both" || shownFor === kind) && !(album && key === "4"));
  element("help-keys").replaceChildren(...[...keys, ...MOUSE].map(([key, text]) => helpRow(key, text)));
}

/** Arranges the panes: a row for each plane, a column for each side. */
function setLayout(layout: Layout): void {
  if (layout === "render" && album) return; // an embedded page leaves Niivue out
  state.layout = layout;
  const planes: PlaneName[] = layout === "all" ? state.planes : layout === "render" ? [] : [layout];
  if (layout !== "all" && layout !== "render") state.active = layout;
  panes = planes.flatMap((name) => state.sides.map((_, i) => new Pane(state, i, name)));
  for (const pane of panes) new Gestures(pane, state, () => state.scan || setLayout(state.layout === "all" ? pane.plane.name : "all"));
  const shown: HTMLElement[] = panes.map((pane) => pane.element);
  if (layout === "render" || (layout === "all" && state.sides.length === 1 && !state.scan && !album)) shown.push(...renderingElements(layout === "render"));
  const columns = state.sides.length > 1 ? 2 : layout === "all" && !state.scan ? 2 : 1;
  stage.dataset.columns = String(columns);
  stage.dataset.rows = String(Math.ceil(shown.length / columns));
  stage.replaceChildren(...shown);
  state.changed();
}

/** The renderings, or a button that loads them: they take half a megabyte and a graphics card. */
function renderingElements(asked: boolean): HTMLElement[] {
  if (renderings.length || asked) {
    if (!renderings.length) {
      renderings = state.sides.map((side, i) => new VolumeRendering(side, i));
      // Niivue measures its canvas, which must therefore be on the page.
      requestAnimationFrame(() => {
        showStatus("Loading the rendering");
        Promise.all(renderings.map((rendering) => rendering.open())).then(() => showStatus(""), (problem) => {
          renderings = [];
          showError(problem);
        });
      });
    }
    return renderings.map((rendering) => rendering.element);
  }
  const figure = Object.assign(document.createElement("figure"), { className: "pane offer" });
  const button = Object.assign(document.createElement("button"), { textContent: "Render in 3D", title: "(4)" });
  button.addEventListener("click", () => {
    renderingElements(true);
    setLayout("all");
  });
  figure.append(button);
  return [figure];
}

async function selectStack(name: string): Promise<void> {
  for (const [i, side] of state.sides.entries()) {
    const s = side.image.stacks.findIndex((each) => each.name === name);
    side.source = await fetchSource(side.image, i, s);
    const first = side.source.stack.windows[0];
    Object.assign(side, { low: first.low, high: first.high, preset: first.name });
  }
  showStatus("");
  state.changed();
}

function showHelp(): void {
  element<HTMLDialogElement>("help").showModal();
}

const ENDING = /\.(nii|nii\.gz|nrrd|nhdr|mha|mhd|h5|hdf5)$/i;
const fileName = () => state.sides.map((s) => s.image.title.replace(ENDING, "")).join("-").replace(/[^\w.-]+/g, "_");

async function savePng(): Promise<void> {
  drawAll();
  const { side } = state;
  const label = [
    element("title").textContent,
    `window ${formatNumber(side.low)} to ${formatNumber(side.high)} ${side.source.stack.unit}`.trim(),
    element("place").textContent,
    "palpate, research software",
  ].join("  ·  ");
  saveBlob(await exportPng(stage, renderings.filter((r) => r.element.isConnected), label), `${fileName()}.png`);
}

function showError(problem: unknown): void {
  const text = problem instanceof Error ? problem.message : String(problem);
  showStatus(text === "Failed to fetch" ? "palpate is not running: start the command again and open its new address" : text, true);
}

function drawAll(): void {
  for (const pane of panes) {
    pane.draw();
    pane.element.classList.toggle("active", pane.sideIndex === state.activeSide && pane.plane.name === state.active && panes.length > 1);
  }
  for (const rendering of renderings) rendering.draw();
  controls.update(panes);
  measuring.update();
}

function renderLoop(now: number): void {
  requestAnimationFrame(renderLoop);
  cine.update(now);
  reportToNotebook(now);
  if (!needsRedraw) return;
  needsRedraw = false;
  drawAll();
}

// The page's state for tests; nothing in the page uses it.
declare global {
  interface Window {
    viewer: {
      readonly ready: boolean;
      readonly state: ViewState;
      readonly rendered: boolean;
      /** Pixel of the window at which a pane draws a position. */
      pixel(side: number, plane: PlaneName, point: Vector): [number, number];
      profile(): Profile | null;
    };
  }
}
window.viewer = {
  get ready() {
    return Boolean(state) && panes.length > 0 && !needsRedraw;
  },
  get state() {
    return state;
  },
  get rendered() {
    return renderings.length > 0 && renderings.every((rendering) => rendering.ready);
  },
  pixel(side, plane, point) {
    const pane = panes.find((p) => p.sideIndex === side && p.plane.name === plane)!;
    const box = pane.canvas.getBoundingClientRect(), [x, y] = pane.pixel(point);
    return [box.left + x, box.top + y];
  },
  profile: () => sampleProfile(state),
};

open().catch(showError);
