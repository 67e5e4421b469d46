// What goes between a page in a frame and the notebook around it.

/** By name, in both directions. */
export type Values = Record<string, unknown>;
/** What the notebook sends first, with the port. */
export const CONNECT = "palpate connect";
