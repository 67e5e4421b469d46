// What is read: force, depth and stiffness of the tool at work, both over time, and how the loop and the page keep up.
import type { Commands } from "./commands";
import { length, slot } from "./geometry";
import { SLOTS, type Kind } from "./hand";
import { NEEDLE } from "./instruments";
import type { Frame, Scene } from "./messages";
import { element, write } from "./controls";
import { Plot } from "./plot";

const DEPTHS: Record<Kind, string> = { press: "Depth", pull: "Pulled by", grasp: "Jaw by", needle: "Inside" };
const WORDS_EVERY = 125, PLOTS_EVERY = 66; // ms

/** Force (N) and depth (mm) of the tool at work: of those of a kind the one that feels most; of others if none is out. */
export function felt(frame: Frame, kind: Kind): { tool: number; force: number; depth: number } | null {
  const out = (tool: number) => frame.grip[tool] === 1;
  const mine = SLOTS[kind].filter(out);
  const tools = mine.length ? mine : [0, 1, 2, 3].filter(out);
  if (!tools.length) return null;
  const force = (tool: number) => length(slot(frame.force, tool));
  const tool = tools.reduce((a, b) => (force(b) > force(a) ? b : a));
  const depth = tool === NEEDLE || frame.inside[tool] > 0 ? frame.inside[tool] : length(slot(frame.displacement, tool));
  return { tool, force: force(tool), depth };
}

export class Readout {
  drawn = 0; // pictures since the last look
  work = 0; // ms of the page's thread a picture, smoothed
  private readonly forces = new Plot(element<HTMLCanvasElement>("force-plot"), "Force, N", 0.1);
  private readonly depths = new Plot(element<HTMLCanvasElement>("depth-plot"), "Depth, mm", 5);
  private wordsAt = 0;
  private plotsAt = 0;
  private lookedAt = performance.now();
  private before: Frame | null = null;
  private newest: Frame | null = null;

  constructor(private readonly commands: Commands) {
    setInterval(() => this.look(), 1000);
  }

  /** Takes a frame in. Words and plots change less often than the picture: nobody reads sixty numbers a second. */
  feel(frame: Frame, kind: Kind, scene: Scene, now: number): void {
    this.newest = frame;
    const here = felt(frame, kind);
    this.forces.add(frame.seconds, here?.force ?? 0);
    this.depths.add(frame.seconds, here?.depth ?? 0);
    if (now - this.wordsAt > WORDS_EVERY) {
      this.wordsAt = now;
      this.words(here, kind);
    }
    if (now - this.plotsAt < PLOTS_EVERY) return;
    this.plotsAt = now;
    this.forces.draw();
    this.depths.draw();
    this.bar(here?.force ?? 0, scene.limit);
  }

  private bar(force: number, limit: number): void {
    const bar = element("bar"), top = this.forces.top;
    bar.classList.toggle("most", force > limit);
    bar.setAttribute("aria-valuenow", force.toFixed(2));
    bar.setAttribute("aria-valuemax", String(top));
    (bar.firstElementChild as HTMLElement).style.transform = `scaleX(${Math.min(1, force / top)})`;
  }

  private words(here: ReturnType<typeof felt>, kind: Kind): void {
    const force = here?.force ?? 0, depth = here?.depth ?? 0;
    write("force", force.toFixed(2));
    write("depth-name", here?.tool === NEEDLE ? DEPTHS.needle : DEPTHS[kind]);
    write("depth", here ? `${depth.toFixed(1)} mm` : "–");
    const one = kind === "press" || kind === "pull"; // two jaws push each other, a needle cuts
    write("stiffness", here && one && here.tool !== NEEDLE && depth > 0.5 ? `${(force / depth).toFixed(3)} N/mm` : "–");
  }

  /** Once a second: rates, delays, energy. */
  private look(): void {
    const now = performance.now(), { newest, before } = this;
    const rate = (1000 * this.drawn) / (now - this.lookedAt);
    write("fps", this.drawn ? `${rate.toFixed(0)} /s` : "still");
    if (newest) write("page", `${this.work.toFixed(1)} ms`);
    if (newest && before && newest.seconds > before.seconds)
      write("hz", `${((newest.tick - before.tick) / (newest.seconds - before.seconds)).toFixed(0)} /s`);
    if (newest) {
      write("late", `${newest.late.toLocaleString("en", { notation: "compact" })} (${((100 * newest.late) / Math.max(1, newest.tick)).toFixed(1)} %)`);
      write("busy", `${(1e3 * newest.busy).toFixed(2)} ms`);
      write("energy", `${newest.energy.toFixed(2).replace(/^-(0\.00)$/, "$1").replace("-", "−")} mJ`);
    }
    const { median, p99, count } = this.commands.latency();
    write("delay", count ? `${median.toFixed(0)} ms, 99 %: ${p99.toFixed(0)} ms` : "–");
    this.before = newest;
    this.lookedAt = now;
    this.drawn = 0;
  }
}
