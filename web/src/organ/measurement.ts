// What is measured between points, in the organ's page and in the viewer: kinds, names, and plane geometry.
import { dot, length, subtract } from "./mesh-geometry";
import type { Vector } from "../protocol/server-messages";

export type MeasureKind = "distance" | "angle" | "area" | "note";
export const MEASURE_KINDS: MeasureKind[] = ["distance", "angle", "area"];
export const MEASURE_NAMES: Record<MeasureKind, string> = { distance: "Distance", angle: "Angle", area: "Area", note: "Note" };
/** Points after which a measurement is complete; an area is closed by the user. */
export const COMPLETE: Record<MeasureKind, number> = { distance: 2, angle: 3, area: Infinity, note: 1 };
export const MOST_MEASUREMENTS = 40;
export const MOST_POINTS = 100; // of an area
/** Pixels from the first point of an area within which a click closes it. */
export const CLOSING_DISTANCE = 12;

/** A measured quantity with its unit; null: it cannot be told. */
export interface Quantity {
  name: string;
  value: number | null;
  unit: string;
}

/** Angle at the second of three points between the straight lines to the others, degrees. */
export function angle([a, b, c]: Vector[]): number | null {
  const u = subtract(a, b), v = subtract(c, b), lengths = length(u) * length(v);
  return lengths ? (180 / Math.PI) * Math.acos(Math.max(-1, Math.min(1, dot(u, v) / lengths))) : null;
}

/** Area of a plane polygon; positive if it runs from the first axis to the second. */
export function signedArea(polygon: [number, number][]): number {
  let sum = 0;
  polygon.forEach(([x, y], i) => {
    const [u, v] = polygon[(i + 1) % polygon.length];
    sum += x * v - u * y;
  });
  return sum / 2;
}

/** Do two edges of a plane polygon that are not neighbors meet? Then its area has no meaning. */
export function crossesItself(polygon: [number, number][]): boolean {
  const n = polygon.length;
  const side = (a: number[], b: number[], c: number[]) => Math.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
  for (let i = 0; i < n; i++)
    for (let j = i + 2; j < n; j++) {
      if (i === 0 && j === n - 1) continue;
      const [a, b, c, d] = [polygon[i], polygon[i + 1], polygon[j], polygon[(j + 1) % n]];
      if (side(a, b, c) * side(a, b, d) <= 0 && side(c, d, a) * side(c, d, b) <= 0) return true;
    }
  return false;
}

/** A quantity as text, to three digits or more: mm² from 100 on are told as cm². */
export function quantityText({ value, unit }: Quantity): string {
  if (value === null) return "–";
  const [number, shown] = unit === "mm²" && value >= 100 ? [value / 100, "cm²"] : [value, unit];
  const digits = Math.max(0, Math.min(2, 2 - Math.floor(Math.log10(Math.max(number, 1e-9)))));
  return `${number.toFixed(digits)}${shown === "°" ? "" : " "}${shown}`;
}

export const quantitiesText = (quantities: Quantity[]): string =>
  quantities.map((each) => (each.name ? `${each.name} ${quantityText(each)}` : quantityText(each))).join(", ");

/** A table of measurements: comma separated, with a line of headings. */
export function measurementsCsv(rows: { name: string; state: string; quantities: Quantity[] }[]): string {
  const cells = rows.flatMap(({ name, state, quantities }) =>
    quantities.map((q) => [name, state, q.name, q.value === null ? "" : String(q.value), q.unit]),
  );
  return [["measurement", "state", "quantity", "value", "unit"], ...cells].map((row) => row.map((cell) => `"${cell.replaceAll('"', '""')}"`).join(",")).join("\n") + "\n";
}
