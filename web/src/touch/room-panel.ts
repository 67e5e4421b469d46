// A room: who is in it, whose hand is where, and what a teacher can do.
import { GuidanceState, LeadStep, Role, type Lead, type Person } from "../protocol/server-messages";
import type { Vector } from "../protocol/server-messages";
import type { PredictionState } from "../protocol/prediction-messages";
import type { RoomState } from "../protocol/room-messages";
import type { OrganView } from "../rendering/organ-view";
import { personColor, personCss } from "../rendering/person-colors";
import { element, write } from "../ui/controls";
import type { Guidance } from "./guidance";

const ROLES: Record<number, string> = { [Role.viewer]: "watches", [Role.trainee]: "", [Role.teacher]: "teacher" };
const FORCE_INTERVAL = 125; // ms

interface Row {
  person: Person;
  item: HTMLLIElement;
  force: HTMLElement;
  buttons: HTMLElement;
  guide: HTMLButtonElement;
}

export class RoomPanel {
  private room: RoomState | null = null;
  private rows: Row[] = [];
  private readonly names = new Map<number, HTMLElement>(); // beside the hands in the picture
  private updated = 0; // ms
  private replay = false; // nobody holds anything

  /** predict: asks for prediction, or for none. onChange: called when the page's own role is known, or another one. letGo: of everything that this hand holds. */
  constructor(private readonly view: OrganView, private readonly send: (lead: Lead) => void, private readonly onChange: () => void, letGo: () => void, predict: (on: boolean) => void) {
    element("predict").addEventListener("click", () => predict(element("predict").getAttribute("aria-pressed") !== "true"));
    element("freeze").addEventListener("click", () => this.toggleFreeze());
    element("begin-again").addEventListener("click", () => send({ step: LeadStep.reset, person: 0 }));
    element("let-go").addEventListener("click", letGo);
  }

  private get role(): number | null {
    const { room } = this;
    return room?.people.find(({ number }) => number === room.you)?.role ?? null;
  }
  /** The page's own number; 0: not in a room. */
  get you(): number {
    return this.room?.you ?? 0;
  }
  /** Whether this hand only watches. */
  get watches(): boolean {
    return this.role === Role.viewer;
  }
  /** Whether this hand may choose for all: the organ, the model, what is undone. */
  get leads(): boolean {
    return this.role === null || this.role === Role.teacher;
  }

  setOrgan(name: string, replay: boolean): void {
    element("room").hidden = !name;
    element("predict").hidden = this.replay = replay;
    if (this.room) this.take(this.room);
    write("room-name", name);
    if (!name) this.room = null;
  }

  take(room: RoomState): void {
    const before = this.role;
    this.room = room;
    const leads = this.role === Role.teacher && !this.replay;
    element("lead-row").hidden = !leads;
    element("freeze").setAttribute("aria-pressed", String(room.frozen));
    write("freeze", room.frozen ? "Go on" : "Stop hands");
    write("room-state", room.frozen ? "All hands are stopped." : `${room.people.length} here`);
    this.rows = [...room.people].sort((a, b) => b.role - a.role || a.number - b.number).map((person) => this.row(person, leads && person.number !== room.you));
    element("people").replaceChildren(...this.rows.map(({ item }) => item));
    if (before !== this.role) this.onChange();
  }

  /** Where prediction is. */
  predicts({ state, problem }: PredictionState): void {
    const button = element("predict");
    button.setAttribute("aria-pressed", String(state !== "off"));
    button.textContent = state === "preparing" ? "Predict…" : "Predict";
    element("prediction-note").hidden = !problem;
    write("prediction-note", problem && `Not predicted: ${problem}.`);
  }

  /** To the room and back it takes so long, ms. */
  setWay(milliseconds: number): void {
    write("way", `${Math.round(milliseconds)} ms away`);
  }

  private row(person: Person, led: boolean): Row {
    const item = document.createElement("li"), chip = document.createElement("i"), name = document.createElement("b"), force = document.createElement("span"), buttons = document.createElement("span"), guide = document.createElement("button");
    chip.style.background = personCss(person.number);
    name.textContent = person.name + (person.number === this.room!.you ? " (you)" : "");
    const role = document.createElement("small");
    role.textContent = ROLES[person.role];
    buttons.className = "led";
    buttons.hidden = true;
    if (led && person.role !== Role.viewer) {
      for (const [text, step] of [["Take over", LeadStep.take_over], ["Let go", LeadStep.release]] as const) {
        const button = document.createElement("button");
        button.textContent = text;
        button.setAttribute("aria-label", `${text}: ${person.name}`);
        button.addEventListener("click", () => this.send({ step, person: person.number }));
        buttons.append(button);
      }
      guide.className = "toggle";
      guide.textContent = "Guide";
      guide.setAttribute("aria-label", `Guide: ${person.name}`);
      guide.title = "Your tool draws this hand to it, from when both hold the organ until one lets go";
      guide.addEventListener("click", () => this.send({ step: guide.getAttribute("aria-pressed") === "true" ? LeadStep.end_guidance : LeadStep.guide, person: person.number }));
      buttons.append(guide);
    }
    item.append(chip, name, role, force, buttons);
    return { person, item, force, buttons, guide };
  }

  toggleFreeze(): void {
    if (this.room && this.role === Role.teacher) this.send({ step: this.room.frozen ? LeadStep.resume : LeadStep.freeze, person: 0 });
  }

  /** Called once a frame: names go beside the hands, and forces into the list. */
  draw(now: number, guidance: Guidance): void {
    if (!this.room) return;
    const places = new Map(this.view.otherHands.places.map((place) => [place.person, place]));
    for (const [person, name] of this.names) if (!places.has(person)) name.hidden = true;
    for (const { person, at } of places.values()) this.label(person, this.view.toPixel(at));
    this.view.showGuidance(this.coupled(guidance), personColor(guidance.told?.teacher ?? 1));
    if (now - this.updated < FORCE_INTERVAL) return;
    this.updated = now;
    this.describe(guidance);
    for (const { person, force, buttons, guide } of this.rows) {
      const place = places.get(person.number), text = place ? `${place.force.toFixed(1)} N` : "";
      if (force.textContent !== text) force.textContent = text;
      const guided = guidance.told?.trainee === person.number;
      guide.setAttribute("aria-pressed", String(guided));
      buttons.hidden = !(place || guided) || !buttons.childElementCount;
    }
  }

  /** The two tools of a guidance as they are drawn, mm. */
  private coupled({ told }: Guidance): [Vector, Vector] | null {
    if (told?.state !== GuidanceState.on) return null;
    const { otherHands, toolMeshes } = this.view, at = (person: number, tool: number): Vector | undefined =>
      person === this.you ? toolMeshes.tipPositions[tool] : otherHands.places.find((place) => place.person === person && place.number === tool)?.at;
    const from = at(told.teacher, told.teacher_tool), to = at(told.trainee, told.trainee_tool);
    return from && to ? [from, to] : null;
  }

  private describe({ told, force }: Guidance): void {
    const name = (number: number) => this.room!.people.find((person) => person.number === number)?.name ?? "", { you } = this;
    element("guidance").hidden = !told;
    if (!told) return;
    const who = told.teacher === you ? `You guide ${name(told.trainee)}` : `${name(told.teacher)} guides ${told.trainee === you ? "you" : name(told.trainee)}`;
    write("guidance-who", told.state === GuidanceState.on ? who : `${who} once both hold the organ.`);
    write("guidance-force", told.state === GuidanceState.on ? `${Math.hypot(...force).toFixed(2)} N` : "");
  }

  private label(person: number, [x, y]: [number, number]): void {
    const name = this.room!.people.find(({ number }) => number === person)?.name;
    if (!name) return;
    let label = this.names.get(person);
    if (!label) {
      label = document.createElement("i");
      label.className = "hand-name";
      label.style.background = personCss(person);
      element("stage").append(label);
      this.names.set(person, label);
    }
    if (label.textContent !== name) label.textContent = name;
    label.hidden = false;
    const box = element("view").getBoundingClientRect();
    label.style.transform = `translate(${Math.round(Math.max(4, Math.min(x - box.left + 12, box.width - 90)))}px, ${Math.round(Math.max(4, y - box.top - 26))}px)`;
  }
}
