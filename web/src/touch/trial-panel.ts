// A forced-choice experiment: which interval is under the hand, the answer, breaks, and the mark above a place.
import { dot, subtract } from "../organ/mesh-geometry";
import type { Organ } from "../protocol/worker-messages";
import { ChoiceKind, Feedback, TrialState, type Choice, type TrialStatus, type Vector } from "../protocol/server-messages";
import type { OrganView } from "../rendering/organ-view";
import { element, radioButtons, write } from "../ui/controls";

const TOLD: Record<number, string> = { [Feedback.none]: "", [Feedback.right]: "Right. ", [Feedback.wrong]: "Wrong. " };
const ANSWER_BUTTONS = [1, 2];

export class TrialPanel {
  private status: TrialStatus | null = null;
  private place: { at: Vector; normal: Vector } | null = null;
  private asked = false;
  private readonly press = radioButtons<string>("interval", (value) => this.show(Number(value)));

  /** letGo: of everything that the hand holds. */
  constructor(private readonly view: OrganView, private readonly send: (choice: Choice) => void, private readonly letGo: () => void) {
    for (const interval of ANSWER_BUTTONS) element(`answer-${interval}`).addEventListener("click", () => this.answer(interval));
    element("go-on").addEventListener("click", () => this.goOn());
  }

  /** Whether a question is asked at all. */
  get active(): boolean {
    return this.asked;
  }

  setOrgan({ scene, rest, normals }: Organ): void {
    this.asked = scene.question !== "";
    element("trial").hidden = !this.asked;
    write("question", scene.question);
    const { classList } = document.body;
    classList.toggle("exam", scene.exam);
    classList.toggle("asked", this.asked);
    classList.toggle("force-elsewhere", scene.channel === "sound" || scene.channel === "device");
    this.place = null;
    if (scene.place.length !== 3) return;
    const at = scene.place as Vector;
    let nearest = 0, least = Infinity;
    for (let i = 0; i < rest.length; i += 3) {
      const distance = (rest[i] - at[0]) ** 2 + (rest[i + 1] - at[1]) ** 2 + (rest[i + 2] - at[2]) ** 2;
      if (distance < least && (normals[i] || normals[i + 1] || normals[i + 2])) [nearest, least] = [i, distance];
    }
    this.place = { at, normal: [normals[nearest], normals[nearest + 1], normals[nearest + 2]] };
  }

  /** The server says where the experiment is. */
  update(status: TrialStatus): void {
    const before = this.status, { state, trial, trials, shown, touched, told } = status;
    this.status = status;
    if (before?.shown !== shown || before.trial !== trial) this.letGo();
    const asking = state === TrialState.asking, both = touched === 3;
    this.press(String(shown));
    for (const interval of ANSWER_BUTTONS) {
      element<HTMLButtonElement>(`show-${interval}`).disabled = !asking;
      const answer = element<HTMLButtonElement>(`answer-${interval}`);
      answer.disabled = !asking || !both;
      answer.hidden = state === TrialState.pause || state === TrialState.ended;
      write(`show-${interval}`, `Interval ${interval}${touched & interval ? " ✓" : ""}`);
    }
    write("trial-number", state === TrialState.ended ? "Done" : `Trial ${trial} of ${trials}`);
    write("trial-note", TOLD[told] + this.note(status));
    const paused = state === TrialState.pause;
    element("go-on").hidden = !paused;
    if (paused && before?.state !== state) element("go-on").focus();
    document.body.classList.toggle("asked-all", state === TrialState.ended);
  }

  private note({ state, touched }: TrialStatus): string {
    if (state === TrialState.ended) return "All is answered. Thank you; you can close this page.";
    if (state === TrialState.pause) return "Time for a break. Go on when you like.";
    if (state === TrialState.preparing) return "Preparing the next trial…";
    return touched === 3 ? "Compare as often as you like, then answer." : touched ? `Now touch interval ${3 - touched}.` : "Touch both intervals.";
  }

  /** Brings an interval under the hand. */
  show(interval: number): void {
    this.choose(ChoiceKind.show, interval);
  }

  other(): void {
    if (this.status) this.show(3 - this.status.shown);
  }

  answer(interval: number): void {
    if (ANSWER_BUTTONS.includes(interval)) this.choose(ChoiceKind.answer, interval);
  }

  goOn(): void {
    this.choose(ChoiceKind.go_on, 1);
  }

  /** A gamepad's button: A ends a break, X and B, left and right, answer. */
  button(button: number): void {
    if (button === 0) this.goOn();
    else this.answer(button === 2 ? 1 : 2);
  }

  private choose(kind: number, interval: number): void {
    if (this.asked && this.status) this.send({ kind, interval, trial: this.status.trial });
  }

  /** Draws the mark where its place at rest is, unless the organ hides it. */
  draw(): void {
    const mark = element("place"), { place } = this;
    const seen = place !== null && dot(place.normal, subtract(this.view.turntable.eye, place.at)) > 0;
    mark.hidden = !seen;
    if (!seen) return;
    const [x, y] = this.view.toPixel(place.at), stage = element("stage").getBoundingClientRect();
    mark.style.transform = `translate(${(x - stage.left).toFixed(1)}px, ${(y - stage.top).toFixed(1)}px)`;
  }
}
