// The timeline of a replay: forces and events of one or two recorded sessions, where it is, and the ways to go elsewhere.
import { FASTEST, PlayStep, RATE, SLOWEST, type Position, type TimelineEvent, type TimelineTrack } from "../protocol/server-messages";
import { element, write } from "./controls";

const SPEEDS = [0.25, 0.5, 1, 2, 4].filter((speed) => speed >= SLOWEST && speed <= FASTEST);
const SYMBOLS: Record<string, [symbol: string, name: string]> = {
  touch: ["▲", "touch"], release: ["▽", "release"], cut: ["✕", "cut"], undo: ["↶", "cut taken back"], model: ["◆", "model"],
  claim: ["★", "claim"], guide: ["↔", "guidance"], note: ["●", "note"], limit: ["!", "force limit"],
};
const INKS = ["--accent", "--warn"]; // of the sessions
const SIDE = 8; // pixels beside the plot: the thumb of the slider is there
const ROW = 13; // pixels, of the symbols of a session
const NEAR = 0.6; // s, for which an event is told after it has come
const SMALLEST_TOP = 0.1; // N

export class Timeline {
  private tracks: TimelineTrack[] = [];
  private tick = 0;
  private position: Position = { playing: 0, speed: 1, tick: 0, there: 1, sought: 0 };
  private follows = false; // somebody else plays
  private asked: number | null = null; // tick that was asked for and is not shown yet
  private answer = 0; // `sought` of the server's answer to that
  private readonly slider = element<HTMLInputElement>("seek");
  private readonly canvas = element<HTMLCanvasElement>("timeline-plot");
  private readonly speed = element<HTMLSelectElement>("play-speed");

  /** play: asks the server. onTracks: called when there are others. */
  constructor(private readonly ask: (step: number, value: number) => void, private readonly onTracks: (count: number) => void) {
    this.speed.replaceChildren(...SPEEDS.map((speed) => new Option(`${speed}×`, String(speed))));
    this.speed.addEventListener("change", () => this.play(PlayStep.speed, Number(this.speed.value)));
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    element("play").addEventListener("click", () => this.toggle());
    element("event-before").addEventListener("click", () => this.toEvent(-1));
    element("event-after").addEventListener("click", () => this.toEvent(1));
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.seekPixel(event.clientX);
    });
    this.canvas.addEventListener("pointermove", (event) => event.buttons && this.seekPixel(event.clientX));
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  /** Whether somebody else plays: the page shows where it is, and asks for nothing. */
  set following(on: boolean) {
    this.follows = on;
    for (const id of ["play", "event-before", "event-after", "play-speed"]) element(id).hidden = on;
    this.slider.disabled = on;
    this.tell();
  }

  private play(step: number, value: number): void {
    if (!this.follows) this.ask(step, value);
  }

  private get length(): number {
    return Math.max(1, ...this.tracks.map((track) => track.length));
  }
  private get events(): TimelineEvent[] {
    return this.tracks.flatMap((track) => track.events).sort((a, b) => a.tick - b.tick);
  }

  show(tracks: TimelineTrack[]): void {
    const before = this.tracks.length;
    this.tracks = tracks;
    element("timeline").hidden = !tracks.length;
    this.slider.max = String(this.length);
    const kinds = new Set(this.events.map((event) => event.kind));
    write("timeline-key", Object.entries(SYMBOLS).filter(([kind]) => kinds.has(kind)).map(([, pair]) => pair.join(" ")).join("  "));
    if (tracks.length !== before) this.onTracks(tracks.length);
    this.draw();
  }

  setPosition(position: Position): void {
    if (position.sought < this.position.sought) this.answer = 0; // another server, that was asked nothing
    this.position = position;
    if (position.there >= 1 && position.sought >= this.answer) this.asked = null;
    const button = element("play");
    button.textContent = position.playing ? "Pause" : "Play";
    this.speed.value = String(position.speed);
    this.tell();
  }

  /** A frame of this tick is shown. */
  update(tick: number): void {
    if (!this.tracks.length) return;
    this.tick = tick;
    if (this.asked === null) this.slider.value = String(tick);
    this.tell();
    this.draw();
  }

  toggle(): void {
    this.play(this.position.playing ? PlayStep.pause : PlayStep.play, 0);
  }
  /** Goes so many seconds on. */
  skip(seconds: number): void {
    this.seek((this.asked ?? this.tick) + RATE * seconds);
  }
  /** Goes to the next event, or the one before. */
  toEvent(by: 1 | -1): void {
    const now = this.asked ?? this.tick;
    const event = by > 0 ? this.events.find((each) => each.tick > now) : this.events.filter((each) => each.tick < now).at(-1);
    if (event) this.seek(event.tick);
  }
  changeSpeed(by: 1 | -1): void {
    const next = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, SPEEDS.indexOf(this.position.speed) + by))];
    this.play(PlayStep.speed, next);
  }

  private seek(tick: number): void {
    if (!this.tracks.length || this.follows) return;
    this.asked = Math.round(Math.max(0, Math.min(this.length, tick)));
    this.slider.value = String(this.asked);
    this.answer = Math.max(this.answer, this.position.sought) + 1;
    this.play(PlayStep.seek, this.asked);
    this.tell();
    this.draw();
  }

  private seekPixel(x: number): void {
    const box = this.canvas.getBoundingClientRect();
    this.seek((this.length * (x - box.left - SIDE)) / (box.width - 2 * SIDE));
  }

  private tell(): void {
    const now = this.asked ?? this.tick, { there } = this.position;
    const text = `${clock(now)} of ${clock(this.length)}`;
    write("play-time", this.follows ? `${text}, as the teacher plays it` : text);
    this.slider.setAttribute("aria-valuetext", text);
    const event = this.events.filter((each) => each.tick <= now && now - each.tick < NEAR * RATE).at(-1);
    write("event-now", there < 1 ? `Computing what was before, ${Math.round(100 * there)} %` : (event?.text ?? ""));
  }

  private draw(): void {
    const { canvas, tracks } = this, width = canvas.clientWidth, height = canvas.clientHeight, ratio = devicePixelRatio;
    if (!width || !tracks.length) return;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const context = canvas.getContext("2d")!, style = getComputedStyle(canvas), color = (name: string) => style.getPropertyValue(name);
    context.scale(ratio, ratio);
    const x = (tick: number) => SIDE + ((width - 2 * SIDE) * tick) / this.length, bottom = height - ROW * tracks.length - 2;
    const top = Math.max(SMALLEST_TOP, ...tracks.flatMap((track) => track.forces)), y = (force: number) => bottom - ((bottom - 12) * force) / top;
    context.font = "11px system-ui, sans-serif";
    context.strokeStyle = color("--line");
    context.strokeRect(SIDE, bottom + 0.5, width - 2 * SIDE, 0);
    context.fillStyle = color("--quiet");
    context.textAlign = "left";
    context.fillText(`Force, up to ${top.toPrecision(2)} N`, SIDE, 10);
    tracks.forEach((track, i) => {
      context.strokeStyle = context.fillStyle = color(INKS[i]);
      context.lineWidth = 1.5;
      context.beginPath();
      track.forces.forEach((force, k) => context.lineTo(x((k + 0.5) * track.bin), y(force)));
      context.stroke();
      context.textAlign = "center";
      for (const event of track.events) context.fillText(SYMBOLS[event.kind]?.[0] ?? "·", x(event.tick), bottom + ROW * (i + 1) - 1);
      if (tracks.length < 2) return;
      context.textAlign = "right";
      context.fillText(track.title, width - SIDE, 10 + 12 * i);
    });
    context.strokeStyle = color("--ink");
    context.lineWidth = 1;
    const now = Math.round(x(this.asked ?? this.tick)) + 0.5;
    context.strokeRect(now, 0, 0, height);
  }
}

/** Minutes, seconds, tenths. */
function clock(tick: number): string {
  const tenths = Math.floor(tick / (RATE / 10)), seconds = Math.floor(tenths / 10);
  return `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}.${tenths % 10}`;
}
