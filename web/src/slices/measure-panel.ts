// The measurements in the panel of the viewer.
import { MEASURE_KINDS, measurementsCsv, type MeasureKind } from "../organ/measurement";
import { element, radioButtons, saveBlob, write } from "../ui/controls";
import { MeasurementList } from "../ui/measurement-list";
import type { Pane } from "./pane";
import { PLANES, title } from "./planes";
import { listedLines, sliceQuantities, type SlicePoint } from "./slice-measurements";
import type { ViewState } from "./view-state";

const HINTS: Partial<Record<MeasureKind, string>> = {
  distance: "Click two points of a slice.",
  angle: "Click three points of a slice: the angle is at the second.",
  area: "Click around an area, and its first point again to close it.",
};

export class MeasurePanel {
  private readonly list: MeasurementList;
  private readonly showKind: (kind: MeasureKind) => void;
  private message = "";
  private shown = -1; // points there were when the message came

  /** fileName: of the table. */
  constructor(private readonly state: ViewState, fileName: () => string) {
    const { measurements } = state;
    this.list = new MeasurementList("measurement-list", (index) => measurements.remove(index));
    this.showKind = radioButtons<MeasureKind>("measure-kind", (kind) => this.select(kind));
    const save = () => {
      const rows = measurements.list.map((each) => ({ name: each.name, state: this.where(each.points[0]), quantities: sliceQuantities(each) }));
      saveBlob(new Blob([measurementsCsv(rows)], { type: "text/csv" }), fileName());
    };
    const actions = { finish: () => measurements.finish(), undo: () => measurements.undo(), clear: () => measurements.clear(), save };
    for (const [name, action] of Object.entries(actions)) element(`measure-${name}`).addEventListener("click", action);
  }

  private select(kind: MeasureKind): void {
    this.state.measurements.abandon();
    this.state.measurements.kind = kind;
    this.state.changed();
  }

  /** Chooses the tool, or what it measures next. */
  next(): void {
    const { state } = this, { kind } = state.measurements;
    if (state.tool === "measure") return this.select(MEASURE_KINDS[(MEASURE_KINDS.indexOf(kind) + 1) % MEASURE_KINDS.length]);
    state.tool = "measure";
    state.changed();
  }

  /** Sets a point at the crosshair of the pane that was used last. */
  addCrosshair(panes: Pane[]): void {
    const { state } = this, pane = panes.find((each) => each.plane.name === state.active && each.sideIndex === state.activeSide);
    if (!pane) return;
    const [x, y] = pane.pixel(state.side.crosshair);
    state.measurements.begin(pane.slicePoint([...state.side.crosshair]), (first) => pane.near(first, { x, y }));
    state.measurements.place();
  }

  /** Says something until the next point. */
  tell(why: string): void {
    this.message = why;
    this.shown = this.points;
    this.state.changed();
  }

  private get points(): number {
    return this.state.measurements.list.reduce((sum, each) => sum + each.points.length, 0);
  }

  private where({ side, plane, slice }: SlicePoint): string {
    const { image, source } = this.state.sides[side];
    const name = image.scan ? `View ${slice + 1}` : `${title(image, PLANES[plane])} ${slice + 1} of ${source.shape[PLANES[plane].cut]}`;
    return this.state.sides.length > 1 ? `${name}, ${image.title}` : image.scan ? `${name}, on the panel` : name;
  }

  update(): void {
    const { state } = this, { list, kind } = state.measurements;
    element("measure").hidden = state.tool !== "measure" && !list.length;
    if (this.shown !== this.points) this.message = "";
    write("measure-message", this.message || (HINTS[kind] ?? ""));
    element("measure-finish").hidden = kind !== "area";
    this.showKind(kind);
    this.list.show(list.map((each) => ({ name: each.name, lines: listedLines(each, this.where(each.points[0])) })));
  }
}
