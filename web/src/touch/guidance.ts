// Of a teacher who guides a hand: what this page has to do with it, and what it shows. If it is this page's own hand that
// guides or is guided, it has one end of the coupling.
import { GUIDANCE_LIMIT, GuidanceState, TOOLS, type Guidance as Told, type Guided, type ToolCommand, type Vector } from "../protocol/server-messages";
import type { CommandQueue, HandPlace } from "../tools/command-queue";
import { GuidanceCoupling, YIELD } from "../tools/guidance-coupling";

const TELL_INTERVAL = 15, MOST_TICKS = 100; // ms

export class Guidance {
  /** What the room said last; null if nobody guides. */
  told: Told | null = null;
  private coupling: GuidanceCoupling | null = null;
  private tool = 0; // that is coupled
  private led = false; // this hand is guided
  private number = 0; // of the guidance that the coupling is of
  private over = 0; // number of the one that has ended
  private until = 0; // ms, the coupling's clock
  private toldAt = 0; // ms
  private readonly hand: (HandPlace | null)[] = Array(TOOLS).fill(null); // where this hand has each tool

  constructor(private readonly commands: () => CommandQueue, private readonly send: (guided: Guided) => void) {}

  /** The hand has moved a tool, or let it go. */
  moved({ tool }: ToolCommand, hand: HandPlace | null): void {
    this.hand[tool] = hand;
    if (tool === this.tool) this.follow();
  }
  private follow(): void {
    const hand = this.hand[this.tool];
    this.coupling?.move(hand && hand.at, hand && hand.normal);
  }

  /** The room says who guides whom. you: this page's person. */
  take(told: Told, you: number): void {
    if (told.number === this.over && told.state !== GuidanceState.none) return; // it was on its way when it ended
    if (told.state === GuidanceState.none) this.over = told.number;
    this.told = told.state === GuidanceState.none ? null : told;
    const led = told.trainee === you;
    if (told.state !== GuidanceState.on || !(led || told.teacher === you)) return this.coupling?.end();
    if (told.number !== this.number || !this.coupling) {
      this.number = told.number;
      this.led = led;
      this.tool = led ? told.trainee_tool : told.teacher_tool;
      this.coupling = new GuidanceCoupling(led, led ? YIELD : 0, GUIDANCE_LIMIT);
      this.follow();
      this.until = performance.now();
    }
    if (led) this.coupling.hear(told.teacher_at, told.teacher_given);
    else this.coupling.hear(told.trainee_at, told.trainee_given);
  }

  /** The room is not heard: the force goes, until it is. */
  lose(): void {
    this.coupling?.end();
  }

  /** The connection is bad, and all tools let go. */
  drop(): void {
    this.told = null;
    this.over = this.number;
    this.lose();
  }

  /** There is another connection, perhaps to another room process, which counts anew. */
  reset(): void {
    this.drop();
    this.coupling = null;
    this.commands().shift([0, 0, 0]);
    this.number = this.over = 0;
  }

  /** N, of the coupling on the guided hand; as this page has it, or as the room says. */
  get force(): Vector {
    const { coupling, told } = this;
    if (coupling) return this.led ? coupling.force : (coupling.force.map((f) => -f) as Vector);
    return told ? told.trainee_force : [0, 0, 0];
  }

  /** Called once a display frame. */
  update(now: number): void {
    const { coupling } = this;
    if (!coupling) return;
    const due = Math.floor(now - this.until);
    this.until += Math.max(0, due);
    for (let i = 0; i < Math.min(due, MOST_TICKS); i++) coupling.tick();
    if (this.led) this.commands().shift(coupling.offset);
    if (coupling.still && this.told?.state !== GuidanceState.on) this.coupling = null;
    if (this.told?.state !== GuidanceState.on || now - this.toldAt < TELL_INTERVAL) return;
    this.toldAt = now;
    this.send({ number: this.number, given: coupling.given, force: [...coupling.force] });
  }
}
