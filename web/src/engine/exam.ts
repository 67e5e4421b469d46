// What a lesson allows in a page that holds its case: tools, claims and time, as palpate.server.exam does it for a served one.
import { CommandKind, ContactState, RATE } from "../protocol/server-messages";

/** What `palpate lesson export` has put behind the organ. time: s from the first touch, 0: no end. lesson: for the record. */
export interface ExamRules {
  tools: string[];
  claims: number;
  time: number;
  lesson: string;
}

export class Exam {
  over = false;
  private claims = 0;
  private first: number | null = null; // tick of the first touch

  constructor(private readonly rules: ExamRules) {}

  /** May a tool be commanded so? Press, pull and grasp are told apart by the buttons alone: all of them hold. */
  allows(kind: number): boolean {
    const { tools } = this.rules;
    if (kind === CommandKind.away) return true;
    if (this.over) return false;
    return kind === CommandKind.needle ? tools.includes("needle") : tools.some((tool) => tool !== "needle");
  }

  /** Counts a claim. Why it is not taken, or nothing. */
  claim(): string {
    if (this.over) return "The time is over.";
    if (this.claims >= this.rules.claims) return `All ${this.rules.claims} claims have been made.`;
    this.claims++;
    return "";
  }

  /** Has the time just run out? */
  ends(tick: number, contact: readonly number[]): boolean {
    if (contact.includes(ContactState.closed)) this.first ??= tick;
    const { time } = this.rules;
    if (this.over || this.first === null || !(time > 0) || tick - this.first <= RATE * time) return false;
    return (this.over = true);
  }
}
