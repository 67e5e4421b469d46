// Pictures and videos of what the page shows: the organ or both, marks, a scale, the legend of the colors, the time.
import { UNITS, VIRIDIS } from "../organ/color-map";
import type { ColorMode, Scale } from "../protocol/worker-messages";
import type { OrganView } from "../rendering/organ-view";
import { element, saveBlob } from "../ui/controls";

const BARS = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500]; // mm
const STRIP = 30; // pixels below, for the caption
const RATE = 30; // pictures of a video a second
const LONGEST = 5 * 60_000; // ms of a video
const TYPE = "video/webm";

/** What is written beside the picture. */
export interface Caption {
  title: string;
  seconds: number;
  force: number; // N
  mode: ColorMode;
  scale: Scale;
}

export class Pictures {
  private readonly canvas = document.createElement("canvas");
  private recorder: MediaRecorder | null = null;
  private began = 0; // ms, of the video
  readonly keys: Record<string, () => void>;

  /** views: of the organs that are shown. caption: of now. tell: tells the user. */
  constructor(private readonly views: () => OrganView[], private readonly caption: () => Caption, private readonly tell: (text: string) => void) {
    const picture = () => void this.save().catch((problem: unknown) => tell(String(problem)));
    this.keys = { t: picture, v: () => this.toggleVideo() };
    element("picture").addEventListener("click", picture);
    element("video").addEventListener("click", () => this.toggleVideo());
    if (!Pictures.videoSupported) {
      element("video").hidden = true;
      element("video-missing").hidden = false;
    }
  }

  /** Can this browser record a canvas as WebM? */
  static get videoSupported(): boolean {
    return typeof MediaRecorder !== "undefined" && "captureStream" in HTMLCanvasElement.prototype && MediaRecorder.isTypeSupported(TYPE);
  }

  /** A video is being recorded: every picture of the page belongs to it. */
  get recording(): boolean {
    return this.recorder !== null;
  }

  private async save(): Promise<void> {
    this.compose();
    const blob = await new Promise<Blob | null>((resolve) => this.canvas.toBlob(resolve, "image/png"));
    if (!blob) throw new Error("The browser could not make a picture.");
    saveBlob(blob, `${fileName(this.caption().title)}.png`);
  }

  toggleVideo(): void {
    if (this.recorder) return this.recorder.stop();
    if (!Pictures.videoSupported) return this.tell("This browser cannot record a video.");
    this.compose();
    const chunks: Blob[] = [], recorder = new MediaRecorder(this.canvas.captureStream(RATE), { mimeType: TYPE });
    recorder.addEventListener("dataavailable", (event) => event.data.size && chunks.push(event.data));
    recorder.addEventListener("stop", () => {
      this.recorder = null;
      this.showState();
      saveBlob(new Blob(chunks, { type: TYPE }), `${fileName(this.caption().title)}.webm`);
    });
    recorder.start(1000);
    this.recorder = recorder;
    this.began = performance.now();
    this.showState();
  }

  private showState(): void {
    const button = element("video");
    button.textContent = this.recorder ? "Stop video" : "Record video";
    button.setAttribute("aria-pressed", String(this.recorder !== null));
  }

  /** Called once a display frame, after the page has been drawn. */
  update(now: number): void {
    if (!this.recorder) return;
    if (now - this.began > LONGEST) return this.recorder.stop();
    this.compose();
  }

  /** Draws everything that the picture holds. The organs are drawn again at once: a browser keeps no picture of WebGL. */
  private compose(): void {
    const views = this.views(), overlay = element<HTMLCanvasElement>("marks-overlay"), stage = element("stage");
    const boxes = views.map((view) => view.renderer.domElement.getBoundingClientRect()), ratio = Math.min(devicePixelRatio, 2);
    const left = Math.min(...boxes.map((box) => box.left)), top = Math.min(...boxes.map((box) => box.top));
    const width = Math.max(...boxes.map((box) => box.right)) - left, height = Math.max(...boxes.map((box) => box.bottom)) - top;
    const size = [width, height + STRIP].map((pixels) => 2 * Math.round((pixels * ratio) / 2)); // even, as videos want
    if (!this.recorder && (this.canvas.width !== size[0] || this.canvas.height !== size[1])) [this.canvas.width, this.canvas.height] = size;
    const context = this.canvas.getContext("2d")!, style = getComputedStyle(stage), color = (name: string) => style.getPropertyValue(name).trim();
    context.setTransform(this.canvas.width / width, 0, 0, this.canvas.height / (height + STRIP), 0, 0);
    context.fillStyle = color("--ground");
    context.fillRect(0, 0, width, height + STRIP);
    views.forEach((view, i) => {
      view.requestRedraw();
      view.draw();
      context.drawImage(view.renderer.domElement, boxes[i].left - left, boxes[i].top - top, boxes[i].width, boxes[i].height);
    });
    const marks = overlay.getBoundingClientRect();
    if (overlay.width) context.drawImage(overlay, marks.left - left, marks.top - top, marks.width, marks.height);
    context.fillStyle = color("--sheet");
    context.fillRect(0, height, width, STRIP);
    context.fillStyle = color("--ink");
    this.drawCaption(context, width, height);
    this.drawScale(context, views[0], boxes[0], height - 16, color("--ink"));
  }

  private drawCaption(context: CanvasRenderingContext2D, width: number, y: number): void {
    const { title, seconds, force, mode, scale } = this.caption();
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "left";
    context.fillText(`${title}  ·  ${seconds.toFixed(1)} s  ·  ${force.toFixed(2)} N  ·  palpate, research software`, 12, y + 20, width - 240);
    if (!scale) return;
    const bar = 90, x = width - bar - 60, gradient = context.createLinearGradient(x, 0, x + bar, 0);
    VIRIDIS.forEach((rgb, i) => gradient.addColorStop(i / (VIRIDIS.length - 1), `rgb(${rgb.join()})`));
    context.textAlign = "right";
    context.fillText(`${mode} ${+scale.ends[0].toPrecision(2)}`, x - 6, y + 20);
    context.textAlign = "left";
    context.fillText(`${+scale.ends[1].toPrecision(2)} ${UNITS[mode]}`, x + bar + 6, y + 20, 52);
    context.fillStyle = gradient;
    context.fillRect(x, y + 11, bar, 9);
  }

  /** A bar to scale at the depth of the point about which the view turns. */
  private drawScale(context: CanvasRenderingContext2D, view: OrganView, box: DOMRect, y: number, ink: string): void {
    const scale = view.turntable.millimetresPerPixel(box.height), bar = BARS.filter((mm) => mm / scale < box.width / 4).at(-1);
    if (!bar) return;
    const long = bar / scale, x = 14;
    context.fillStyle = ink;
    context.fillRect(x, y, long, 2);
    context.fillRect(x, y - 4, 1.5, 10);
    context.fillRect(x + long - 1.5, y - 4, 1.5, 10);
    context.textAlign = "left";
    context.fillText(`${bar} mm`, x + long + 8, y + 5);
  }
}

const fileName = (title: string): string => title.replace(/[^\w.-]+/g, "_") || "organ";
