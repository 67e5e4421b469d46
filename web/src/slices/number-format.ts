// Numbers as text.
import type { Side } from "./view-state";

export const formatMm = (value: number): string => `${+value.toFixed(Math.abs(value) < 10 ? 2 : 1)} mm`.replace("-", "−");

/** A value with its unit: Hounsfield units without decimals, others to four digits. */
export function formatQuantity(value: number, unit: string): string {
  if (value !== value) return "–";
  const figures = unit === "HU" ? value.toFixed(0) : formatNumber(value);
  return (unit ? `${figures} ${unit}` : figures).replace("-", "−");
}

/** Four digits; with an exponent only below 1e-4. */
export function formatNumber(value: number): string {
  const size = Math.abs(value);
  if (size >= 1000) return Number.isInteger(value) ? String(value) : value.toFixed(0);
  return size && size < 1e-4 ? value.toExponential(2) : String(+value.toPrecision(4));
}

/** The value converted from 1/mm to HU or from HU to 1/mm, if the attenuation of water is known; otherwise empty. */
export function convertUnit(side: Side, value: number): string {
  const { water } = side.image;
  if (!water || value !== value) return "";
  if (side.source.stack.unit === "1/mm") return formatQuantity(1000 * (value / water - 1), "HU");
  return side.source.stack.unit === "HU" ? formatQuantity(water * (1 + value / 1000), "1/mm") : "";
}
