// Values along a line, and their plot.
import type { Vector } from "../messages";
import type { Side, State } from "./state";
import { plain } from "./words";

export interface Profile {
  distance: number[]; // mm from the start
  lines: { title: string; unit: string; values: number[] }[];
}

const STEPS = [1, 2, 2.5, 5, 10];
const INKS = ["--accent", "--warn"];

/** Each side's values along the line, linear between voxels, at half the finest voxel's size. */
export function sampled(state: State): Profile | null {
  if (!state.profile) return null;
  const { start, end } = state.profile;
  const way = end.map((e, i) => e - start[i]) as Vector;
  const long = Math.hypot(...way);
  const finest = Math.min(...state.sides.flatMap((s) => (s.image.scan ? s.stored.spacing.slice(1) : s.stored.spacing)));
  const count = Math.max(2, Math.min(2000, Math.ceil((2 * long) / finest) + 1));
  const share = [...Array(count).keys()].map((i) => i / (count - 1));
  const along = (side: Side) => share.map((t) => side.stored.between(side.stored.index(start.map((s, i) => s + t * way[i]) as Vector)));
  return {
    distance: share.map((t) => t * long),
    lines: state.sides.map((s) => ({ title: s.image.title, unit: s.stored.stack.unit, values: along(s) })),
  };
}

/** The profile as a table: distance, then a column a side. */
export function table(profile: Profile): string {
  const head = ["distance mm", ...profile.lines.map((l) => `${l.title} ${l.unit}`.trim().replaceAll('"', "'"))];
  const rows = profile.distance.map((d, i) => [d, ...profile.lines.map((l) => l.values[i])].map((v) => (v === v ? String(v) : "")));
  return [head.map((h) => `"${h}"`), ...rows].map((row) => row.join(",")).join("\n") + "\n";
}

/** About `count` round numbers from low to high. */
export function ticks(low: number, high: number, count: number): number[] {
  const rough = (high - low) / count || 1;
  const unit = 10 ** Math.floor(Math.log10(rough));
  const step = unit * STEPS.find((s) => s * unit >= rough * 0.999)!;
  const first = Math.ceil(low / step - 1e-9);
  return [...Array(Math.max(0, Math.floor(high / step + 1e-9) - first + 1)).keys()].map((i) => (first + i) * step);
}

export function plot(canvas: HTMLCanvasElement, profile: Profile): void {
  const ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const pen = canvas.getContext("2d")!;
  pen.scale(ratio, ratio);
  const style = getComputedStyle(canvas);
  const all = profile.lines.flatMap((l) => l.values).filter((v) => v === v);
  if (!all.length) return;
  let low = Math.min(...all), high = Math.max(...all);
  if (low === high) [low, high] = [low - 1, high + 1];
  const long = profile.distance.at(-1) || 1;
  pen.font = "11px system-ui, sans-serif";
  const marks = ticks(low, high, 4);
  const left = 8 + Math.max(...marks.map((v) => pen.measureText(plain(v)).width)), bottom = height - 18;
  const x = (d: number) => left + ((width - left - 8) * d) / long;
  const y = (v: number) => bottom - ((bottom - 16) * (v - low)) / (high - low);
  pen.fillStyle = style.getPropertyValue("--quiet");
  pen.strokeStyle = style.getPropertyValue("--line");
  pen.textAlign = "right";
  for (const v of marks) {
    pen.beginPath();
    pen.moveTo(left, Math.round(y(v)) + 0.5);
    pen.lineTo(width - 8, Math.round(y(v)) + 0.5);
    pen.stroke();
    pen.fillText(plain(v), left - 4, y(v) + 4);
  }
  pen.textAlign = "center";
  for (const d of ticks(0, long, 4)) if (x(d) < width - 34) pen.fillText(plain(d), x(d), height - 4);
  pen.textAlign = "right";
  pen.fillText("mm", width - 8, height - 4);
  pen.textAlign = "left";
  pen.fillText([...new Set(profile.lines.map((l) => l.unit))].join(", "), 2, 10);
  pen.lineWidth = 1.75;
  pen.lineJoin = "round";
  profile.lines.forEach((line, n) => {
    pen.strokeStyle = style.getPropertyValue(INKS[n]);
    pen.beginPath();
    let drawing = false;
    line.values.forEach((v, i) => {
      if (v !== v) drawing = false;
      else if (drawing) pen.lineTo(x(profile.distance[i]), y(v));
      else pen.moveTo(x(profile.distance[i]), y(v)), (drawing = true);
    });
    pen.stroke();
  });
}
