// Draws the measurements of a slice over it.
import { quantityText } from "../organ/measurement";
import type { Measurement } from "../organ/measurement-set";
import type { Vector } from "../protocol/server-messages";
import { sliceQuantities, type SlicePoint } from "./slice-measurements";

const INK = "#ffe08a", HALO = "#000000cc";

/** pixel: at which a position is drawn. width: of the picture, pixels. */
export function drawMeasurements(
  context: CanvasRenderingContext2D, measurements: Measurement<SlicePoint>[], pixel: (point: Vector) => [number, number], width: number,
): void {
  context.font = "600 12px system-ui, -apple-system, 'Segoe UI', 'Noto Sans', sans-serif";
  context.textAlign = "left";
  context.lineJoin = "round";
  for (const measurement of measurements) {
    const spots = measurement.points.map((point) => pixel(point.at));
    for (const [color, wider] of [[HALO, 2.5], [INK, 0]] as const) {
      context.strokeStyle = context.fillStyle = color;
      context.lineWidth = 1.5 + wider;
      context.beginPath();
      spots.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      if (measurement.kind === "area" && measurement.complete) context.closePath();
      context.stroke();
      for (const [x, y] of spots) {
        context.beginPath();
        context.arc(x, y, 2.5 + wider / 2, 0, 7);
        context.fill();
      }
    }
    const [quantity] = sliceQuantities(measurement);
    if (!quantity) continue;
    const label = `${measurement.name}: ${quantityText(quantity)}`, [x, y] = spots.reduce((a, b) => (b[0] > a[0] ? b : a));
    const left = Math.max(4, Math.min(x + 8, width - context.measureText(label).width - 4));
    context.lineWidth = 3;
    context.strokeStyle = HALO;
    context.strokeText(label, left, y - 6);
    context.fillText(label, left, y - 6);
  }
}
