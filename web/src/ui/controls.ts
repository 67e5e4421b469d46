// Controls of the panels.
export const element = <T extends HTMLElement = HTMLElement>(id: string): T => document.getElementById(id) as T;

/** Writes text if it has changed. */
export function write(id: string, text: string): void {
  const here = element(id);
  if (here.textContent !== text) here.textContent = text;
}

/** A row of buttons of which one is pressed. Returns a function that presses one by its value, without a call of `onClick`. */
export function radioButtons<T extends string>(id: string, onClick: (value: T) => void): (value: T) => void {
  const buttons = [...element(id).querySelectorAll("button")];
  for (const button of buttons) button.addEventListener("click", () => onClick(button.dataset.value as T));
  return (value) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.value === value));
  };
}

/** As `radioButtons`, but the returned function also calls `onSelect`, as a click does. */
export function selector<T extends string>(id: string, onSelect: (value: T) => void): (value: T) => void {
  const select = (value: T) => {
    press(value);
    onSelect(value);
  };
  const press = radioButtons(id, select);
  return select;
}

/** A button that stays pressed until the next click. */
export function toggle(id: string, onChange: (on: boolean) => void): HTMLElement {
  const button = element(id);
  button.addEventListener("click", () => {
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    onChange(on);
  });
  return button;
}

/** A row of the table of keys. */
export function helpRow(key: string, text: string): HTMLTableRowElement {
  const row = document.createElement("tr"), head = document.createElement("th"), cell = document.createElement("td");
  head.scope = "row";
  head.textContent = key;
  cell.textContent = text;
  row.append(head, cell);
  return row;
}

const ANSWER_TIMEOUT = 5000; // ms

/** A list with one selected entry; hidden if it has only one. */
export class SelectList {
  private readonly list: HTMLSelectElement;
  private requested = -1; // index, until the server has obeyed
  private requestedAt = 0;

  constructor(id: string, private readonly onSelect: (index: number) => void) {
    this.list = element<HTMLSelectElement>(id);
    this.list.addEventListener("change", () => this.request());
  }

  /** Requests an entry by its name, as the user would. */
  select(name: string): void {
    this.list.value = name;
    this.request();
  }

  private request(): void {
    this.requested = this.list.selectedIndex;
    this.requestedAt = performance.now();
    this.onSelect(this.requested);
  }

  setEntries(names: string[]): void {
    this.requested = -1;
    this.list.replaceChildren(...names.map((name) => new Option(name)));
    (this.list.closest(".field") as HTMLElement).hidden = names.length < 2;
  }

  /** Shows the entry in force. A request that the server has not answered stays selected for some seconds. */
  show(index: number): void {
    if (index === this.requested || performance.now() - this.requestedAt > ANSWER_TIMEOUT) this.requested = -1;
    if (this.requested < 0 && this.list.selectedIndex !== index) this.list.selectedIndex = index;
  }
}

/** Lets the browser save a text as a file. */
export const saveText = (text: string, name: string, type: string): void => saveBlob(new Blob([text], { type }), name);

export function saveBlob(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
