// One plane of one image on a canvas: values to grey, crosshair, letters, scale bar, the profile's line.
import type { Vector } from "../messages";
import { extract, letters, PLANES, slab, title, type Plane, type PlaneName } from "./planes";
import type { Side, State } from "./state";
import type { Index } from "./stored";
import { mm } from "./words";

const BARS = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500]; // mm
const INK = "#e8eef0", LINE = "#5fd0dc", START = "#ffb26b", NOTHING = [92, 58, 30];

export class Pane {
  readonly element = document.createElement("figure");
  readonly canvas = document.createElement("canvas");
  readonly plane: Plane;
  width = 1; // CSS pixels
  height = 1;
  private readonly pixels = document.createElement("canvas"); // one a voxel
  private values = new Float32Array(0);
  private cut = ""; // what `values` are
  private grey = ""; // what `pixels` are

  constructor(readonly state: State, readonly number: number, name: PlaneName) {
    this.plane = PLANES[name];
    this.element.className = "pane";
    this.element.dataset.plane = name;
    this.element.dataset.side = String(number);
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    const what = title(this.side.image, this.plane);
    const which = state.sides.length > 1 ? ` of ${this.side.image.title}` : "";
    const [left, right, top, bottom] = letters(this.side.image, this.plane);
    const ends = left && `, ${left} left, ${right} right, ${top} above, ${bottom} below`;
    this.canvas.setAttribute("aria-label", `${what}${which}${ends}: arrow keys move the crosshair, Page Up and Page Down the slice`);
    this.element.append(this.canvas);
  }

  get side(): Side {
    return this.state.sides[this.number];
  }

  /** mm that one CSS pixel shows. One scale for all sides, so that sizes compare. */
  get scale(): number {
    const { down, across } = this.plane;
    const need = (axis: number) => Math.max(...this.state.sides.map((s) => s.stored.shape[axis] * s.stored.spacing[axis]));
    return Math.max(need(across) / this.width, need(down) / this.height) / this.side.zoom[this.plane.name];
  }

  /** CSS pixel at which a position is drawn. */
  pixel(point: Vector): [number, number] {
    const { stored, centre } = this.side;
    const { down, across, up, name } = this.plane;
    const here = stored.index(point), middle = stored.index(centre[name]), scale = this.scale;
    const along = ((here[across] - middle[across]) * stored.spacing[across]) / scale;
    const below = ((here[down] - middle[down]) * stored.spacing[down]) / scale;
    return [this.width / 2 + along, this.height / 2 + (up ? -below : below)];
  }

  /** The position under a CSS pixel, in the crosshair's slice. */
  point(x: number, y: number): Vector {
    const { stored, centre, cross } = this.side;
    const { cut, down, across, up, name } = this.plane;
    const index = stored.index(centre[name]), scale = this.scale;
    index[cut] = stored.index(cross)[cut];
    index[across] += ((x - this.width / 2) * scale) / stored.spacing[across];
    index[down] += (((y - this.height / 2) * scale) / stored.spacing[down]) * (up ? -1 : 1);
    return stored.point(index);
  }

  /** First and last slice that are shown. */
  get slices(): [number, number] {
    const k = this.state.slice(this.side, this.plane.name);
    return slab(this.side.stored, this.plane.cut, k, this.state.scan ? 0 : this.state.slab);
  }

  /** The shown value (of the slab) at a voxel. */
  shown(index: Index): number {
    const [z, y] = [index[this.plane.down], index[this.plane.across]];
    return this.values[z * this.side.stored.shape[this.plane.across] + y];
  }

  draw(): void {
    const ratio = devicePixelRatio;
    const [w, h] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!w || !h) return;
    this.width = w;
    this.height = h;
    if (this.canvas.width !== Math.round(w * ratio)) this.canvas.width = Math.round(w * ratio);
    if (this.canvas.height !== Math.round(h * ratio)) this.canvas.height = Math.round(h * ratio);
    this.fill();
    const pen = this.canvas.getContext("2d")!;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = "#000";
    pen.fillRect(0, 0, w, h);
    this.picture(pen);
    if (this.state.crossed) this.crosshair(pen);
    this.line(pen);
    this.words(pen);
  }

  /** Brings values and pixels up to date, each only if it is stale. */
  private fill(): void {
    const { stored, low, high } = this.side;
    const [first, last] = this.slices;
    const rows = stored.shape[this.plane.down], columns = stored.shape[this.plane.across];
    const cut = `${stored.stack.name} ${first} ${last} ${this.state.mode}`;
    if (cut !== this.cut) this.values = extract(stored, this.plane, first, last, this.state.mode);
    const grey = `${cut} ${low} ${high} ${this.state.inverted}`;
    if (grey === this.grey) return;
    this.cut = cut;
    this.grey = grey;
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
        else [out[at], out[at + 1], out[at + 2]] = NOTHING;
        out[at + 3] = 255;
      }
    }
    this.pixels.getContext("2d")!.putImageData(image, 0, 0);
  }

  private picture(pen: CanvasRenderingContext2D): void {
    const { stored } = this.side;
    const { down, across, up } = this.plane;
    const corner: Index = [0, 0, 0];
    corner[across] = -0.5;
    corner[down] = up ? stored.shape[down] - 0.5 : -0.5;
    const [x, y] = this.pixel(stored.point(corner)), scale = this.scale;
    const wide = (stored.shape[across] * stored.spacing[across]) / scale;
    const high = (stored.shape[down] * stored.spacing[down]) / scale;
    pen.imageSmoothingEnabled = this.state.smooth;
    pen.imageSmoothingQuality = wide < this.pixels.width ? "medium" : "low"; // shrunk: over all pixels
    pen.drawImage(this.pixels, x, y, wide, high);
  }

  private crosshair(pen: CanvasRenderingContext2D): void {
    const [x, y] = this.pixel(this.side.cross), gap = 9;
    pen.strokeStyle = LINE;
    pen.globalAlpha = 0.75;
    pen.lineWidth = 1;
    pen.beginPath();
    for (const [a, b, c, d] of [[0, y, x - gap, y], [x + gap, y, this.width, y], [x, 0, x, y - gap], [x, y + gap, x, this.height]]) {
      pen.moveTo(a, b);
      pen.lineTo(c, d);
    }
    pen.stroke();
    pen.globalAlpha = 1;
  }

  private line(pen: CanvasRenderingContext2D): void {
    const { profile, mark } = this.state;
    const ends = mark ? [mark] : profile ? [profile.start, profile.end] : [];
    if (!ends.length) return;
    const spots = ends.map((end) => this.pixel(end));
    pen.strokeStyle = pen.fillStyle = START;
    pen.lineWidth = 2;
    pen.beginPath();
    spots.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
    spots.forEach(([x, y], i) => {
      pen.beginPath();
      pen.arc(x, y, i ? 3 : 5, 0, 7);
      pen.fill();
    });
  }

  private words(pen: CanvasRenderingContext2D): void {
    const { width: w, height: h, side, plane } = this;
    const { image, stored } = side;
    pen.font = "12px system-ui, -apple-system, 'Segoe UI', 'Noto Sans', sans-serif";
    pen.fillStyle = INK;
    pen.shadowColor = "#000";
    pen.shadowBlur = 4;
    const put = (text: string, x: number, y: number, align: CanvasTextAlign) => {
      pen.textAlign = align;
      for (let i = 0; i < 2; i++) pen.fillText(text, x, y); // twice: a shadow dark enough on white
    };
    const [first, last] = this.slices, k = this.state.slice(side, plane.name);
    const where = `${title(image, plane)}  ${"zyx"[plane.cut]} ${mm(side.cross[2 - plane.cut])}`;
    const lines = [image.scan ? `View ${k + 1} of ${stored.shape[0]}  ${stored.stack.name}` : where];
    if (last > first) lines.push(`${this.state.mode} of ${mm((last - first + 1) * stored.spacing[plane.cut])}`);
    if (this.state.sides.length > 1) lines.push(image.title);
    const wide = pen.measureText(lines[0]).width;
    lines.forEach((text, i) => put(text, 10, 20 + 17 * i, "left"));
    if (image.scan) put(image.captions[k], w - 10, 20, "right");
    pen.font = `600 ${pen.font}`;
    const [left, right, top, bottom] = letters(image, plane);
    put(left, 10, h / 2 + 4, "left");
    put(right, w - 10, h / 2 + 4, "right");
    put(top, Math.max(w / 2, 30 + wide), 20, "center"); // not over the caption
    put(bottom, w / 2, h - 12, "center");
    const bar = BARS.filter((b) => b / this.scale < w / 3).at(-1);
    if (bar) {
      const long = bar / this.scale;
      pen.fillRect(w - 12 - long, h - 12, long, 2);
      pen.fillRect(w - 12 - long, h - 16, 1.5, 6);
      pen.fillRect(w - 13.5, h - 16, 1.5, 6);
      pen.font = "11px system-ui, sans-serif";
      put(mm(bar), w - 12 - long / 2, h - 20, "center");
    }
    pen.shadowBlur = 0;
  }
}
