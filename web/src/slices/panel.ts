// The panel beside the panes: the read-out and the controls.
import type { Cine } from "./cine";
import { PLANES, title, type PlaneName, type SlabMode } from "./planes";
import { plot, sampled } from "./profile";
import type { Layout, State, Tool } from "./state";
import type { Pane } from "./pane";
import { converted, mm, plain, quantity } from "./words";

export const element = <T extends HTMLElement = HTMLElement>(id: string): T => document.getElementById(id) as T;
export const write = (id: string, text: string): void => {
  const at = element(id);
  if (at.textContent !== text) at.textContent = text;
};

/** A row of buttons of which one is down; gives what shows which. */
export function choice<T extends string>(id: string, chosen: (value: T) => void): (value: T) => void {
  const buttons = [...element(id).querySelectorAll("button")];
  for (const button of buttons) button.addEventListener("click", () => chosen(button.dataset.value as T));
  return (value) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.value === value));
  };
}

const FLAGS = ["linked", "crossed", "smooth", "inverted"] as const;
const input = (id: string) => element<HTMLInputElement>(id);

export class Panel {
  private readonly showLayout: (layout: Layout) => void;
  private readonly showStack: (name: string) => void;
  private readonly showTool: (tool: Tool) => void;
  private readonly showMode: (mode: SlabMode) => void;

  /** layout, stack: told what was chosen there. */
  constructor(private readonly state: State, private readonly cine: Cine, layout: (layout: Layout) => void, stack: (name: string) => void) {
    this.showLayout = choice("layout", layout);
    this.showStack = choice("stack", stack);
    this.showTool = choice("tool", (tool) => this.set({ tool }));
    this.showMode = choice("mode", (mode) => this.set({ mode }));
    for (const flag of FLAGS) element(flag).addEventListener("click", () => this.set({ [flag]: !state[flag] }));
    input("slice").addEventListener("input", () => state.toSlice(state.side, state.active, Number(input("slice").value)));
    input("thick").addEventListener("input", () => this.set({ slab: Number(input("thick").value) }));
    const limits = () => state.window(state.side, Number(input("low").value), Number(input("high").value));
    for (const id of ["low", "high"]) input(id).addEventListener("change", limits);
    input("preset").addEventListener("change", () => state.preset(state.side, input("preset").value));
    element("clear").addEventListener("click", () => this.set({ profile: null, mark: null }));
    this.offer();
    element("play").addEventListener("click", () => cine.toggle());
    element("slower").addEventListener("click", () => cine.faster(-1));
    element("faster").addEventListener("click", () => cine.faster(1));
    element("sweep").addEventListener("click", () => {
      cine.sweeping = !cine.sweeping;
      state.changed();
    });
  }

  private set(what: Partial<Pick<State, "tool" | "mode" | "slab" | "profile" | "mark" | (typeof FLAGS)[number]>>): void {
    Object.assign(this.state, what);
    this.state.changed();
  }

  /** Only what these images can do. */
  private offer(): void {
    const { state } = this;
    for (const row of document.querySelectorAll<HTMLElement>("[data-for]"))
      row.hidden = row.dataset.for !== (state.scan ? "scan" : "volume");
    element("linked").hidden = element("others").hidden = state.sides.length < 2;
    for (const button of element("layout").querySelectorAll("button"))
      if (button.dataset.value! in PLANES)
        button.textContent = title(state.side.image, PLANES[button.dataset.value as PlaneName]).replace(" plane", "");
  }

  show(panes: Pane[]): void {
    const { state } = this, { side } = state;
    readOut(state, panes);
    this.showLayout(state.layout);
    this.showStack(side.stored.stack.name);
    this.showTool(state.tool);
    this.showMode(state.mode);
    for (const flag of FLAGS) element(flag).setAttribute("aria-pressed", String(state[flag]));
    const plane = PLANES[state.active], k = state.slice(side, state.active), count = side.stored.shape[plane.cut];
    input("slice").max = String(count - 1);
    input("slice").value = String(k);
    write("slice-name", state.scan ? "View" : title(side.image, plane));
    write("slice-at", `${k + 1} / ${count}`);
    input("thick").value = String(state.slab);
    write("thick-at", state.slab ? mm(state.slab) : "thin");
    this.showWindow();
    write("play", this.cine.playing ? "Pause" : "Play");
    write("speed", `${this.cine.speed} views/s`);
    element("sweep").setAttribute("aria-pressed", String(this.cine.sweeping));
    const profile = sampled(state);
    element("profile").hidden = !profile;
    if (!profile) return;
    write("profile-long", mm(profile.distance.at(-1)!));
    plot(element<HTMLCanvasElement>("plot"), profile);
  }

  private showWindow(): void {
    const { side } = this.state, { windows, unit } = side.stored.stack;
    const presets = element<HTMLSelectElement>("preset");
    const names = windows.map((w) => w.name);
    if (presets.dataset.names !== names.join()) {
      presets.dataset.names = names.join();
      presets.replaceChildren(...[...names, ""].map((name) => new Option(name || "by hand", name)));
    }
    presets.value = side.preset;
    presets.title = windows.find((w) => w.name === side.preset)?.hint ?? "set by hand";
    for (const id of ["low", "high"] as const) if (document.activeElement !== input(id)) input(id).value = plain(side[id]);
    write("unit", unit);
  }
}

/** Position, and each side's value there; of a slab too. */
function readOut(state: State, panes: Pane[]): void {
  const { side } = state;
  const index = side.stored.nearest(side.stored.index(side.cross));
  const values = state.sides.map((s) => s.stored.at(s.stored.index(s.cross)));
  const unit = side.stored.stack.unit;
  const here = values[state.chosen];
  write("value", here === here ? quantity(here, unit) : state.scan ? "not measured" : "outside");
  write("converted", converted(side, here));
  const [x, y, z] = side.cross;
  const given = side.stored.given(index);
  if (state.scan) write("place", `row ${given[1]}, column ${given[2]} · ${mm(y)}, ${mm(x)}`);
  else write("place", `x ${mm(x)}, y ${mm(y)}, z ${mm(z)}`);
  write("voxel", state.scan ? "" : `voxel [${given.join(", ")}]`);
  if (state.sides.length > 1) {
    state.sides.forEach((s, i) => {
      write(`title-${i}`, s.image.title);
      write(`value-${i}`, quantity(values[i], s.stored.stack.unit));
    });
    const same = state.sides[0].stored.stack.unit === state.sides[1].stored.stack.unit;
    write("difference", same ? quantity(values[1] - values[0], unit) : "–");
  }
  const pane = panes.find((p) => p.number === state.chosen && p.plane.name === state.active);
  const thick = pane && pane.slices[1] > pane.slices[0];
  write("slab-value", thick ? `slab ${state.mode} ${quantity(pane.shown(index), unit)}` : "");
}
