// The sounds themselves: a short burst for each event, and a tone whose pitch is the force. It plays into any context of
// Web Audio, so that tests can render it offline.
import type { SoundEvent } from "./sound-events";

const LOWEST = 220; // Hz, without force
const OCTAVES = 2; // at the limit of the force
const MOST = 1.25; // of the limit: the pitch rises no further
const LEAST = 0.01; // N: no tone below
const TONE = 0.09; // amplitude
const FOLLOW = 0.006; // s, time constant with which the tone follows the force

interface Burst {
  filter: BiquadFilterType;
  frequency: number; // Hz, of the filter
  decay: number; // s
  gain: number;
}
// Soft taps for what happens at the surface, a crack for what breaks it, a rasp for what is cut, and a warning that is none of
// them.
const BURSTS: Record<SoundEvent, Burst> = {
  contact: { filter: "lowpass", frequency: 420, decay: 0.045, gain: 0.9 },
  release: { filter: "lowpass", frequency: 260, decay: 0.03, gain: 0.5 },
  pierced: { filter: "highpass", frequency: 1800, decay: 0.06, gain: 0.6 },
  cut: { filter: "bandpass", frequency: 3200, decay: 0.02, gain: 0.6 },
  limit: { filter: "bandpass", frequency: 1200, decay: 0.18, gain: 1.4 },
};

/** Hz, for a force in N: it rises evenly in octaves. */
export function pitch(force: number, limit: number): number {
  return LOWEST * 2 ** (OCTAVES * Math.min(Math.max(force, 0) / limit, MOST));
}

export class Synthesizer {
  private readonly noise: AudioBuffer;
  private readonly tone: OscillatorNode;
  private readonly toneGain: GainNode;

  constructor(private readonly context: BaseAudioContext) {
    this.noise = context.createBuffer(1, Math.ceil(0.5 * context.sampleRate), context.sampleRate);
    const samples = this.noise.getChannelData(0);
    for (let i = 0, state = 1; i < samples.length; i++) {
      state = (Math.imul(state, 1664525) + 1013904223) >>> 0; // Numerical Recipes' generator: the same noise each time
      samples[i] = state / 2 ** 31 - 1;
    }
    this.tone = new OscillatorNode(context, { type: "triangle", frequency: LOWEST });
    this.toneGain = new GainNode(context, { gain: 0 });
    this.tone.connect(this.toneGain).connect(context.destination);
    this.tone.start();
  }

  /** Plays an event. at: s, in the context's time. */
  play(event: SoundEvent, at: number): void {
    const { filter, frequency, decay, gain } = BURSTS[event];
    const source = new AudioBufferSourceNode(this.context, { buffer: this.noise });
    const colour = new BiquadFilterNode(this.context, { type: filter, frequency, Q: filter === "bandpass" ? 6 : 0.7 });
    const level = new GainNode(this.context, { gain });
    level.gain.setValueAtTime(gain, at);
    level.gain.exponentialRampToValueAtTime(1e-4, at + 4 * decay);
    source.connect(colour).connect(level).connect(this.context.destination);
    source.start(at);
    source.stop(at + 4 * decay);
  }

  /** The tone follows the force, N; a limit of 0 silences it. at: s. */
  setForce(force: number, limit: number, at: number): void {
    const on = limit > 0 && force > LEAST;
    if (on) this.tone.frequency.setTargetAtTime(pitch(force, limit), at, FOLLOW);
    this.toneGain.gain.setTargetAtTime(on ? TONE : 0, at, FOLLOW);
  }
}

/** Samples of a mono recording of events and forces at given times, s, as the page would play them. */
export async function renderOffline(
  seconds: number, events: [SoundEvent, number][], forces: [number, number][], limit: number, sampleRate = 44100,
): Promise<Float32Array> {
  const context = new OfflineAudioContext(1, Math.ceil(seconds * sampleRate), sampleRate);
  const synthesizer = new Synthesizer(context);
  for (const [event, at] of events) synthesizer.play(event, at);
  for (const [force, at] of forces) synthesizer.setForce(force, limit, at);
  return (await context.startRendering()).getChannelData(0);
}
