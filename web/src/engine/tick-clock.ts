// Runs ticks by the clock of the page, in batches, and other work between them.
const RATE = 1000; // ticks a second
const BATCH = 8; // ticks at most before the clock is read again
const LATE = 16; // ms behind the clock, from which a tick counts as late: a batch begins some ms after its first tick is due
const SLIP = 1000; // ms behind the clock, beyond which time is given up: the page was stopped

export class TickClock {
  ticks = 0;
  late = 0;
  busy = 0; // s a tick, smoothed
  private began = 0; // ms of the clock, at tick 0

  /** run: runs so many ticks. between: what else there is to do at a time (ms); ran: whether ticks were due. False: there was nothing. */
  constructor(private readonly run: (ticks: number) => void, private readonly between: (now: number, ran: boolean) => boolean) {}

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
    return this.between(now, due >= 1);
  }
}
