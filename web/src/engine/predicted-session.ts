// A session in the page that runs ahead of its room's: the page's own tools move at once, those of others as the room tells.
// No force comes over the network. A hand meets the organ that its page computes; what others do reaches it as their
// motion, without steps, and its account limits the energy that this may bring it.
import type { OtherHand } from "../protocol/room-messages";
import { CommandKind, ContactState, TOOLS, type Frame, type ToolCommand, type Vector } from "../protocol/server-messages";
import { EnergyAccount } from "./energy-account";
import { FollowedTool } from "./followed-tool";
import { frameMessage } from "./frame-message";
import { TickClock } from "./tick-clock";
import type { EngineFrame, TouchEngine } from "./touch-engine";

const FADE = 50, RETURN = 200; // ticks in which the force goes while the room is silent, and comes back
const UNHEARD = 3000; // ticks after which a hold that no frame has obeyed is given up: all tools are in other hands

/** A tool of this hand. */
interface OwnTool {
  slot: number | null; // the engine's tool
  command: ToolCommand | null; // that it obeys, while the hand holds
  since: number; // serial number of the first command of this contact
  began: number; // tick
  confirmed: boolean; // the room has obeyed it
  ended: number; // serial number of the command that let go
  given: FollowedTool | null; // it goes where the room has it: hands are stopped, or it was somebody else's
  felt: Vector; // N, shown last
  readonly account: EnergyAccount;
}

export class PredictedSession {
  private readonly own: OwnTool[] = Array.from({ length: TOOLS }, () => ({
    slot: null, command: null, since: 0, began: 0, confirmed: false, ended: 0, given: null, felt: [0, 0, 0], account: new EnergyAccount(),
  }));
  private readonly others = new Map<string, { slot: number; tool: FollowedTool; there: boolean }>();
  private readonly free = [...Array(TOOLS).keys()];
  private readonly left: number[] = []; // slots that are free after the next tick
  private forces: Vector[] = Array.from({ length: TOOLS }, () => [0, 0, 0]); // N, of each slot
  private hands: OtherHand[] = [];
  private frozen = false;
  private silent = false;
  private heardShare = 1; // of the force, while the room is silent
  private serial = 0;
  private readonly clock = new TickClock((ticks) => this.run(ticks), () => this.show(), () => this.engine.prepare());

  /** rest: shown nodes, (nodes, 3) mm. truth: the room's newest frame. post: takes a frame as a message, and the hands of others. */
  constructor(
    private readonly engine: TouchEngine, private readonly rest: Float32Array, private truth: Frame,
    private readonly post: (message: ArrayBuffer, hands: OtherHand[]) => void,
  ) {}

  start(): void {
    this.clock.start();
  }

  /** The page's own hand. */
  command(command: ToolCommand): void {
    const own = this.own[command.tool];
    this.serial = this.clock.asked = command.serial;
    if (command.kind === CommandKind.away) {
      own.command = null;
      own.ended = command.serial;
      if (!this.frozen) this.letGo(own);
      return;
    }
    if (!own.command) {
      if (own.since > own.ended) return; // the room has let it go: it begins anew after the hand has
      own.since = command.serial;
      own.began = this.clock.ticks;
      own.confirmed = false;
      own.account.begin();
      own.felt = [0, 0, 0];
      if (!this.frozen) own.given = null;
    }
    own.command = command;
    own.account.move(position(command), own.felt);
  }

  /** Stopped hands stay where the room has them. */
  stop(frozen: boolean): void {
    if (frozen === this.frozen) return;
    this.frozen = frozen;
    if (!frozen) {
      for (const own of this.own) {
        own.given = null;
        own.began = this.clock.ticks;
        if (!own.command) this.letGo(own);
      }
    }
  }

  /** Whether the room has not been heard for longer than it should. */
  hush(silent: boolean): void {
    this.silent = silent;
  }

  /** What the room says of a tick: the frame of this hand, and the hands of others. */
  hear(truth: Frame, hands: OtherHand[]): void {
    this.truth = truth;
    this.hands = hands;
    this.own.forEach((own, number) => this.compare(own, number));
    for (const other of this.others.values()) other.there = false;
    for (const hand of hands) if (hand.contact === ContactState.closed) this.follow(hand);
    for (const { tool, there } of this.others.values()) if (!there) tool.leave();
  }

  /** A tool of this hand, against the room's. */
  private compare(own: OwnTool, number: number): void {
    const { truth } = this, contact = truth.contact[number];
    if (own.command && !this.frozen) {
      if (truth.serial >= own.since) own.confirmed = true;
      const taken = own.confirmed && contact === ContactState.idle;
      if (!taken && (own.confirmed || this.clock.ticks - own.began < UNHEARD)) return;
      own.command = null; // the teacher has taken it or let it go, or there was none
      this.letGo(own);
    } else if (contact === ContactState.closed && truth.serial >= own.ended) {
      const at = vector(truth.point, number), displacement = vector(truth.displacement, number);
      if (own.given) return own.given.follow(at, displacement);
      if (own.slot === null) own.account.begin();
      const here = own.slot === null ? null : this.engine.frame(); // it goes on from where it is
      own.given = here ? new FollowedTool(vector(here.point, own.slot!), vector(here.displacement, own.slot!)) : new FollowedTool([...at], [...displacement]);
      own.given.follow(at, displacement);
    } else if (own.given) {
      own.given = null;
      this.letGo(own);
    }
  }

  private follow(hand: OtherHand): void {
    const key = `${hand.person} ${hand.number}`;
    let other = this.others.get(key);
    if (!other) {
      const slot = this.free.shift();
      if (slot === undefined) return; // one is letting go still
      other = { slot, tool: new FollowedTool([...hand.point], this.tissueAt(hand.point)), there: true };
      this.others.set(key, other);
    }
    other.there = true;
    other.tool.follow(hand.point, hand.displacement);
  }

  /** Displacement of the tissue at the shown node that is nearest to a place at rest, mm. */
  private tissueAt([x, y, z]: Vector): Vector {
    const { rest } = this, { shown } = this.engine.frame();
    let nearest = 0, least = Infinity;
    for (let i = 0; i < rest.length; i += 3) {
      const far = (rest[i] - x) ** 2 + (rest[i + 1] - y) ** 2 + (rest[i + 2] - z) ** 2;
      if (far < least) (least = far), (nearest = i);
    }
    return [shown[nearest], shown[nearest + 1], shown[nearest + 2]];
  }

  private letGo(own: OwnTool): void {
    own.given = null;
    if (own.slot === null) return;
    this.engine.command(own.slot, CommandKind.away, [0, 0, 0], [0, 0, 0], this.serial);
    this.left.push(own.slot);
    own.slot = null;
  }

  private run(due: number): void {
    for (let i = 0; i < due; i++) {
      for (const own of this.own) this.moveOwn(own);
      for (const [key, { slot, tool }] of this.others) {
        if (tool.advance(this.forces[slot])) this.engine.command(slot, CommandKind.hold, tool.point, tool.displacement, this.serial);
        else {
          this.engine.command(slot, CommandKind.away, [0, 0, 0], [0, 0, 0], this.serial);
          this.left.push(slot);
          this.others.delete(key);
        }
      }
      const forces = this.engine.step(1);
      for (let t = 0; t < TOOLS; t++) for (let k = 0; k < 3; k++) this.forces[t][k] = forces[3 * t + k];
      this.free.push(...this.left.splice(0));
      for (const own of this.own) own.account.advance();
      this.heardShare = Math.max(0, Math.min(1, this.heardShare + (this.silent ? -1 / FADE : 1 / RETURN)));
    }
  }

  private moveOwn(own: OwnTool): void {
    const { command, given } = own;
    if (!given && (!command || this.frozen)) return;
    if (own.slot === null && (own.slot = this.free.shift() ?? null) === null) return;
    if (given) {
      given.advance(this.forces[own.slot]);
      this.engine.command(own.slot, CommandKind.hold, given.point, given.displacement, this.serial);
    } else this.engine.command(own.slot, command!.kind, command!.point, command!.displacement, this.serial);
  }

  /** N, what this hand feels. */
  private shownForce({ slot, account }: OwnTool): Vector {
    const share = account.share * this.heardShare;
    return slot === null ? [0, 0, 0] : (this.forces[slot].map((x) => share * x) as Vector);
  }

  private show(): number {
    const state = this.engine.frame();
    this.post(frameMessage(this.frame(state), state.shown), this.handsHere());
    return this.serial;
  }

  /** The room's newest frame with the tools as they are here. */
  private frame(state: EngineFrame): Frame {
    const frame: Frame = { ...this.truth, serial: this.serial, contact: [], point: [], displacement: [], force: [], insertion: [] };
    this.own.forEach((own, number) => {
      const { slot } = own, of = (all: number[]) => (slot === null ? [0, 0, 0] : vector(all, slot));
      const refused = this.truth.contact[number] === ContactState.refused ? ContactState.refused : ContactState.idle;
      frame.contact.push(slot === null ? refused : state.contact[slot]);
      frame.point.push(...of(state.point));
      frame.displacement.push(...of(state.displacement));
      frame.force.push(...(own.felt = this.shownForce(own)));
      frame.insertion.push(slot === null ? 0 : state.insertion[slot]);
    });
    return frame;
  }

  /** The hands of others, where their tools are here. */
  private handsHere(): OtherHand[] {
    return this.hands.map((hand) => {
      const other = this.others.get(`${hand.person} ${hand.number}`);
      return other ? { ...hand, point: [...other.tool.point] as Vector, displacement: [...other.tool.displacement] as Vector } : hand;
    });
  }
}

const position = ({ point, displacement }: ToolCommand): Vector => [0, 1, 2].map((k) => point[k] + displacement[k]) as Vector;
const vector = (all: number[], number: number): Vector => all.slice(3 * number, 3 * number + 3) as Vector;
