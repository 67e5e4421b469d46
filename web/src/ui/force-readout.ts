// The measurements: force, depth and stiffness of the active tool as numbers and over time, and the timing of loop and page.
import { isExported } from "../protocol/embedded-file";
import type { CommandQueue } from "../tools/command-queue";
import { length, toolVector } from "../organ/mesh-geometry";
import { TOOL_NUMBERS, type ToolKind } from "../tools/tool-controller";
import { NEEDLE } from "../rendering/tool-meshes";
import { ContactState, TOOLS, type Frame, type Scene } from "../protocol/server-messages";
import { element, write } from "./controls";
import { TimePlot } from "./time-plot";

const DEPTH_LABELS: Record<ToolKind, string> = { press: "Depth", pull: "Pulled by", grasp: "Jaw by", needle: "Inside", cut: "Depth", measure: "Depth", camera: "Wall by" };
const NUMBERS_INTERVAL = 125, PLOTS_INTERVAL = 66, TIMING_INTERVAL = 1000; // ms
const MIN_DEPTH = 0.5; // mm: no stiffness below

export interface Measurement {
  tool: number;
  force: number; // N
  depth: number; // mm
  cutting: boolean; // a blade; depth: how far it is ahead of the end of its cut
}

/** Force and depth of the active tool: of the tools of a kind the one with the largest force; of all tools if none of that
 * kind is in contact. */
export function measure(frame: Frame, kind: ToolKind): Measurement | null {
  const felt: number[] = [ContactState.closed, ContactState.cutting, ContactState.carrying], inContact = (tool: number) => felt.includes(frame.contact[tool]);
  const ofKind = TOOL_NUMBERS[kind].filter(inContact);
  const tools = ofKind.length ? ofKind : Array.from({ length: TOOLS }, (_, i) => i).filter(inContact);
  if (!tools.length) return null;
  const force = (tool: number) => length(toolVector(frame.force, tool));
  const tool = tools.reduce((a, b) => (force(b) > force(a) ? b : a));
  const isNeedle = tool === NEEDLE || frame.insertion[tool] > 0;
  const depth = isNeedle ? frame.insertion[tool] : length(toolVector(frame.displacement, tool));
  return { tool, force: force(tool), depth, cutting: frame.contact[tool] === ContactState.cutting };
}

/** The force's estimated error as a band: at least 1 % of the force, since the estimate itself is no better. */
function meshError(force: number, relative: number): string {
  if (Number.isNaN(relative)) return "–";
  return `± ${(Math.max(Math.abs(relative), 0.01) * force).toFixed(2)} N`;
}

/** What the spread of the tissue's stiffness makes of the force, one standard deviation. */
function spread(force: number, relative: number): string {
  return Number.isNaN(relative) ? "–" : `± ${(relative * force).toFixed(2)} N`;
}

const MOST_LINEARISATION = 0.1; // of the force; beyond it, or where elements turn over, linear strain is not valid

/** How old the solution is that the force of a model at two rates rests on, and how exact. */
function solution(frame: Frame): string {
  if (!frame.solution_age) return "–";
  return `${Math.round(1000 * frame.solution_age)} ms old, ± ${(100 * frame.solution_error).toFixed(0)} %`;
}

/** Whether linear strain is valid for what is held now, as far as the server has said. */
export function linearity(frame: Frame): { valid: boolean; text: string } {
  const { linearisation: error, least_volume } = frame;
  const size = `${Math.round(100 * Math.abs(error))} % too ${error > 0 ? "stiff" : "soft"}`;
  if (least_volume <= 0 || Number.isNaN(error)) return { valid: false, text: "elements inverted" };
  if (Math.abs(error) > MOST_LINEARISATION) return { valid: false, text: size };
  return { valid: true, text: Math.abs(error) < 0.005 ? "valid" : size };
}

export class ForceReadout {
  framesDrawn = 0; // since the timing was last updated
  work = 0; // ms of the page's thread for a frame, smoothed
  private readonly forcePlot = new TimePlot(element<HTMLCanvasElement>("force-plot"), "Force, N", 0.1);
  private readonly depthPlot = new TimePlot(element<HTMLCanvasElement>("depth-plot"), "Depth, mm", 5);
  private numbersUpdated = 0; // ms
  private plotsUpdated = 0;
  private last = 0; // timer of the last update
  private timingUpdated = performance.now();
  private before: Frame | null = null; // when the timing was last updated
  private newest: Frame | null = null;

  constructor(private readonly commands: CommandQueue) {
    setInterval(() => this.updateTiming(), TIMING_INTERVAL);
  }

  /** Adds a frame. Numbers and plots are updated less often than the picture. */
  add(frame: Frame, kind: ToolKind, scene: Scene, now: number): void {
    this.newest = frame;
    const here = measure(frame, kind);
    this.forcePlot.add(frame.seconds, here?.force ?? 0);
    this.depthPlot.add(frame.seconds, here?.depth ?? 0);
    clearTimeout(this.last);
    this.last = setTimeout(() => this.update(frame, kind, scene, Infinity), NUMBERS_INTERVAL); // a replay that is paused sends no other frame
    this.update(frame, kind, scene, now);
  }

  /** The server is lost: no force is shown from now on. */
  lose(limit: number): void {
    clearTimeout(this.last);
    write("force", "0.00");
    for (const id of ["depth", "stiffness", "mesh-error", "spread"]) write(id, "–");
    this.updateBar(0, limit);
  }

  private update(frame: Frame, kind: ToolKind, scene: Scene, now: number): void {
    const here = measure(frame, kind);
    if (now - this.numbersUpdated > NUMBERS_INTERVAL) {
      this.numbersUpdated = performance.now();
      this.updateNumbers(here, kind);
      write("mesh-error", here ? meshError(here.force, frame.mesh_error) : "–");
      write("spread", here ? spread(here.force, frame.stiffness_spread) : "–");
      const finiteStrain = scene.models[frame.model] === "neo-hookean";
      if (frame.stiffness_spread > 0 || finiteStrain) element("spread-row").hidden = finiteStrain; // else as it was: no row jumps
      element("linearity-row").hidden = element("mesh-error-row").hidden = finiteStrain || isExported || scene.exam;
      element("solution-row").hidden = !finiteStrain;
      write("solution", solution(frame));
      if (finiteStrain || scene.exam) element("hand-over").hidden = true;
      else if (!Number.isNaN(frame.least_volume)) this.updateLinearity(frame);
    }
    if (now - this.plotsUpdated < PLOTS_INTERVAL) return;
    this.plotsUpdated = performance.now();
    this.forcePlot.draw();
    this.depthPlot.draw();
    this.updateBar(here?.force ?? 0, scene.limit);
  }

  /** Not while nothing is held: who lets go to press the button must still find it. */
  private updateLinearity(frame: Frame): void {
    const { valid, text } = linearity(frame);
    write("linearity", text);
    element("linearity").classList.toggle("warning", !valid);
    element("hand-over").hidden = valid;
  }

  private updateBar(force: number, limit: number): void {
    const bar = element("bar"), top = this.forcePlot.top;
    bar.classList.toggle("over-limit", force > limit);
    bar.setAttribute("aria-valuenow", force.toFixed(2));
    bar.setAttribute("aria-valuemax", String(top));
    (bar.firstElementChild as HTMLElement).style.transform = `scaleX(${Math.min(1, force / top)})`;
  }

  private updateNumbers(here: Measurement | null, kind: ToolKind): void {
    const force = here?.force ?? 0, depth = here?.depth ?? 0;
    write("force", force.toFixed(2));
    write("depth-name", here?.cutting ? "Ahead by" : here?.tool === NEEDLE ? DEPTH_LABELS.needle : DEPTH_LABELS[kind]);
    write("depth", here ? `${depth.toFixed(1)} mm` : "–");
    const single = kind === "press" || kind === "pull"; // two jaws push each other, a needle cuts: no stiffness
    write("stiffness", here && single && here.tool !== NEEDLE && depth > MIN_DEPTH ? `${(force / depth).toFixed(3)} N/mm` : "–");
  }

  /** Once a second: rates, delays, energy. */
  private updateTiming(): void {
    const now = performance.now(), { newest, before } = this;
    const rate = (1000 * this.framesDrawn) / (now - this.timingUpdated);
    write("fps", this.framesDrawn ? `${rate.toFixed(0)} /s` : "still");
    if (newest) write("page", `${this.work.toFixed(1)} ms`);
    if (newest && before && newest.seconds > before.seconds)
      write("tick-rate", `${((newest.tick - before.tick) / (newest.seconds - before.seconds)).toFixed(0)} /s`);
    if (newest) {
      write("late", newest.late ? `${((100 * newest.late) / Math.max(1, newest.tick)).toFixed(1)} %` : "0");
      write("tick-time", `${(1e3 * newest.busy).toFixed(2)} ms`);
      write("energy", `${threeDigits(newest.energy)} mJ`);
    }
    const { median, p99, count } = this.commands.latency();
    write("delay", count ? `${median.toFixed(0)} ms, 99 %: ${p99.toFixed(0)} ms` : "–");
    this.before = newest;
    this.timingUpdated = now;
    this.framesDrawn = 0;
  }
}

/** 1.23, 12.3, 123: more would not fit beside its name. */
const threeDigits = (x: number): string => x.toFixed(Math.max(0, 2 - Math.floor(Math.log10(Math.max(1, Math.abs(x)))))).replace(/^-(0\.00)$/, "$1").replace("-", "−");
