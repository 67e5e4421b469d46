// Draws marks over the picture of the organ: points, lines and labels, on a canvas of its own.
export interface Mark {
  label: string;
  /** Pixels of the window, and whether the surface faces the eye there. */
  line: { x: number; y: number; visible: boolean }[];
  points: { x: number; y: number; visible: boolean }[];
  /** Whether straight lines between the points are drawn too, dashed. */
  chord: boolean;
}

const WIDTH = 2.5, RADIUS = 4.5, LINE = 17; // pixels

export class MarksOverlay {
  private colors = { mark: "", halo: "" };

  constructor(readonly canvas: HTMLCanvasElement) {
    const read = () => {
      const style = getComputedStyle(canvas);
      this.colors = { mark: style.getPropertyValue("--mark").trim(), halo: style.getPropertyValue("--mark-halo").trim() };
    };
    read();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", read);
  }

  draw(marks: Mark[]): void {
    const { canvas, colors } = this, ratio = devicePixelRatio, box = canvas.getBoundingClientRect();
    const [width, height] = [box.width, box.height].map((size) => Math.round(size * ratio));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d")!;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    context.setTransform(ratio, 0, 0, ratio, -box.left * ratio, -box.top * ratio);
    context.lineJoin = context.lineCap = "round";
    const labels: [number, number, number][] = []; // left, right, baseline
    for (const mark of marks) {
      for (const [color, wider] of [[colors.halo, 2], [colors.mark, 0]] as const) {
        context.strokeStyle = context.fillStyle = color;
        context.lineWidth = WIDTH + wider;
        this.drawLine(context, mark.line);
        context.setLineDash([2, 6]);
        if (mark.chord) this.drawLine(context, mark.points.map((point) => ({ ...point, visible: true })));
        context.setLineDash([]);
        for (const { x, y, visible } of mark.points) {
          context.globalAlpha = visible ? 1 : 0.35;
          context.beginPath();
          context.arc(x, y, RADIUS + wider / 2, 0, 7);
          context.fill();
        }
        context.globalAlpha = 1;
      }
      this.drawLabel(context, mark, box, labels);
    }
  }

  /** What faces away from the eye is faint. */
  private drawLine(context: CanvasRenderingContext2D, line: Mark["line"]): void {
    for (const visible of [false, true]) {
      context.globalAlpha = visible ? 1 : 0.3;
      context.beginPath();
      line.slice(1).forEach((point, i) => {
        if ((point.visible && line[i].visible) !== visible) return;
        context.moveTo(line[i].x, line[i].y);
        context.lineTo(point.x, point.y);
      });
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  private drawLabel(context: CanvasRenderingContext2D, { label, points }: Mark, box: DOMRect, others: [number, number, number][]): void {
    if (!label || !points.length) return;
    const right = points.reduce((a, b) => (b.x > a.x ? b : a));
    context.font = "600 13px system-ui, -apple-system, 'Segoe UI', 'Noto Sans', sans-serif";
    const width = context.measureText(label).width;
    const x = Math.max(box.left + 6, Math.min(right.x + 10, box.right - width - 6));
    let y = Math.max(box.top + 16, Math.min(right.y - 8, box.bottom - 6));
    while (others.some(([left, end, base]) => x < end && left < x + width && Math.abs(base - y) < LINE)) y += LINE;
    others.push([x, x + width, y]);
    context.lineWidth = 4;
    context.strokeStyle = this.colors.halo;
    context.fillStyle = this.colors.mark;
    context.strokeText(label, x, y);
    context.fillText(label, x, y);
  }
}
