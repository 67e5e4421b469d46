// A guiding hand and a guided one, each at its end of the coupling as the page has it, and a room between them that passes on
// what it hears, over a network that delays, jitters and loses. In virtual time, so that every tick is seen. Prints what
// each hand felt, as JSON.
//
//     node guided_hands.mjs OPTIONS.json
import { readFileSync } from "node:fs";

const options = JSON.parse(readFileSync(process.argv[2], "utf8"));
const { GuidanceCoupling } = await import(options.coupling);
const { GUIDANCE_LIMIT } = await import(options.messages);
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
  waiting = [];
  before = 0;
  send(message) {
    const { delay, jitter, loss } = options;
    const held = chance() < loss ? Math.max(200, 3 * delay) : 0;
    this.before = Math.max(this.before, now + delay * (1 + jitter * (2 * chance() - 1)) + held);
    this.waiting.push([this.before, message]);
  }
  *arrived() {
    while (this.waiting.length && this.waiting[0][0] <= now) yield this.waiting.shift()[1];
  }
}

/** A hand: a mass on a spring that draws it where it wants to be, and the force of the coupling. Lengths in mm, N, s. */
class Hand {
  constructor(led) {
    Object.assign(this, { led, up: new Way(), down: new Way() });
  }
  begin({ at, direction, size, tug, phase, stiffness }) {
    Object.assign(this, { at, direction, size, tug, phase, stiffness, x: [...at], v: [0, 0, 0], energy: 0, most: 0, largest: 0, step: 0, felt: [0, 0, 0], holds: true });
    this.coupling = new GuidanceCoupling(this.led, options.compliance, GUIDANCE_LIMIT, options.first ?? undefined);
    this.coupling.move(this.x);
  }
  /** Where it wants to be: out, to and fro, back; or on and on. */
  wish(t) {
    const { length, way } = options, s = t / 1000, ramp = Math.max(0, Math.min(1, s / 0.5, (length / 1000 - s) / 0.5));
    const far = way === "on" ? this.size * s : this.size * ramp * Math.sin(6.28 * this.tug * s + this.phase);
    return this.at.map((a, k) => a + this.direction[k] * far);
  }
  move(t) {
    const MASS = 0.1, wish = this.wish(t), { x, v, stiffness, felt } = this, before = [...x];
    const damping = 1.4 * Math.sqrt(MASS * Math.max(stiffness, 0.02) * 1000) / 1000;
    for (let k = 0; k < 3; k++) {
      v[k] += (stiffness * (wish[k] - x[k]) - damping * v[k] + felt[k]) / MASS;
      x[k] += v[k] * 1e-3;
      if (this.holds) this.energy += felt[k] * (x[k] - before[k]);
    }
    this.most = Math.max(this.most, this.energy);
    if (this.holds) this.coupling.move(x);
  }
  letGo() {
    this.holds = false;
    this.coupling.move(null);
    this.felt = [0, 0, 0];
  }
  feel() {
    this.coupling.tick();
    if (!this.holds) return;
    const { force, offset } = this.coupling, { felt } = this;
    this.step = Math.max(this.step, Math.hypot(...force.map((f, k) => f - felt[k])));
    this.largest = Math.max(this.largest, Math.hypot(...force));
    this.felt = [...force];
    this.offset = [...offset];
  }
  /** As the page tells it: where its tool is, and what it has given. */
  told(holds) {
    const { x, coupling } = this;
    return { at: x.map((p, k) => p + coupling.offset[k]), given: coupling.given, holds };
  }
}

const hands = [new Hand(false), new Hand(true)];
const contacts = [];
for (const contact of options.contacts) {
  const heard = [null, null];
  let state = "waiting";
  hands.forEach((hand, i) => hand.begin(contact.hands[i]));
  let together = 0, last = null;
  for (let t = 0; t < options.length + options.after; t++, now++) {
    hands.forEach((hand, i) => {
      hand.move(t);
      if (t === contact.hands[i].lets_go) {
        hand.letGo();
        hand.up.send(hand.told(false));
      }
      if (t % COMMAND_TICKS === 0 && hand.holds) hand.up.send(hand.told(true));
    });
    hands.forEach((hand, i) => {
      for (const message of hand.up.arrived()) heard[i] = message;
    });
    if (state === "waiting" && heard.every((one) => one?.holds)) state = "on";
    if (state === "on" && (t > options.length || !heard.every((one) => one.holds))) state = "over";
    hands.forEach((hand, i) => {
      if (now % FRAME_TICKS === 0) hand.down.send({ state, other: heard[1 - i] });
      for (const message of hand.down.arrived()) {
        if (message.state === "on") hand.coupling.hear(message.other.at, message.other.given);
        else hand.coupling.end();
      }
      hand.feel();
    });
    together = Math.max(together, hands[0].energy + hands[1].energy);
    if (t === options.length - 1) last = hands.map(({ x, felt, offset }) => ({ x: [...x], felt: [...felt], offset }));
  }
  for (const hand of hands) {
    hand.down.waiting.length = hand.up.waiting.length = 0;
    hand.down.before = hand.up.before = now;
  }
  contacts.push({
    together, hands: hands.map(({ energy, most, largest, step, x, coupling }, i) => ({ energy, most, largest, step, x, given: coupling.given, last: last[i], after: Math.hypot(...coupling.force) })),
  });
}
console.log(JSON.stringify(contacts));
