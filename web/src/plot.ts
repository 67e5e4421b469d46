// Force over the last ten seconds, drawn by hand: one line needs no library.
const SECONDS = 10;
const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];

export class Plot {
  private readonly times: number[] = [];
  private readonly values: number[] = [];
  private width = 0;
  private height = 0;

  constructor(private readonly canvas: HTMLCanvasElement) {
    new ResizeObserver(() => {
      const scale = devicePixelRatio;
      this.width = canvas.clientWidth;
      this.height = canvas.clientHeight;
      canvas.width = this.width * scale;
      canvas.height = this.height * scale;
      canvas.getContext("2d")!.scale(scale, scale);
      this.draw();
    }).observe(canvas);
  }

  /** One more value, N, at a time in seconds. A clock that runs backwards is a new session. */
  add(time: number, value: number): void {
    if (this.times.length && time < this.times[this.times.length - 1]) this.times.length = this.values.length = 0;
    this.times.push(time);
    this.values.push(value);
    while (this.times[0] < time - SECONDS) this.times.shift(), this.values.shift();
  }

  /** The end of the force scale, N. */
  get top(): number {
    const most = Math.max(0.1, ...this.values);
    return STEPS.find((step) => step >= most) ?? most;
  }

  draw(): void {
    const pen = this.canvas.getContext("2d")!;
    const style = getComputedStyle(this.canvas);
    const colour = (name: string) => style.getPropertyValue(name);
    const { width, height, top } = this;
    const left = 30, bottom = height - 16, now = this.times.at(-1) ?? 0;
    const x = (t: number) => left + (width - left) * (1 - (now - t) / SECONDS);
    const y = (v: number) => bottom - (bottom - 8) * (v / top);
    pen.clearRect(0, 0, width, height);
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = colour("--quiet");
    pen.strokeStyle = colour("--line");
    pen.lineWidth = 1;
    pen.textAlign = "right";
    for (const v of [0, top / 2, top]) {
      pen.beginPath();
      pen.moveTo(left, Math.round(y(v)) + 0.5);
      pen.lineTo(width, Math.round(y(v)) + 0.5);
      pen.stroke();
      pen.fillText(String(+v.toPrecision(2)), left - 5, y(v) + 4);
    }
    pen.textAlign = "left";
    pen.fillText(`N, last ${SECONDS} s`, left, height - 2);
    pen.strokeStyle = colour("--accent");
    pen.lineWidth = 1.75;
    pen.lineJoin = "round";
    pen.beginPath();
    this.times.forEach((t, i) => (i ? pen.lineTo(x(t), y(this.values[i])) : pen.moveTo(x(t), y(this.values[i]))));
    pen.stroke();
  }
}
