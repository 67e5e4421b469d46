// A plot of one value over the last ten seconds.
import { onColorScheme } from "../rendering/color-scheme";

const SECONDS = 10;
const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200];
const CAPACITY = 1024; // values: more than ten seconds of frames

export class TimePlot {
  private readonly times = new Float64Array(CAPACITY);
  private readonly values = new Float32Array(CAPACITY);
  private newest = -1; // number of the newest value; its index is the remainder by the capacity
  private count = 0;
  private width = 0;
  private height = 0;
  private readonly context: CanvasRenderingContext2D;
  private colors = { quiet: "", line: "", accent: "" };

  /** label: the value and its unit. smallestTop: smallest upper end of the scale. */
  constructor(private readonly canvas: HTMLCanvasElement, private readonly label: string, private readonly smallestTop: number) {
    this.context = canvas.getContext("2d")!;
    new ResizeObserver(() => this.resize()).observe(canvas);
    onColorScheme(() => this.resize());
  }

  private resize(): void {
    const scale = devicePixelRatio, style = getComputedStyle(this.canvas);
    const color = (name: string) => style.getPropertyValue(name);
    this.colors = { quiet: color("--quiet"), line: color("--line"), accent: color("--accent") };
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = this.width * scale;
    this.canvas.height = this.height * scale;
    this.context.scale(scale, scale);
    this.draw();
  }

  /** Adds a value at a time in seconds. A time before the last one begins a new session. */
  add(time: number, value: number): void {
    if (this.count && time < this.times[this.newest % CAPACITY]) this.count = 0;
    this.newest++;
    this.times[this.newest % CAPACITY] = time;
    this.values[this.newest % CAPACITY] = value;
    this.count = Math.min(this.count + 1, CAPACITY);
  }

  /** Upper end of the scale. */
  get top(): number {
    let largest = this.smallestTop;
    this.forEachShown((_, value) => (largest = Math.max(largest, value)));
    return STEPS.find((step) => step >= largest) ?? largest;
  }

  /** Visits the shown values, newest first. */
  private forEachShown(visit: (age: number, value: number) => void): void {
    const now = this.times[this.newest % CAPACITY];
    for (let i = 0; i < this.count; i++) {
      const at = (this.newest - i) % CAPACITY, age = now - this.times[at];
      if (age > SECONDS) return;
      visit(age, this.values[at]);
    }
  }

  draw(): void {
    const { context, width, height, top, colors } = this;
    if (!width) return;
    const left = 30, bottom = height - 4, above = 18;
    const y = (v: number) => bottom - (bottom - above) * (v / top);
    context.clearRect(0, 0, width, height);
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = colors.quiet;
    context.strokeStyle = colors.line;
    context.lineWidth = 1;
    context.textAlign = "right";
    for (const v of [0, top]) {
      context.beginPath();
      context.moveTo(left, Math.round(y(v)) + 0.5);
      context.lineTo(width, Math.round(y(v)) + 0.5);
      context.stroke();
      context.fillText(String(+v.toPrecision(2)), left - 5, y(v) + 4);
    }
    context.textAlign = "left";
    context.fillText(this.label, left, 10);
    context.strokeStyle = colors.accent;
    context.lineWidth = 1.75;
    context.lineJoin = "round";
    context.beginPath();
    let first = true;
    this.forEachShown((age, value) => {
      const x = left + (width - left) * (1 - age / SECONDS);
      if (first) context.moveTo(x, y(value));
      else context.lineTo(x, y(value));
      first = false;
    });
    context.stroke();
  }
}
