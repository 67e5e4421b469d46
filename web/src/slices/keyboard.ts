// Keyboard input of the viewer, and its help text.
import { NAMES, PLANES } from "./planes";
import type { Layout, ViewState, Tool } from "./view-state";
import type { Index } from "./image-source";

/** Actions of the page. */
export interface Actions {
  layout(layout: Layout): void;
  tool(tool: Tool): void;
  measure(): void;
  measureHere(): void;
  play(): void;
  speed(by: number): void;
  exportPng(): void;
  help(): void;
}

/** Help text: keys, what they do, and whether for volumes, scans or both. */
export const HELP: [string, string, "volume" | "scan" | "both"][] = [
  ["← ↑ → ↓", "crosshair by a voxel (Shift: ten)", "both"],
  ["Page Up, Page Down", "next or previous slice, or view (Shift: ten); Home, End: first, last", "both"],
  ["Tab", "to the next pane or control", "both"],
  ["1 2 3", "one plane alone", "volume"],
  ["4", "the rendering", "volume"],
  ["5", "all planes", "volume"],
  ["Space", "play or pause; F, Shift F: faster, slower", "scan"],
  ["W, Shift W", "next, previous window preset", "both"],
  ["[ ]", "window wider, narrower", "both"],
  ["; '", "window down, up", "both"],
  ["B, Shift B", "slab thicker, thinner", "volume"],
  ["M", "slab of means or maxima", "volume"],
  ["+ −", "zoom in, out", "both"],
  ["R", "reset everything", "both"],
  ["C  D  H  P", "drag moves the crosshair, changes the window, pans, or draws a profile", "both"],
  ["Enter", "a profile from the crosshair; again: to the crosshair", "both"],
  ["A", "measures: a click, or Enter at the crosshair, sets a point; A again: distance, angle, area", "both"],
  ["Shift Enter  Z", "closes an area; takes the last point or measurement back", "both"],
  ["Escape", "removes the profile, and a measurement that lacks points", "both"],
  ["L  X  I  N", "linked, crosshair, inverted, smooth: on or off", "both"],
  ["S", "saves a picture", "both"],
  ["?", "show these keys", "both"],
];

export const MOUSE: [string, string][] = [
  ["Drag", "as selected; with the right button: window; with Shift or the middle button: pan"],
  ["Wheel", "through the slices; with Ctrl: zoom; two fingers: zoom and shift"],
  ["Double click", "one plane alone, or all"],
];

export function listenToKeys(state: ViewState, actions: Actions): void {
  const step = (down: number, across: number, far: boolean) => {
    const plane = PLANES[state.active], by: Index = [0, 0, 0], many = far ? 10 : 1;
    by[plane.down] = down * many * (plane.up ? -1 : 1);
    by[plane.across] = across * many;
    state.step(state.side, by);
  };
  const slice = (by: number) => state.goToSlice(state.side, state.active, state.slice(state.side, state.active) + by);
  const flip = (what: "linked" | "crosshairShown" | "inverted" | "smooth") => {
    state[what] = !state[what];
    state.changed();
  };
  const volume = (act: () => void) => () => void (state.scan || act());
  const keys: Record<string, (far: boolean) => void> = {
    ArrowLeft: (far) => step(0, -1, far),
    ArrowRight: (far) => step(0, 1, far),
    ArrowUp: (far) => step(-1, 0, far),
    ArrowDown: (far) => step(1, 0, far),
    PageUp: (far) => slice(far ? 10 : 1),
    PageDown: (far) => slice(far ? -10 : -1),
    Home: () => slice(-Infinity),
    End: () => slice(Infinity),
    4: volume(() => actions.layout("render")),
    5: volume(() => actions.layout("all")),
    " ": () => actions.play(),
    f: (far) => actions.speed(far ? -1 : 1),
    w: (far) => state.nextPreset(far ? -1 : 1),
    "[": () => state.adjustWindow(state.side, 1.1, 0),
    "]": () => state.adjustWindow(state.side, 1 / 1.1, 0),
    ";": () => state.adjustWindow(state.side, 1, -0.05),
    "'": () => state.adjustWindow(state.side, 1, 0.05),
    b: (far) => void (state.scan || state.changeSlab(far ? -1 : 1)),
    m: volume(() => {
      state.mode = state.mode === "mean" ? "max" : "mean";
      state.changed();
    }),
    "+": () => state.zoomBy(state.side, state.active, 1.25),
    "=": () => state.zoomBy(state.side, state.active, 1.25),
    "-": () => state.zoomBy(state.side, state.active, 0.8),
    r: () => state.reset(),
    c: () => actions.tool("crosshair"),
    d: () => actions.tool("window"),
    h: () => actions.tool("pan"),
    p: () => actions.tool("profile"),
    a: () => actions.measure(),
    z: () => state.measurements.undo(),
    Enter: (far) => {
      if (state.tool !== "measure") state.addProfilePoint([...state.side.crosshair]);
      else if (far) state.measurements.finish();
      else actions.measureHere();
    },
    Escape: () => {
      state.profile = state.mark = null;
      state.measurements.abandon();
      state.changed();
    },
    l: () => flip("linked"),
    x: () => flip("crosshairShown"),
    i: () => flip("inverted"),
    n: () => flip("smooth"),
    s: () => actions.exportPng(),
    "?": () => actions.help(),
  };
  NAMES.forEach((name, i) => (keys[i + 1] = volume(() => actions.layout(name))));
  // Keys that a focused control handles itself.
  const handled: [string, RegExp][] = [
    ["input:not([type=range]), select, textarea", /./],
    ["input[type=range]", /^(Arrow|Page|Home|End)/],
    ["button, a, summary", /^( |Enter)$/],
    ["dialog *", /./],
  ];
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const on = event.target as HTMLElement;
    if (handled.some(([kind, key]) => on.matches?.(kind) && key.test(event.key))) return;
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act(event.shiftKey);
  });
}
