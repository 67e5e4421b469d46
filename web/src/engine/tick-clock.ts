// Runs ticks by the clock of the page, in batches, and shows frames and does other work between them.
const RATE = 1000; // ticks a second
const BATCH = 8; // ticks at most before the clock is read again
const LATE = 16; // ms behind the clock, from which a tick counts as late: a batch begins some ms after its first tick is due
const SLIP = 1000; // ms behind the clock, beyond which time is given up: the page was stopped
const FRAME_TIME = 12; // ms between two frames at least
const ANSWER_TIME = 3; // ms, if it is the first to obey a command

export class TickClock {
  asked = 0; // serial number of the newest command
  ticks = 0;
  late = 0;
  busy = 0; // s a tick, smoothed
  private began = 0; // ms of the clock, at tick 0
  private answered = 0; // serial number that the last frame obeys
  private shownAt = -Infinity; // ms, the last frame
  private frameTime = 0; // ms that it took

  /** run: runs so many ticks. show: shows a frame, and gives the serial number that it obeys. prepare: does some of the work for later ticks, and says whether there was any. */
  constructor(private readonly run: (ticks: number) => void, private readonly show: () => number, private readonly prepare: () => boolean) {}

  /** Runs a millisecond's tick for every millisecond of the clock, from now on. */
  start(): void {
    this.began = performance.now();
    const channel = new MessageChannel(); // a timer would wait for 4 ms or more
    const run = () => {
      if (!this.advance()) setTimeout(run, 1);
      else channel.port2.postMessage(null); // after the commands that wait
    };
    channel.port1.onmessage = run;
    run();
  }

  /** Runs the ticks that are due, BATCH at most, or does other work. False: there was none. */
  private advance(): boolean {
    let now = performance.now();
    if (now - this.began - this.ticks > SLIP) {
      this.late += Math.floor(now - this.began - this.ticks);
      this.began = now - this.ticks;
    }
    const behind = now - this.began - this.ticks; // ms, and ticks
    const due = Math.min(BATCH, Math.floor(behind * (RATE / 1000)));
    if (due >= 1) {
      if (behind > LATE) this.late += due;
      this.ticks += due;
      this.run(due);
      const done = performance.now();
      this.busy += (1 - 0.99 ** due) * ((done - now) / 1000 / due - this.busy);
      now = done;
    }
    const interval = this.asked === this.answered ? FRAME_TIME : ANSWER_TIME;
    if (now - this.shownAt > Math.max(interval, 2 * this.frameTime)) {
      this.answered = this.show();
      this.frameTime = performance.now() - now;
      this.shownAt = performance.now();
    } else if (due < 1) return this.prepare();
    return true;
  }
}
