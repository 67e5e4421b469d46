// Two hands at two sites and their room, in virtual time: the pages' predicting workers as they are installed, the room's
// engine, and a network that delays, jitters and loses. Prints what each hand felt, as JSON.
//
//     node two_sites.mjs OPTIONS.json
import { readFileSync } from "node:fs";
import vm from "node:vm";

const options = JSON.parse(readFileSync(process.argv[2], "utf8"));
const { FRAME_BYTES, decodeFrame, encodeFrame } = await import(options.messages);
const { TouchEngine } = await import(options.touchEngine);
const module = readFileSync(options.engine), solid = readFileSync(options.solid);
const rest = new Float32Array(options.rest);
const FRAME_TICKS = 16, COMMAND_TICKS = 16, PACKET = 1400; // bytes
let now = 0; // ms

/** Numbers from 0 to 1 (mulberry32). */
function random(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}
const chance = random(options.seed);

/** One way of the network: a stream that keeps the order. */
class Way {
  constructor() {
    this.waiting = [];
    this.before = 0;
  }
  send(bytes, message) {
    const { delay, jitter, loss } = options;
    for (let left = bytes; left > 0; left -= PACKET) {
      const held = chance() < loss ? Math.max(200, 1.5 * 2 * delay) : 0;
      this.before = Math.max(this.before, now + delay * (1 + jitter * (2 * chance() - 1)) + held);
    }
    this.waiting.push([this.before, message]);
  }
  *arrived() {
    while (this.waiting.length && this.waiting[0][0] <= now) yield this.waiting.shift()[1];
  }
}

/** A predicting worker in a world of its own, whose clock stands but for advance(). Of each tick it sends a frame: after
 * the ticks of a millisecond the time that it is told is much later, so that a frame is due. */
class Site {
  constructor() {
    this.newest = null;
    let calls = -1, run = null; // -1: not in advance()
    const self = { postMessage: (message) => this.take(message), onmessage: null };
    const sandbox = {
      self, WebAssembly, TextDecoder, console, Math, Uint8Array, Float32Array, Float64Array, Int16Array, DataView, ArrayBuffer, Array, Map, BigInt,
      performance: { now: () => (calls < 0 || calls++ === 0 ? now : 1e6 + 1e4 * now + calls / 2) },
      setTimeout: (what) => { run = what; },
      MessageChannel: class {
        constructor() {
          const port1 = (this.port1 = {});
          this.port2 = { postMessage: () => { run = () => port1.onmessage(); } };
        }
      },
    };
    vm.runInContext(readFileSync(options.worker, "utf8"), vm.createContext(sandbox));
    this.send = (data) => self.onmessage({ data });
    this.advance = () => {
      for (let i = 0; i < 2; i++) { // the tick and its frame, then the tables that the next ones need
        calls = 0;
        const next = run;
        run = null;
        next?.();
      }
      calls = -1;
    };
    this.ready = new Promise((resolve, reject) => Object.assign(this, { resolve, reject }));
  }
  take(message) {
    if (message.kind === "ready") this.resolve();
    else if (message.kind === "problem") this.reject(new Error(message.text));
    else this.newest = message;
  }
}

// ms after the last hand began: when both pages should show one organ; when the hands go back, and let go.
const settled = options.still + 2 * options.delay * (1 + options.jitter) + 200 + options.allowance;
const back = (settled + 900) / 1000, end = 1000 * back + 400;

/** A hand: a mass on a spring that draws it where it wants to be, and the force of the tissue. Lengths in mm, N, s. */
class Hand {
  constructor(point, direction, seed) {
    Object.assign(this, { point, direction, chance: random(seed), serial: 0, contacts: [] });
    this.restart();
  }
  restart() {
    const { chance } = this;
    Object.assign(this, {
      x: [0, 0, 0], v: [0, 0, 0], felt: [0, 0, 0], holding: false, energy: 0, largest: 0, step: 0, before: null,
      tug: 0.5 + chance(), phase: 6.28 * chance(), size: options.size * (0.7 + 0.3 * chance()), wait: Math.floor(400 * chance()),
    });
  }
  /** Where it wants to be: out, to and fro, back. */
  wish(t) {
    const { size, tug, phase, wait } = this, s = (t - wait) / 1000, ramp = Math.max(0, Math.min(1, s / 0.5, (back - s) / 0.5));
    const way = size * ramp * (1 + 0.4 * Math.sin(6.28 * tug * Math.min(s, options.still / 1000 - 0.5) + phase));
    return this.direction.map((d) => d * way);
  }
  move(t) {
    const MASS = 0.1, wish = this.wish(t), { stiffness } = options, damping = 1.4 * Math.sqrt(MASS * stiffness * 1000) / 1000;
    const before = [...this.x];
    for (let k = 0; k < 3; k++) {
      const force = stiffness * (wish[k] - this.x[k]) - damping * this.v[k] + this.felt[k];
      this.v[k] += (force * 1000 / MASS) * 1e-3;
      this.x[k] += this.v[k] * 1e-3;
    }
    if (!this.holding) return;
    for (let k = 0; k < 3; k++) this.energy += this.felt[k] * (this.x[k] - before[k]);
  }
  feel(force) {
    const size = Math.hypot(...force);
    if (this.holding && this.before) this.step = Math.max(this.step, Math.hypot(...force.map((f, k) => f - this.before[k])));
    this.largest = Math.max(this.largest, this.holding ? size : 0);
    this.felt = force;
    this.before = force;
  }
  command(kind) {
    return { tool: 0, kind, serial: ++this.serial, point: this.point, displacement: kind ? [...this.x] : [0, 0, 0] };
  }
}

const room = await TouchEngine.load(module);
room.make(new Uint8Array(solid));
room.followClock(false);
const hands = options.points.map((point, i) => new Hand(point, options.directions[i], options.seed + i));
const up = hands.map(() => new Way()), down = hands.map(() => new Way()), obeyed = hands.map(() => 0);

function frameFor(i) {
  const state = room.frame(), three = (all, slot) => all.slice(3 * slot, 3 * slot + 3), none = [0, 0, 0, 0, 0, 0, 0, 0, 0];
  const own = { model: 0, tick: state.tick, late: 0, faults: 0, serial: obeyed[i], seconds: 0, busy: 0, energy: 0, chosen: 0, mesh_error: 0, linearisation: 0, stiffness_spread: 0, least_volume: 0, solution_age: 0, solution_error: 0, body: 0, step: 1, count: 0 };
  const frame = encodeFrame({
    ...own, contact: [state.contact[i], 0, 0, 0], point: [...three(state.point, i), ...none], displacement: [...three(state.displacement, i), ...none],
    force: [...three(state.force, i), ...none], insertion: [0, 0, 0, 0],
  });
  const others = hands.map((_, j) => ({ person: j, contact: state.contact[j], point: three(state.point, j), displacement: three(state.displacement, j), force: three(state.force, j), insertion: 0, number: 0 }));
  return { frame, hands: others.filter((other) => other.person !== i && other.contact), force: three(state.force, i), shown: Float32Array.from(state.shown) };
}

const sites = options.predict ? hands.map(() => new Site()) : [];
for (const [i, site] of sites.entries()) {
  const copy = (data) => new Uint8Array(data).buffer.slice(0);
  site.send({ kind: "begin", engine: copy(module), solid: copy(solid), rest, frame: frameFor(i).frame });
  await site.ready;
}

function shownAt(i) {
  if (!sites.length) return newest[i];
  const { data } = sites[i].newest, { step, count } = decodeFrame(new DataView(data));
  const out = new Float32Array(rest.length);
  if (count) new Int16Array(data, FRAME_BYTES, 3 * count).forEach((x, k) => (out[k] = step * x));
  return out;
}
const largestDistance = (a, b) => {
  let most = 0;
  for (let i = 0; i < a.length; i += 3) most = Math.max(most, Math.hypot(a[i] - b[i], a[i + 1] - b[i + 1], a[i + 2] - b[i + 2]));
  return most;
};

const newest = hands.map(() => new Float32Array(rest.length)); // what each page shows without prediction
const apart = []; // mm: how far what both see is apart, after the hands have come to stand
for (let contact = 0; contact < options.contacts; contact++) {
  for (const hand of hands) hand.restart();
  for (let t = 0; t < end + 900 + 4 * options.delay; t++, now++) {
    for (const [i, hand] of hands.entries()) {
      hand.move(t);
      if (t % COMMAND_TICKS !== 0) continue;
      const holds = t >= hand.wait && t < hand.wait + end;
      if (!holds && !hand.holding) continue;
      const command = hand.command(holds ? 1 : 0);
      hand.holding = holds;
      up[i].send(32, command);
      sites[i]?.send({ kind: "command", command });
      if (!holds) {
        hand.contacts.push({ energy: hand.energy, largest: hand.largest, step: hand.step });
        hand.feel([0, 0, 0]);
      }
    }
    hands.forEach((_, i) => {
      for (const { kind, point, displacement, serial } of up[i].arrived()) {
        room.command(i, kind, point, displacement, serial);
        obeyed[i] = serial;
      }
    });
    room.step(1);
    hands.forEach((hand, i) => {
      if (now % FRAME_TICKS === 0) down[i].send(300, frameFor(i));
      for (const { frame, hands: others, force, shown } of down[i].arrived()) {
        if (sites.length) sites[i].send({ kind: "hear", frame, hands: others });
        else if (hand.holding) hand.feel(force);
        newest[i] = shown;
      }
      if (!sites.length) return;
      sites[i].advance();
      if (hand.holding && sites[i].newest) hand.feel(decodeFrame(new DataView(sites[i].newest.data)).force.slice(0, 3));
    });
    if (t === Math.round(settled + Math.max(...hands.map(({ wait }) => wait)))) {
      const [a, b] = [shownAt(0), shownAt(1)], truth = frameFor(0).shown;
      apart.push({ sites: largestDistance(a, b), room: Math.max(largestDistance(a, truth), largestDistance(b, truth)), moved: largestDistance(truth, new Float32Array(truth.length)) });
    }
  }
}
console.log(JSON.stringify({ hands: hands.map(({ contacts }) => contacts), apart }));
