// The list of measurements in a panel: a row for each, with a button that removes it.
import { element } from "./controls";

export interface ListedMeasurement {
  name: string;
  lines: string[]; // what it tells
}

export class MeasurementList {
  keepable = false; // whether a measurement can be kept as a note
  private rows: HTMLLIElement[] = [];

  /** id: of the list. remove, keep: called with the index of a measurement; null: there is no button for that. */
  constructor(
    private readonly id: string, private readonly remove: ((index: number) => void) | null, private readonly keep: ((index: number) => void) | null = null,
  ) {}

  /** Shows the measurements; rows that there are keep their place and the focus. removable: whether their buttons are shown. */
  show(measurements: ListedMeasurement[], removable = true): void {
    const list = element(this.id);
    while (this.rows.length > measurements.length) this.rows.pop()!.remove();
    while (this.rows.length < measurements.length) list.append(this.row());
    measurements.forEach(({ name, lines }, i) => {
      const [title, ...texts] = this.rows[i].querySelectorAll("b, p");
      setText(title, name);
      texts.forEach((text, k) => {
        setText(text, lines[k] ?? "");
        (text as HTMLElement).hidden = !lines[k];
      });
      const [button, keep] = this.rows[i].querySelectorAll("button");
      button?.setAttribute("aria-label", `Remove ${name}`);
      if (button) button.hidden = !removable;
      keep?.setAttribute("aria-label", `Note ${name}`);
      if (keep) keep.hidden = !this.keepable;
    });
    list.hidden = !measurements.length;
  }

  private row(): HTMLLIElement {
    const row = document.createElement("li"), text = document.createElement("div"), { remove } = this;
    text.append(document.createElement("b"), document.createElement("p"), document.createElement("p"));
    row.append(text);
    this.rows.push(row);
    if (!remove) return row;
    const button = document.createElement("button");
    button.textContent = "×";
    button.className = "small";
    button.title = "Remove";
    button.addEventListener("click", () => {
      remove(this.rows.indexOf(row));
      (element(this.id).querySelector("button") as HTMLElement | null)?.focus();
    });
    row.append(button);
    const { keep } = this;
    if (!keep) return row;
    const noting = document.createElement("button");
    noting.textContent = "Note";
    noting.className = "note";
    noting.title = "Keep it as a note";
    noting.addEventListener("click", () => keep(this.rows.indexOf(row)));
    row.append(noting);
    return row;
  }
}

function setText(here: Element, text: string): void {
  if (here.textContent !== text) here.textContent = text;
}
