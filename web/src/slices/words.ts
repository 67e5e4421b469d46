// Numbers as people read them.
import type { Side } from "./state";

export const mm = (value: number): string => `${+value.toFixed(Math.abs(value) < 10 ? 2 : 1)} mm`.replace("-", "−");

/** A value with its unit: Hounsfield units whole, the rest to four figures. */
export function quantity(value: number, unit: string): string {
  if (value !== value) return "–";
  const figures = unit === "HU" ? value.toFixed(0) : plain(value);
  return (unit ? `${figures} ${unit}` : figures).replace("-", "−");
}

/** Four figures, without an exponent where it can be read without. */
export function plain(value: number): string {
  const size = Math.abs(value);
  if (size >= 1000) return Number.isInteger(value) ? String(value) : value.toFixed(0);
  return size && size < 1e-4 ? value.toExponential(2) : String(+value.toPrecision(4));
}

/** The same value on the other scale, if the attenuation of water is known: HU of 1/mm, or 1/mm of HU. */
export function converted(side: Side, value: number): string {
  const { water } = side.image;
  if (!water || value !== value) return "";
  if (side.stored.stack.unit === "1/mm") return quantity(1000 * (value / water - 1), "HU");
  return side.stored.stack.unit === "HU" ? quantity(water * (1 + value / 1000), "1/mm") : "";
}
