// What goes between a page in a frame and the notebook around it.

/** By name, in both directions. */
export type Values = Record<string, unknown>;
/** From the notebook: values with the number of this message. */
export interface Given {
  serial: number;
  values: Values;
}
/** From the page: values, and the number of the newest message that it had taken. */
export interface Report {
  taken: number;
  values: Values;
}
/** What the notebook sends first, with the port. */
export const CONNECT = "palpate connect";
