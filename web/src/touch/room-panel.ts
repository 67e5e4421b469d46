// A room: who is in it, whose hand is where, and what a teacher can do.
import { LeadStep, Role, type Lead, type Person } from "../protocol/server-messages";
import type { PredictionState } from "../protocol/prediction-messages";
import type { RoomState } from "../protocol/room-messages";
import type { OrganView } from "../rendering/organ-view";
import { personCss } from "../rendering/person-colors";
import { element, write } from "../ui/controls";

const ROLES: Record<number, string> = { [Role.viewer]: "watches", [Role.trainee]: "", [Role.teacher]: "teacher" };
const FORCE_INTERVAL = 125; // ms

interface Row {
  person: Person;
  item: HTMLLIElement;
  force: HTMLElement;
  buttons: HTMLElement;
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
    const item = document.createElement("li"), chip = document.createElement("i"), name = document.createElement("b"), force = document.createElement("span"), buttons = document.createElement("span");
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
    }
    item.append(chip, name, role, force, buttons);
    return { person, item, force, buttons };
  }

  toggleFreeze(): void {
    if (this.room && this.role === Role.teacher) this.send({ step: this.room.frozen ? LeadStep.resume : LeadStep.freeze, person: 0 });
  }

  /** Called once a frame: names go beside the hands, and forces into the list. */
  draw(now: number): void {
    if (!this.room) return;
    const places = new Map(this.view.otherHands.places.map((place) => [place.person, place]));
    for (const [person, name] of this.names) if (!places.has(person)) name.hidden = true;
    for (const { person, at } of places.values()) this.label(person, this.view.toPixel(at));
    if (now - this.updated < FORCE_INTERVAL) return;
    this.updated = now;
    for (const { person, force, buttons } of this.rows) {
      const place = places.get(person.number), text = place ? `${place.force.toFixed(1)} N` : "";
      if (force.textContent !== text) force.textContent = text;
      buttons.hidden = !place || !buttons.childElementCount;
    }
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
