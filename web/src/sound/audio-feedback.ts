// What the page lets the user hear and feel: sounds, the rumble of a gamepad, the vibration of a phone.
import type { Frame } from "../protocol/server-messages";
import { EventDetector, largestForce, type SoundEvent } from "./sound-events";
import { Synthesizer } from "./synthesizer";

export type SoundMode = "off" | "events" | "pitch";
export const SOUND_MODES: SoundMode[] = ["off", "events", "pitch"];

const RUMBLE: Record<SoundEvent, { duration: number; strongMagnitude: number; weakMagnitude: number }> = {
  contact: { duration: 40, strongMagnitude: 0, weakMagnitude: 0.6 },
  release: { duration: 25, strongMagnitude: 0, weakMagnitude: 0.3 },
  pierced: { duration: 70, strongMagnitude: 0.5, weakMagnitude: 1 },
  cut: { duration: 20, strongMagnitude: 0, weakMagnitude: 0.4 },
  limit: { duration: 160, strongMagnitude: 1, weakMagnitude: 0.4 },
};

export class AudioFeedback {
  mode: SoundMode = "events";
  /** The newest events, for tests: what, the frame's tick, the page's time, and when the sound begins, both in ms. */
  readonly played: { event: SoundEvent; tick: number; now: number; begins: number }[] = [];
  private readonly detector = new EventDetector();
  private context: AudioContext | null = null;
  private synthesizer: Synthesizer | null = null;

  constructor() {
    // A browser lets a page make sounds only after its user has touched it.
    for (const gesture of ["pointerdown", "keydown"]) addEventListener(gesture, () => this.start(), { capture: true });
  }

  private start(): void {
    if (this.mode === "off" || typeof AudioContext === "undefined") return;
    this.context ??= new AudioContext({ latencyHint: "interactive" });
    this.synthesizer ??= new Synthesizer(this.context);
    if (this.context.state === "suspended") void this.context.resume();
  }

  /** Lets a frame be heard. Called when it arrives, before it is drawn. limit: N. */
  add(frame: Frame, limit: number): void {
    const events = this.detector.add(frame, limit);
    if (this.mode === "off") return;
    for (const event of events) this.feel(event);
    const { context, synthesizer } = this;
    if (!context || !synthesizer || context.state !== "running") return;
    const now = performance.now(), at = context.currentTime;
    for (const event of events) {
      synthesizer.play(event, at);
      this.played.push({ event, tick: frame.tick, now, begins: now + 1000 * (context.baseLatency + context.outputLatency) });
      if (this.played.length > 100) this.played.shift();
    }
    synthesizer.setForce(largestForce(frame), this.mode === "pitch" ? limit : 0, at);
  }

  /** The session has another organ, or has lost its server. */
  clear(): void {
    this.detector.clear();
    if (this.context) this.synthesizer?.setForce(0, 0, this.context.currentTime);
  }

  select(mode: SoundMode): void {
    this.mode = mode;
    if (mode !== "off") this.start();
    else this.clear();
  }

  private feel(event: SoundEvent): void {
    const pad = navigator.getGamepads?.().find((each) => each?.connected && each.mapping === "standard");
    if (pad?.vibrationActuator) void pad.vibrationActuator.playEffect("dual-rumble", RUMBLE[event]).catch(() => undefined);
    else if (navigator.userActivation?.hasBeenActive && matchMedia("(pointer: coarse)").matches) navigator.vibrate?.(RUMBLE[event].duration);
  }
}
