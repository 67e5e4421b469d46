// One plane of one image on a canvas: gray values, crosshair, orientation labels, scale bar, line of the profile.
import type { Vector } from "../protocol/server-messages";
import { extract, orientationLabels, PLANES, slab, title, type Plane, type PlaneName } from "./planes";
import type { Side, ViewState } from "./view-state";
import type { Index } from "./image-source";
import { CLOSING_DISTANCE } from "../organ/measurement";
import { drawMeasurements } from "./measurement-marks";
import { formatMm } from "./number-format";
import type { SlicePoint } from "./slice-measurements";

const BARS = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500]; // mm
const INK = "#e8eef0", LINE = "#5fd0dc", START = "#ffb26b", NOT_MEASURED = [92, 58, 30];

export class Pane {
  readonly element = document.createElement("figure");
  readonly canvas = document.createElement("canvas");
  readonly plane: Plane;
  width = 1; // CSS pixels
  height = 1;
  private readonly pixels = document.createElement("canvas"); // one for each voxel
  private values = new Float32Array(0);
  private cut = ""; // key of the slab in `values`
  private gray = ""; // key of the picture in `pixels`

  constructor(readonly state: ViewState, readonly sideIndex: number, name: PlaneName) {
    this.plane = PLANES[name];
    this.element.className = "pane";
    this.element.dataset.plane = name;
    this.element.dataset.side = String(sideIndex);
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    const what = title(this.side.image, this.plane);
    const which = state.sides.length > 1 ? ` of ${this.side.image.title}` : "";
    const [left, right, top, bottom] = orientationLabels(this.side.image, this.plane);
    const ends = left && `, ${left} left, ${right} right, ${top} above, ${bottom} below`;
    this.canvas.setAttribute("aria-label", `${what}${which}${ends}: arrow keys move the crosshair, Page Up and Page Down the slice`);
    this.element.append(this.canvas);
  }

  get side(): Side {
    return this.state.sides[this.sideIndex];
  }

  /** mm per CSS pixel, the same for all sides, so that sizes can be compared. */
  get scale(): number {
    const { down, across } = this.plane;
    const need = (axis: number) => Math.max(...this.state.sides.map((s) => s.source.shape[axis] * s.source.spacing[axis]));
    return Math.max(need(across) / this.width, need(down) / this.height) / this.side.zoom[this.plane.name];
  }

  /** CSS pixel at which a position is drawn. */
  pixel(point: Vector): [number, number] {
    const { source, center } = this.side;
    const { down, across, up, name } = this.plane;
    const here = source.index(point), middle = source.index(center[name]), scale = this.scale;
    const along = ((here[across] - middle[across]) * source.spacing[across]) / scale;
    const below = ((here[down] - middle[down]) * source.spacing[down]) / scale;
    return [this.width / 2 + along, this.height / 2 + (up ? -below : below)];
  }

  /** The position under a CSS pixel, in the crosshair's slice. */
  point(x: number, y: number): Vector {
    const { source, center, crosshair } = this.side;
    const { cut, down, across, up, name } = this.plane;
    const index = source.index(center[name]), scale = this.scale;
    index[cut] = source.index(crosshair)[cut];
    index[across] += ((x - this.width / 2) * scale) / source.spacing[across];
    index[down] += (((y - this.height / 2) * scale) / source.spacing[down]) * (up ? -1 : 1);
    return source.point(index);
  }

  /** A position in the crosshair's slice as a point to measure from. */
  slicePoint(at: Vector): SlicePoint {
    const { down, across, name } = this.plane, { source } = this.side, index = source.index(at);
    const flat: [number, number] = [index[across] * source.spacing[across], index[down] * source.spacing[down]];
    return { at, flat, side: this.sideIndex, plane: name, slice: this.state.slice(this.side, name) };
  }

  /** Is a measured point so near to a place of the pane that a click there means it? */
  near(point: SlicePoint, place: { x: number; y: number }): boolean {
    const [x, y] = this.pixel(point.at);
    return Math.hypot(x - place.x, y - place.y) < CLOSING_DISTANCE;
  }

  /** First and last slice that are shown. */
  get slices(): [number, number] {
    const k = this.state.slice(this.side, this.plane.name);
    return slab(this.side.source, this.plane.cut, k, this.state.scan ? 0 : this.state.slab);
  }

  /** The displayed value, of the slab, at a voxel. */
  valueAt(index: Index): number {
    const [z, y] = [index[this.plane.down], index[this.plane.across]];
    return this.values[z * this.side.source.shape[this.plane.across] + y];
  }

  draw(): void {
    const ratio = devicePixelRatio;
    const [w, h] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!w || !h) return;
    this.width = w;
    this.height = h;
    if (this.canvas.width !== Math.round(w * ratio)) this.canvas.width = Math.round(w * ratio);
    if (this.canvas.height !== Math.round(h * ratio)) this.canvas.height = Math.round(h * ratio);
    this.updatePixels();
    const context = this.canvas.getContext("2d")!;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = "#000";
    context.fillRect(0, 0, w, h);
    this.drawImage(context);
    if (this.state.crosshairShown) this.drawCrosshair(context);
    this.drawProfile(context);
    this.drawMeasurements(context);
    this.drawLabels(context);
  }

  /** Updates values and pixels, each only if it is out of date. */
  private updatePixels(): void {
    const { source, low, high } = this.side;
    const [first, last] = this.slices;
    const rows = source.shape[this.plane.down], columns = source.shape[this.plane.across];
    const cut = `${source.stack.name} ${first} ${last} ${this.state.mode}`;
    if (cut !== this.cut) this.values = extract(source, this.plane, first, last, this.state.mode);
    const gray = `${cut} ${low} ${high} ${this.state.inverted}`;
    if (gray === this.gray) return;
    this.cut = cut;
    this.gray = gray;
    if (this.pixels.width !== columns) this.pixels.width = columns;
    if (this.pixels.height !== rows) this.pixels.height = rows;
    const image = new ImageData(columns, rows);
    const gain = 255 / (high - low), out = image.data;
    for (let i = 0; i < rows; i++) {
      const from = columns * (this.plane.up ? rows - 1 - i : i);
      for (let j = 0, at = 4 * columns * i; j < columns; j++, at += 4) {
        const value = this.values[from + j];
        let tone = (value - low) * gain; // clamped and rounded by the array itself
        if (this.state.inverted) tone = 255 - Math.max(0, Math.min(255, tone));
        if (value === value) out[at] = out[at + 1] = out[at + 2] = tone;
        else [out[at], out[at + 1], out[at + 2]] = NOT_MEASURED;
        out[at + 3] = 255;
      }
    }
    this.pixels.getContext("2d")!.putImageData(image, 0, 0);
  }

  private drawImage(context: CanvasRenderingContext2D): void {
    const { source } = this.side;
    const { down, across, up } = this.plane;
    const corner: Index = [0, 0, 0];
    corner[across] = -0.5;
    corner[down] = up ? source.shape[down] - 0.5 : -0.5;
    const [x, y] = this.pixel(source.point(corner)), scale = this.scale;
    const wide = (source.shape[across] * source.spacing[across]) / scale;
    const high = (source.shape[down] * source.spacing[down]) / scale;
    context.imageSmoothingEnabled = this.state.smooth;
    context.imageSmoothingQuality = wide < this.pixels.width ? "medium" : "low"; // shrunk: over all pixels
    context.drawImage(this.pixels, x, y, wide, high);
  }

  private drawCrosshair(context: CanvasRenderingContext2D): void {
    const [x, y] = this.pixel(this.side.crosshair), gap = 9;
    context.strokeStyle = LINE;
    context.globalAlpha = 0.75;
    context.lineWidth = 1;
    context.beginPath();
    for (const [a, b, c, d] of [[0, y, x - gap, y], [x + gap, y, this.width, y], [x, 0, x, y - gap], [x, y + gap, x, this.height]]) {
      context.moveTo(a, b);
      context.lineTo(c, d);
    }
    context.stroke();
    context.globalAlpha = 1;
  }

  private drawProfile(context: CanvasRenderingContext2D): void {
    const { profile, mark } = this.state;
    const ends = mark ? [mark] : profile ? [profile.start, profile.end] : [];
    if (!ends.length) return;
    const spots = ends.map((end) => this.pixel(end));
    context.strokeStyle = context.fillStyle = START;
    context.lineWidth = 2;
    context.beginPath();
    spots.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
    spots.forEach(([x, y], i) => {
      context.beginPath();
      context.arc(x, y, i ? 3 : 5, 0, 7);
      context.fill();
    });
  }

  /** Draws those of the slice that is shown. */
  private drawMeasurements(context: CanvasRenderingContext2D): void {
    const { state, side, sideIndex, plane } = this, slice = state.slice(side, plane.name);
    const here = state.measurements.list.filter(({ points: [p] }) => p.side === sideIndex && p.plane === plane.name && p.slice === slice);
    drawMeasurements(context, here, (point) => this.pixel(point), this.width);
  }

  private drawLabels(context: CanvasRenderingContext2D): void {
    const { width: w, height: h, side, plane } = this;
    const { image, source } = side;
    context.font = "12px system-ui, -apple-system, 'Segoe UI', 'Noto Sans', sans-serif";
    context.fillStyle = INK;
    context.shadowColor = "#000";
    context.shadowBlur = 4;
    const put = (text: string, x: number, y: number, align: CanvasTextAlign) => {
      context.textAlign = align;
      for (let i = 0; i < 2; i++) context.fillText(text, x, y); // twice: a shadow dark enough on white
    };
    const [first, last] = this.slices, k = this.state.slice(side, plane.name);
    const where = `${title(image, plane)}  ${"zyx"[plane.cut]} ${formatMm(side.crosshair[2 - plane.cut])}`;
    const lines = [image.scan ? `View ${k + 1} of ${source.shape[0]}  ${source.stack.name}` : where];
    if (last > first) lines.push(`${this.state.mode} of ${formatMm((last - first + 1) * source.spacing[plane.cut])}`);
    if (this.state.sides.length > 1) lines.push(image.title);
    const wide = context.measureText(lines[0]).width;
    lines.forEach((text, i) => put(text, 10, 20 + 17 * i, "left"));
    if (image.scan) put(image.captions[k], w - 10, 20, "right");
    context.font = `600 ${context.font}`;
    const [left, right, top, bottom] = orientationLabels(image, plane);
    put(left, 10, h / 2 + 4, "left");
    put(right, w - 10, h / 2 + 4, "right");
    put(top, Math.max(w / 2, 30 + wide), 20, "center"); // not over the caption
    put(bottom, w / 2, h - 12, "center");
    const bar = BARS.filter((b) => b / this.scale < w / 3).at(-1);
    if (bar) {
      const long = bar / this.scale;
      context.fillRect(w - 12 - long, h - 12, long, 2);
      context.fillRect(w - 12 - long, h - 16, 1.5, 6);
      context.fillRect(w - 13.5, h - 16, 1.5, 6);
      context.font = "11px system-ui, sans-serif";
      put(formatMm(bar), w - 12 - long / 2, h - 20, "center");
    }
    context.shadowBlur = 0;
  }
}
