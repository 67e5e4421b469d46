// Values along a line, as a plot or a table.
import type { Vector } from "../protocol/server-messages";
import type { Side, ViewState } from "./view-state";
import { formatNumber } from "./number-format";

export interface Profile {
  distance: number[]; // mm from the start
  lines: { title: string; unit: string; values: number[] }[];
}

const STEPS = [1, 2, 2.5, 5, 10];
const INKS = ["--accent", "--warn"];

/** Each side's values along the line by trilinear interpolation, two for each of the smallest voxels. */
export function sampleProfile(state: ViewState): Profile | null {
  if (!state.profile) return null;
  const { start, end } = state.profile;
  const displacement = end.map((e, i) => e - start[i]) as Vector;
  const length = Math.hypot(...displacement);
  const finest = Math.min(...state.sides.flatMap((s) => (s.image.scan ? s.source.spacing.slice(1) : s.source.spacing)));
  const count = Math.max(2, Math.min(2000, Math.ceil((2 * length) / finest) + 1));
  const share = [...Array(count).keys()].map((i) => i / (count - 1));
  const along = (side: Side) => share.map((t) => side.source.interpolate(side.source.index(start.map((s, i) => s + t * displacement[i]) as Vector)));
  return {
    distance: share.map((t) => t * length),
    lines: state.sides.map((s) => ({ title: s.image.title, unit: s.source.stack.unit, values: along(s) })),
  };
}

/** The profile as CSV: the distance and a column for each side. */
export function profileCsv(profile: Profile): string {
  const head = ["distance mm", ...profile.lines.map((l) => `${l.title} ${l.unit}`.trim().replaceAll('"', "'"))];
  const rows = profile.distance.map((d, i) => [d, ...profile.lines.map((l) => l.values[i])].map((v) => (v === v ? String(v) : "")));
  return [head.map((h) => `"${h}"`), ...rows].map((row) => row.join(",")).join("\n") + "\n";
}

/** About `count` round numbers between low and high. */
export function ticks(low: number, high: number, count: number): number[] {
  const rough = (high - low) / count || 1;
  const unit = 10 ** Math.floor(Math.log10(rough));
  const step = unit * STEPS.find((s) => s * unit >= rough * 0.999)!;
  const first = Math.ceil(low / step - 1e-9);
  return [...Array(Math.max(0, Math.floor(high / step + 1e-9) - first + 1)).keys()].map((i) => (first + i) * step);
}

export function plotProfile(canvas: HTMLCanvasElement, profile: Profile): void {
  const ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const context = canvas.getContext("2d")!;
  context.scale(ratio, ratio);
  const style = getComputedStyle(canvas);
  const all = profile.lines.flatMap((l) => l.values).filter((v) => v === v);
  if (!all.length) return;
  let low = Math.min(...all), high = Math.max(...all);
  if (low === high) [low, high] = [low - 1, high + 1];
  const length = profile.distance.at(-1) || 1;
  context.font = "11px system-ui, sans-serif";
  const marks = ticks(low, high, 4);
  const left = 8 + Math.max(...marks.map((v) => context.measureText(formatNumber(v)).width)), bottom = height - 18;
  const x = (d: number) => left + ((width - left - 8) * d) / length;
  const y = (v: number) => bottom - ((bottom - 16) * (v - low)) / (high - low);
  context.fillStyle = style.getPropertyValue("--quiet");
  context.strokeStyle = style.getPropertyValue("--line");
  context.textAlign = "right";
  for (const v of marks) {
    context.beginPath();
    context.moveTo(left, Math.round(y(v)) + 0.5);
    context.lineTo(width - 8, Math.round(y(v)) + 0.5);
    context.stroke();
    context.fillText(formatNumber(v), left - 4, y(v) + 4);
  }
  context.textAlign = "center";
  for (const d of ticks(0, length, 4)) if (x(d) < width - 34) context.fillText(formatNumber(d), x(d), height - 4);
  context.textAlign = "right";
  context.fillText("mm", width - 8, height - 4);
  context.textAlign = "left";
  context.fillText([...new Set(profile.lines.map((l) => l.unit))].join(", "), 2, 10);
  context.lineWidth = 1.75;
  context.lineJoin = "round";
  profile.lines.forEach((line, n) => {
    context.strokeStyle = style.getPropertyValue(INKS[n]);
    context.beginPath();
    let drawing = false;
    line.values.forEach((v, i) => {
      if (v !== v) drawing = false;
      else if (drawing) context.lineTo(x(profile.distance[i]), y(v));
      else context.moveTo(x(profile.distance[i]), y(v)), (drawing = true);
    });
    context.stroke();
  });
}
