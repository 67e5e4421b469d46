// The page: wires the worker, the view, the tools and the panel together.
import type { Colouring } from "./colour";
import { length } from "./geometry";
import type { FromWorker, Shape, ToWorker } from "./link";
import type { Frame, Scene, Vector } from "./messages";
import { Plot } from "./plot";
import { Tools, type Kind } from "./tools";
import { View } from "./view";

const element = <T extends HTMLElement = HTMLElement>(id: string): T => document.getElementById(id) as T;
const write = (id: string, text: string) => (element(id).textContent = text);

const worker = new Worker("static/worker.js", { type: "module" });
const post = (message: ToWorker, transfer: Transferable[] = []) => worker.postMessage(message, transfer);

const canvas = element<HTMLCanvasElement>("view");
const view = new View(canvas);
const plot = new Plot(element<HTMLCanvasElement>("plot"));
const slider = element<HTMLInputElement>("set-depth");
const tools = new Tools(canvas, view, (tool) => post({ kind: "tool", tool }), setDepth);

let scene: Scene | null = null;
let newest: Frame | null = null;
let handed: { frame: Frame; shape: Shape } | null = null; // arrived, not drawn yet
let delay = NaN;

function setDepth(mm: number): void {
  const depth = Math.max(Number(slider.min), Math.min(Number(slider.max), mm));
  slider.value = String(depth);
  write("depth-set", `${depth.toFixed(1)} mm`);
  tools.depth = depth;
}

worker.onmessage = ({ data }: MessageEvent<FromWorker>) => {
  if (data.kind === "organ") {
    const first = scene === null;
    scene = data.organ.scene;
    view.show(data.organ);
    tools.show(data.organ);
    write("title", scene.title);
    const inside = scene.parts.filter((part) => part.inside).map((part) => part.name);
    const about = [`${scene.elements.toLocaleString("en")} tetrahedra`, `model ${scene.model}`];
    if (inside.length) about.push(`inside: ${inside.join(", ")}`);
    if (scene.replay) about.push("replay");
    write("about", about.join(" · "));
    document.title = `${scene.title} – palpate`;
    slider.max = String(0.3 * view.thin); // beyond, no linear model is right
    if (first) setDepth(0.1 * view.thin);
    handed = null;
    post({ kind: "next", shape: null });
  } else if (data.kind === "frame") {
    handed = data;
    if (data.delay === data.delay) delay = delay === delay ? 0.9 * delay + 0.1 * data.delay : data.delay;
  } else {
    element("status").classList.toggle("good", data.good);
    write("status", data.text);
    if (!data.good) tools.release();
  }
};

// One turn of the display: take the newest frame, draw, ask for the next.
let drawn = 0;
function turn(): void {
  requestAnimationFrame(turn);
  if (handed) {
    const { frame, shape } = handed;
    handed = null;
    newest = frame;
    const old = view.move(frame, shape, tools.pressing || scene?.replay === true);
    post({ kind: "next", shape: old }, [old.positions.buffer, old.normals.buffer]);
    feel(frame);
    tools.drawn();
  }
  if (view.draw()) drawn++;
}

function feel(frame: Frame): void {
  const force = length(frame.force), depth = length(frame.displacement), holding = frame.grip === 1;
  plot.add(frame.seconds, force);
  plot.draw();
  write("force", force.toFixed(2));
  write("depth-name", tools.kind === "pull" ? "Pulled by" : "Depth");
  write("depth", holding ? `${depth.toFixed(1)} mm` : "–");
  write("stiffness", holding && depth > 0.5 ? `${(force / depth).toFixed(3)} N/mm` : "–");
  const bar = element("bar");
  bar.classList.toggle("most", scene !== null && force > scene.limit);
  bar.setAttribute("aria-valuenow", force.toFixed(2));
  bar.setAttribute("aria-valuemax", String(plot.top));
  (bar.firstElementChild as HTMLElement).style.transform = `scaleX(${Math.min(1, force / plot.top)})`;
  if (frame.grip === 2) write("hint", "Held still here: take the tissue somewhere else.");
  else hint();
}

function hint(): void {
  const tool = tools.kind === "press"
    ? "Hold on the organ to press, stroke to feel along; the wheel presses deeper."
    : "Take hold of the organ and drag; the wheel pushes it away.";
  write("hint", scene?.replay ? "A recorded session." : `${tool} Drag beside it to turn.`);
}

let figuresAt = performance.now();
let before: Frame | null = null;
setInterval(() => {
  const now = performance.now();
  const rate = (1000 * drawn) / (now - figuresAt);
  write("fps", drawn ? `${rate.toFixed(0)} /s` : "still");
  if (newest && before && newest.seconds > before.seconds)
    write("hz", `${((newest.tick - before.tick) / (newest.seconds - before.seconds)).toFixed(0)} /s`);
  if (newest) {
    write("late", `${newest.late.toLocaleString("en")} (${((100 * newest.late) / Math.max(1, newest.tick)).toFixed(1)} %)`);
    write("busy", `${(1e3 * newest.busy).toFixed(2)} ms`);
  }
  write("delay", delay === delay ? `${delay.toFixed(0)} ms` : "–");
  before = newest;
  figuresAt = now;
  drawn = 0;
}, 1000);

/** A row of buttons of which one is down. */
function choice<T extends string>(id: string, chosen: (value: T) => void): (value: T) => void {
  const buttons = [...element(id).querySelectorAll("button")];
  const choose = (value: T) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.value === value));
    chosen(value);
  };
  for (const button of buttons) button.addEventListener("click", () => choose(button.dataset.value as T));
  return choose;
}

const chooseTool = choice<Kind>("tool", (kind) => {
  tools.release();
  tools.kind = kind;
  element("depth-row").classList.toggle("off", kind !== "press");
  hint();
});
let drawing = "smooth";
const chooseDrawing = choice<string>("draw", (value) => {
  drawing = value;
  view.drawing = value === "wire";
});
choice<Colouring>("colour", (value) => {
  element("legend").hidden = true;
  view.colours = value;
});
view.scale = (low, high, unit) => {
  element("legend").hidden = high === undefined;
  write("low", `${(low ?? 0).toPrecision(2)}`);
  write("high", `${(high ?? 0).toPrecision(2)} ${unit}`);
};

const inside = element("inside");
inside.addEventListener("click", () => {
  const on = inside.getAttribute("aria-pressed") !== "true";
  inside.setAttribute("aria-pressed", String(on));
  view.seeInside = on;
});
const reset = () => {
  view.turntable.reset();
  view.touched();
};
element("reset").addEventListener("click", reset);
slider.addEventListener("input", () => setDepth(Number(slider.value)));

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const keys: Record<string, () => void> = {
    "1": () => chooseTool("press"),
    "2": () => chooseTool("pull"),
    w: () => chooseDrawing(drawing === "wire" ? "smooth" : "wire"),
    i: () => inside.click(),
    r: reset,
    Escape: () => tools.release(),
  };
  keys[event.key]?.();
});

// What tests look at; nothing in the page uses it.
declare global {
  interface Window {
    palpate: {
      readonly frame: Frame | null;
      readonly scene: Scene | null;
      /** Pixel at which a shown node is drawn. */
      pixel(node: number): [number, number];
      /** Pixel at which the material point that is held is drawn. */
      held(): [number, number] | null;
      /** Is the organ under this pixel? */
      under(x: number, y: number): boolean;
    };
  }
}
window.palpate = {
  get frame() {
    return newest;
  },
  get scene() {
    return scene;
  },
  pixel: (node) => view.toPixel([...view.positions.subarray(3 * node, 3 * node + 3)] as Vector),
  held: () => (tools.held ? view.toPixel(tools.held) : null),
  under: (x, y) => tools.under(x, y) !== null,
};

const here = new URL(location.href);
const token = `token=${encodeURIComponent(here.searchParams.get("token") ?? "")}`;
const secure = here.protocol === "https:" ? "wss" : "ws";
post({ kind: "open", scene: `${here.origin}/scene?${token}`, socket: `${secure}://${here.host}/socket?${token}` });
hint();
requestAnimationFrame(turn);
