// `palpate view`: volumes as three planes, scans as a loop of projections.
import type { Album, Image, Vector } from "../messages";
import { Cine } from "./cine";
import { Gestures } from "./gestures";
import { HELP, listen, MOUSE } from "./keys";
import { Pane } from "./pane";
import { element, Panel, write } from "./panel";
import { picture, save } from "./picture";
import type { PlaneName } from "./planes";
import { sampled, table, type Profile } from "./profile";
import { Render } from "./render";
import { fresh, State, type Layout } from "./state";
import { fetchValues, Stored } from "./stored";
import { mm, plain } from "./words";

const token = `token=${encodeURIComponent(new URL(location.href).searchParams.get("token") ?? "")}`;
const stage = element("slices");
let state: State, cine: Cine, controls: Panel;
let panes: Pane[] = [];
let renders: Render[] = [];
let stale = true;
const WORLD = "Axes of the reconstruction: z from the panel to the source; left and right of the patient are not known.";

function say(text: string, bad = false): void {
  write("status", text);
  element("status").classList.toggle("bad", bad);
  element("status").hidden = !text;
}

const stores = new Map<string, Stored>();
async function fetched(image: Image, i: number, s: number): Promise<Stored> {
  const stack = image.stacks[s], key = `${i} ${s}`;
  const told = (share: number) => say(`Loading ${image.title}, ${Math.round(100 * share)} %`);
  if (!stores.has(key)) stores.set(key, new Stored(image, stack, await fetchValues(`values/${i}/${s}?${token}`, image, stack, told)));
  return stores.get(key)!;
}

async function open(): Promise<void> {
  const answer = await fetch(`album?${token}`);
  if (!answer.ok) throw new Error(await answer.text());
  const { images }: Album = await answer.json();
  const stored: Stored[] = [];
  for (const [i, image] of images.entries()) stored.push(await fetched(image, i, 0));
  state = new State(images.map((image, i) => fresh(image, stored[i])), () => (stale = true));
  for (const side of state.sides) side.cross = [...state.sides[0].cross];
  cine = new Cine(state);
  controls = new Panel(state, cine, lay, (name) => void choose(name).catch(failed));
  wire();
  describe(images);
  lay(state.scan || innerWidth < 760 ? "axial" : "all");
  new ResizeObserver(() => state.changed()).observe(stage);
  say("");
  requestAnimationFrame(turn);
}

function wire(): void {
  listen(state, {
    layout: lay,
    tool: (tool) => ((state.tool = tool), state.changed()),
    play: () => void (state.scan && cine.toggle()),
    speed: (by) => cine.faster(by),
    picture: () => void keep().catch(failed),
    help,
  });
  element("reset").addEventListener("click", () => state.reset());
  element("keep").addEventListener("click", () => void keep().catch(failed));
  element("help-open").addEventListener("click", help);
  element("table").addEventListener("click", () => {
    const profile = sampled(state);
    if (profile) save(new Blob([table(profile)], { type: "text/csv" }), `${plainName()}-profile.csv`);
  });
}

function describe(images: Image[]): void {
  write("title", images.map((image) => image.title).join("  |  "));
  document.title = `${images.map((image) => image.title).join(", ")} – palpate`;
  const size = (image: Image) => {
    const [z, y, x] = image.shape;
    if (image.scan) return `${z} views of ${y} × ${x} pixels of ${mm(image.spacing[1])}`;
    return `${x} × ${y} × ${z} voxels of ${[2, 1, 0].map((a) => +image.spacing[a].toPrecision(3)).join(" × ")} mm`;
  };
  write("about", [...new Set(images.map(size))].join("  |  "));
  const notes = images.map((image) => image.note);
  if (images.some((image) => !image.scan && !image.patient)) notes.push(WORLD);
  write("note", [...new Set(notes)].filter(Boolean).join(" "));
  const kind = images[0].scan ? "scan" : "volume";
  const rows = (pairs: [string, string][]) => pairs.map(([key, what]) => {
    const row = document.createElement("tr");
    for (const [tag, text] of [["th", key], ["td", what]]) row.append(Object.assign(document.createElement(tag), { textContent: text }));
    return row;
  });
  element("help-keys").replaceChildren(...rows(HELP.filter((h) => h[2] === "both" || h[2] === kind).map(([a, b]) => [a, b])), ...rows(MOUSE));
}

/** Arranges the panes: rows of planes, columns of sides. */
function lay(layout: Layout): void {
  state.layout = layout;
  const planes: PlaneName[] = layout === "all" ? state.planes : layout === "render" ? [] : [layout];
  if (layout !== "all" && layout !== "render") state.active = layout;
  panes = planes.flatMap((name) => state.sides.map((_, i) => new Pane(state, i, name)));
  for (const pane of panes) new Gestures(pane, state, () => state.scan || lay(state.layout === "all" ? pane.plane.name : "all"));
  const shown: HTMLElement[] = panes.map((pane) => pane.element);
  if (layout === "render" || (layout === "all" && state.sides.length === 1 && !state.scan)) shown.push(...rendered(layout === "render"));
  const columns = state.sides.length > 1 ? 2 : layout === "all" && !state.scan ? 2 : 1;
  stage.dataset.columns = String(columns);
  stage.dataset.rows = String(Math.ceil(shown.length / columns));
  stage.replaceChildren(...shown);
  state.changed();
}

/** The renderings, or a button that asks for them: they load half a megabyte and need a graphics card. */
function rendered(asked: boolean): HTMLElement[] {
  if (renders.length || asked) {
    if (!renders.length) {
      renders = state.sides.map((side, i) => new Render(side, i));
      // Niivue measures its canvas, which must therefore be on the page.
      requestAnimationFrame(() => {
        say("Loading the rendering");
        Promise.all(renders.map((render) => render.open())).then(() => say(""), (problem) => {
          renders = [];
          failed(problem);
        });
      });
    }
    return renders.map((render) => render.element);
  }
  const figure = Object.assign(document.createElement("figure"), { className: "pane offer" });
  const button = Object.assign(document.createElement("button"), { textContent: "Render in 3D", title: "(4)" });
  button.addEventListener("click", () => {
    rendered(true);
    lay("all");
  });
  figure.append(button);
  return [figure];
}

async function choose(name: string): Promise<void> {
  for (const [i, side] of state.sides.entries()) {
    const s = side.image.stacks.findIndex((each) => each.name === name);
    side.stored = await fetched(side.image, i, s);
    const first = side.stored.stack.windows[0];
    Object.assign(side, { low: first.low, high: first.high, preset: first.name });
  }
  say("");
  state.changed();
}

function help(): void {
  element<HTMLDialogElement>("help").showModal();
}

const ENDING = /\.(nii|nii\.gz|nrrd|nhdr|mha|mhd|h5|hdf5)$/i;
const plainName = () => state.sides.map((s) => s.image.title.replace(ENDING, "")).join("-").replace(/[^\w.-]+/g, "_");

async function keep(): Promise<void> {
  frame();
  const { side } = state;
  const words = [
    element("title").textContent,
    `window ${plain(side.low)} to ${plain(side.high)} ${side.stored.stack.unit}`.trim(),
    element("place").textContent,
    "palpate, research software",
  ].join("  ·  ");
  save(await picture(stage, renders.filter((r) => r.element.isConnected), words), `${plainName()}.png`);
}

function failed(problem: unknown): void {
  const text = problem instanceof Error ? problem.message : String(problem);
  say(text === "Failed to fetch" ? "palpate is not running: start the command again and open its new address" : text, true);
}

function frame(): void {
  for (const pane of panes) {
    pane.draw();
    pane.element.classList.toggle("active", pane.number === state.chosen && pane.plane.name === state.active && panes.length > 1);
  }
  for (const render of renders) render.draw();
  controls.show(panes);
}

function turn(now: number): void {
  requestAnimationFrame(turn);
  cine.turn(now);
  if (!stale) return;
  stale = false;
  frame();
}

// What tests look at; nothing in the page uses it.
declare global {
  interface Window {
    viewer: {
      readonly ready: boolean;
      readonly state: State;
      readonly rendered: boolean;
      /** Pixel of the window at which a pane draws a position. */
      pixel(side: number, plane: PlaneName, point: Vector): [number, number];
      profile(): Profile | null;
    };
  }
}
window.viewer = {
  get ready() {
    return Boolean(state) && panes.length > 0 && !stale;
  },
  get state() {
    return state;
  },
  get rendered() {
    return renders.length > 0 && renders.every((render) => render.ready);
  },
  pixel(side, plane, point) {
    const pane = panes.find((p) => p.number === side && p.plane.name === plane)!;
    const box = pane.canvas.getBoundingClientRect(), [x, y] = pane.pixel(point);
    return [box.left + x, box.top + y];
  },
  profile: () => sampled(state),
};

open().catch(failed);
