// Wires the tool Measure to the panel and to the marks over the picture.
import { measurementsCsv, quantitiesText, quantityText, type MeasureKind, MEASURE_KINDS } from "../organ/measurement";
import { progressText } from "../organ/measurement-set";
import { interpolate, type Hit } from "../organ/mesh-geometry";
import { enclosedVolume } from "../organ/surface-area";
import type { PathPoint } from "../organ/surface-path";
import type { Organ } from "../protocol/worker-messages";
import { MarksOverlay } from "../rendering/marks-overlay";
import type { OrganView } from "../rendering/organ-view";
import type { Measured, MeasureTool } from "../tools/measure-tool";
import { element, saveText, selector } from "../ui/controls";
import { MeasurementList } from "../ui/measurement-list";
import type { Notes } from "./notes";
import { offersNotes } from "./offers";

const INTERVAL = 125; // ms between updates of the figures

export class Measuring {
  private readonly overlay = new MarksOverlay(element<HTMLCanvasElement>("marks-overlay"));
  private readonly list: MeasurementList;
  private readonly volumes = new MeasurementList("volumes", null);
  private organ: Organ | null = null;
  private atRest: Measured[] = []; // of each measurement
  private volumesAtRest: (number | null)[] = [];
  private updated = 0; // ms
  private dirty = true;
  private moved = false; // the organ is not at rest
  readonly selectKind: (kind: MeasureKind) => void;

  constructor(private readonly view: OrganView, private readonly tool: MeasureTool, private readonly notes: Notes) {
    this.list = new MeasurementList("measurement-list", (index) => tool.remove(index), (index) => this.note(index));
    this.selectKind = selector<MeasureKind>("measure-kind", (kind) => {
      tool.abandon();
      tool.kind = kind;
      element("measure-finish").hidden = kind !== "area";
    });
    const actions = { finish: () => tool.finish(), undo: () => tool.undo(), clear: () => tool.clear(), save: () => this.save() };
    for (const [name, action] of Object.entries(actions)) element(`measure-${name}`).addEventListener("click", action);
  }

  nextKind(): void {
    const kinds: MeasureKind[] = this.list.keepable ? [...MEASURE_KINDS, "note"] : MEASURE_KINDS;
    this.selectKind(kinds[(kinds.indexOf(this.tool.kind) + 1) % kinds.length]);
  }

  /** Keeps a measurement as a note, which the user may change first. */
  private note(index: number): void {
    const { name, points, complete } = this.tool.list[index], { notes, view, tool } = this;
    if (!complete) return;
    const state = this.moved ? "deformed" : "at rest";
    notes.write(points.at(-1)!, `${name}: ${quantitiesText(tool.evaluate(tool.list[index], view.positions).quantities)} (${state})`);
  }

  setOrgan(organ: Organ): void {
    this.organ = organ;
    this.list.keepable = offersNotes(organ.scene);
    this.notes.setOrgan(organ);
    this.volumesAtRest = this.closedParts().map(({ volume }) => volume(organ.open));
    this.changed();
  }

  /** The measurements are others now. */
  changed(): void {
    if (this.organ) this.atRest = this.tool.list.map((each) => this.tool.evaluate(each, this.organ!.open));
    this.dirty = true;
    this.updated = 0;
  }

  /** The closed surfaces: the organ, or each of several, with what is inside; then each region inside. */
  private closedParts(): { name: string; volume: (positions: Float32Array) => number | null }[] {
    const { scene, triangles, beside } = this.organ!;
    return scene.parts.flatMap(({ name, first, count, inside }) => {
      const volume = (chosen?: (node: number) => boolean) => (positions: Float32Array) => enclosedVolume(positions, triangles, first, count, chosen);
      const holds = !inside && scene.parts.some((part) => part.inside) ? ", with what is inside" : "";
      if (inside || !beside) return [{ name: `${name}${holds}`, volume: volume() }];
      return scene.beside.map((each, organ) => ({ name: each, volume: volume((node) => beside[node] === organ) }));
    });
  }

  /** Do the list and the picture tell of now? */
  get isCurrent(): boolean {
    return !this.dirty && this.updated > 0;
  }

  /** Called after each frame. drawn: the picture changed. moved: the organ is not at rest. */
  draw(drawn: boolean, moved: boolean, now: number): void {
    if (!this.organ || this.organ.open.length !== this.view.positions.length) return;
    if (!drawn && !this.dirty) return;
    const { view, tool, organ } = this;
    const measured = tool.list.map((each) => tool.evaluate(each, view.positions));
    const pixel = (point: PathPoint) => {
      const [x, y] = view.toPixel(point.at);
      return { x, y, visible: tool.facesEye(point) };
    };
    const at = (hit: Hit) => pixel({ at: interpolate(hit, view.positions, organ.triangles), triangle: hit.triangle });
    const notes = this.notes.marks.map(({ hit, label }) => ({ label, line: [], points: [at(hit)], chord: false }));
    this.overlay.draw([
      ...notes,
      ...measured.map(({ quantities, line }, i) => ({
        label: quantities[0] ? `${tool.list[i].name}: ${quantityText(quantities[0])}` : "",
        line: line.map(pixel),
        chord: tool.list[i].kind === "distance",
        points: tool.list[i].points.map(at),
      })),
    ]);
    this.dirty = moved !== this.moved || now - this.updated < INTERVAL;
    this.moved = moved;
    const shown = !element("measure-row").hidden || tool.list.length > 0;
    element("measured").hidden = !shown;
    if (now - this.updated < INTERVAL || !shown) return;
    this.updated = now;
    this.showFigures(measured);
  }

  private showFigures(measured: Measured[]): void {
    const { tool, view } = this;
    const lines = (now: string, rest: string) => (this.moved ? [`Now: ${now}`, `At rest: ${rest}`] : [`At rest: ${rest}`]);
    this.list.show(
      tool.list.map((each, i) => ({
        name: each.name,
        lines: each.complete ? lines(quantitiesText(measured[i].quantities), quantitiesText(this.atRest[i].quantities)) : [progressText(each)],
      })),
    );
    const text = (volume: number | null) => (volume === null ? "not a closed surface" : `${(volume / 1000).toPrecision(4)} cm³`);
    this.volumes.show(
      this.closedParts().map(({ name, volume }, i) => ({ name: `Volume of ${name}`, lines: lines(text(volume(view.positions)), text(this.volumesAtRest[i])) })),
    );
  }

  private save(): void {
    const { tool, view } = this;
    const rows = tool.list.flatMap((each, i) => [
      { name: each.name, state: "at rest", quantities: this.atRest[i].quantities },
      { name: each.name, state: "now", quantities: tool.evaluate(each, view.positions).quantities },
    ]);
    const volumes = this.closedParts().flatMap(({ name, volume }, i) => [
      { name: `Volume of ${name}`, state: "at rest", quantities: [{ name: "", value: this.volumesAtRest[i], unit: "mm³" }] },
      { name: `Volume of ${name}`, state: "now", quantities: [{ name: "", value: volume(view.positions), unit: "mm³" }] },
    ]);
    saveText(measurementsCsv([...rows, ...volumes]), "measurements.csv", "text/csv");
  }
}
