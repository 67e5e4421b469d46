// The panel of the viewer: value and position at the crosshair, and the controls.
import { element, radioButtons, write } from "../ui/controls";
import type { Cine } from "./cine";
import { PLANES, title, type PlaneName, type SlabMode } from "./planes";
import { plotProfile, sampleProfile } from "./line-profile";
import type { Layout, ViewState, Tool } from "./view-state";
import type { Pane } from "./pane";
import { convertUnit, formatMm, formatNumber, formatQuantity } from "./number-format";

const FLAGS = ["linked", "crosshairShown", "smooth", "inverted"] as const;
const input = (id: string) => element<HTMLInputElement>(id);

export class ControlPanel {
  private readonly showLayout: (layout: Layout) => void;
  private readonly showStack: (name: string) => void;
  private readonly showTool: (tool: Tool) => void;
  private readonly showMode: (mode: SlabMode) => void;

  /** layout, stack: called with the selection of the user. */
  constructor(private readonly state: ViewState, private readonly cine: Cine, layout: (layout: Layout) => void, stack: (name: string) => void) {
    this.showLayout = radioButtons("layout", layout);
    this.showStack = radioButtons("stack", stack);
    this.showTool = radioButtons("tool", (tool) => this.set({ tool }));
    this.showMode = radioButtons("mode", (mode) => this.set({ mode }));
    for (const flag of FLAGS) element(flag).addEventListener("click", () => this.set({ [flag]: !state[flag] }));
    input("slice").addEventListener("input", () => state.goToSlice(state.side, state.active, Number(input("slice").value)));
    input("thick").addEventListener("input", () => this.set({ slab: Number(input("thick").value) }));
    const limits = () => state.window(state.side, Number(input("low").value), Number(input("high").value));
    for (const id of ["low", "high"]) input(id).addEventListener("change", limits);
    input("preset").addEventListener("change", () => state.preset(state.side, input("preset").value));
    element("clear").addEventListener("click", () => this.set({ profile: null, mark: null }));
    this.hideUnsupported();
    element("play").addEventListener("click", () => cine.toggle());
    element("slower").addEventListener("click", () => cine.faster(-1));
    element("faster").addEventListener("click", () => cine.faster(1));
    element("sweep").addEventListener("click", () => {
      cine.sweeping = !cine.sweeping;
      state.changed();
    });
  }

  private set(what: Partial<Pick<ViewState, "tool" | "mode" | "slab" | "profile" | "mark" | (typeof FLAGS)[number]>>): void {
    Object.assign(this.state, what);
    this.state.changed();
  }

  /** Hides the controls that these images do not support. */
  private hideUnsupported(): void {
    const { state } = this;
    for (const row of document.querySelectorAll<HTMLElement>("[data-for]"))
      row.hidden = row.dataset.for !== (state.scan ? "scan" : "volume");
    element("linked").hidden = element("others").hidden = state.sides.length < 2;
    for (const button of element("layout").querySelectorAll("button"))
      if (button.dataset.value! in PLANES)
        button.textContent = title(state.side.image, PLANES[button.dataset.value as PlaneName]).replace(" plane", "");
  }

  update(panes: Pane[]): void {
    const { state } = this, { side } = state;
    writeValues(state, panes);
    this.showLayout(state.layout);
    this.showStack(side.source.stack.name);
    this.showTool(state.tool);
    this.showMode(state.mode);
    for (const flag of FLAGS) element(flag).setAttribute("aria-pressed", String(state[flag]));
    const plane = PLANES[state.active], k = state.slice(side, state.active), count = side.source.shape[plane.cut];
    input("slice").max = String(count - 1);
    input("slice").value = String(k);
    write("slice-name", state.scan ? "View" : title(side.image, plane));
    write("slice-at", `${k + 1} / ${count}`);
    input("thick").value = String(state.slab);
    write("thick-at", state.slab ? formatMm(state.slab) : "thin");
    this.showWindow();
    write("play", this.cine.playing ? "Pause" : "Play");
    write("speed", `${this.cine.speed} views/s`);
    element("sweep").setAttribute("aria-pressed", String(this.cine.sweeping));
    const profile = sampleProfile(state);
    element("profile").hidden = !profile;
    if (!profile) return;
    write("profile-long", formatMm(profile.distance.at(-1)!));
    plotProfile(element<HTMLCanvasElement>("plot"), profile);
  }

  private showWindow(): void {
    const { side } = this.state, { windows, unit } = side.source.stack;
    const presets = element<HTMLSelectElement>("preset");
    const names = windows.map((w) => w.name);
    if (presets.dataset.names !== names.join()) {
      presets.dataset.names = names.join();
      presets.replaceChildren(...[...names, ""].map((name) => new Option(name || "by hand", name)));
    }
    presets.value = side.preset;
    presets.title = windows.find((w) => w.name === side.preset)?.hint ?? "set by hand";
    for (const id of ["low", "high"] as const) if (document.activeElement !== input(id)) input(id).value = formatNumber(side[id]);
    write("unit", unit);
  }
}

/** Writes the position of the crosshair and each side's value there, also that of a slab. */
function writeValues(state: ViewState, panes: Pane[]): void {
  const { side } = state;
  const index = side.source.nearest(side.source.index(side.crosshair));
  const values = state.sides.map((s) => s.source.at(s.source.index(s.crosshair)));
  const unit = side.source.stack.unit;
  const here = values[state.activeSide];
  write("value", here === here ? formatQuantity(here, unit) : state.scan ? "not measured" : "outside");
  write("converted", convertUnit(side, here));
  const [x, y, z] = side.crosshair;
  const fileIndex = side.source.fileIndex(index);
  if (state.scan) write("place", `row ${fileIndex[1]}, column ${fileIndex[2]} · ${formatMm(y)}, ${formatMm(x)}`);
  else write("place", `x ${formatMm(x)}, y ${formatMm(y)}, z ${formatMm(z)}`);
  write("voxel", state.scan ? "" : `voxel [${fileIndex.join(", ")}]`);
  if (state.sides.length > 1) {
    state.sides.forEach((s, i) => {
      write(`title-${i}`, s.image.title);
      write(`value-${i}`, formatQuantity(values[i], s.source.stack.unit));
    });
    const same = state.sides[0].source.stack.unit === state.sides[1].source.stack.unit;
    write("difference", same ? formatQuantity(values[1] - values[0], unit) : "–");
  }
  const pane = panes.find((p) => p.sideIndex === state.activeSide && p.plane.name === state.active);
  const thick = pane && pane.slices[1] > pane.slices[0];
  write("slab-value", thick ? `slab ${state.mode} ${formatQuantity(pane.valueAt(index), unit)}` : "");
}
