// A value over the last ten seconds, drawn by hand: one line needs no library.
const SECONDS = 10;
const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200];
const KEPT = 1024; // more than ten seconds of frames

export class Plot {
  private readonly times = new Float64Array(KEPT);
  private readonly values = new Float32Array(KEPT);
  private newest = -1; // ever counting; its place is the remainder
  private count = 0;
  private width = 0;
  private height = 0;
  private readonly pen: CanvasRenderingContext2D;
  private ink = { quiet: "", line: "", accent: "" };

  /** least: the shortest scale. words: what is drawn, in which unit. */
  constructor(private readonly canvas: HTMLCanvasElement, private readonly words: string, private readonly least: number) {
    this.pen = canvas.getContext("2d")!;
    new ResizeObserver(() => this.resize()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.resize());
  }

  private resize(): void {
    const scale = devicePixelRatio, style = getComputedStyle(this.canvas);
    const colour = (name: string) => style.getPropertyValue(name);
    this.ink = { quiet: colour("--quiet"), line: colour("--line"), accent: colour("--accent") };
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = this.width * scale;
    this.canvas.height = this.height * scale;
    this.pen.scale(scale, scale);
    this.draw();
  }

  /** One more value at a time in seconds. A clock that runs backwards is a new session. */
  add(time: number, value: number): void {
    if (this.count && time < this.times[this.newest % KEPT]) this.count = 0;
    this.newest++;
    this.times[this.newest % KEPT] = time;
    this.values[this.newest % KEPT] = value;
    this.count = Math.min(this.count + 1, KEPT);
  }

  /** The end of the scale. */
  get top(): number {
    let most = this.least;
    this.each((_, value) => (most = Math.max(most, value)));
    return STEPS.find((step) => step >= most) ?? most;
  }

  /** All that is shown, newest first. */
  private each(told: (age: number, value: number) => void): void {
    const now = this.times[this.newest % KEPT];
    for (let i = 0; i < this.count; i++) {
      const at = (this.newest - i) % KEPT, age = now - this.times[at];
      if (age > SECONDS) return;
      told(age, this.values[at]);
    }
  }

  draw(): void {
    const { pen, width, height, top, ink } = this;
    if (!width) return;
    const left = 30, bottom = height - 4, above = 18;
    const y = (v: number) => bottom - (bottom - above) * (v / top);
    pen.clearRect(0, 0, width, height);
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = ink.quiet;
    pen.strokeStyle = ink.line;
    pen.lineWidth = 1;
    pen.textAlign = "right";
    for (const v of [0, top]) {
      pen.beginPath();
      pen.moveTo(left, Math.round(y(v)) + 0.5);
      pen.lineTo(width, Math.round(y(v)) + 0.5);
      pen.stroke();
      pen.fillText(String(+v.toPrecision(2)), left - 5, y(v) + 4);
    }
    pen.textAlign = "left";
    pen.fillText(this.words, left, 10);
    pen.strokeStyle = ink.accent;
    pen.lineWidth = 1.75;
    pen.lineJoin = "round";
    pen.beginPath();
    let first = true;
    this.each((age, value) => {
      const x = left + (width - left) * (1 - age / SECONDS);
      if (first) pen.moveTo(x, y(value));
      else pen.lineTo(x, y(value));
      first = false;
    });
    pen.stroke();
  }
}
