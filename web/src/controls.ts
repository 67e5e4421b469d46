// Small pieces of the panel.
export const element = <T extends HTMLElement = HTMLElement>(id: string): T => document.getElementById(id) as T;

/** Writes text where it has changed. */
export function write(id: string, text: string): void {
  const here = element(id);
  if (here.textContent !== text) here.textContent = text;
}

/** A row of buttons of which one is down. Gives what chooses by name. */
export function choice<T extends string>(id: string, chosen: (value: T) => void): (value: T) => void {
  const buttons = [...element(id).querySelectorAll("button")];
  const choose = (value: T) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.value === value));
    chosen(value);
  };
  for (const button of buttons) button.addEventListener("click", () => choose(button.dataset.value as T));
  return choose;
}

/** A button that stays down. */
export function toggle(id: string, told: (on: boolean) => void): HTMLElement {
  const button = element(id);
  button.addEventListener("click", () => {
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    told(on);
  });
  return button;
}

/** A list to choose from by index; hidden where there is no choice. */
export class Options {
  private readonly list: HTMLSelectElement;
  private asked = -1; // waits for the server
  private askedAt = 0;

  constructor(id: string, private readonly chosen: (index: number) => void) {
    this.list = element<HTMLSelectElement>(id);
    this.list.addEventListener("change", () => {
      this.asked = this.list.selectedIndex;
      this.askedAt = performance.now();
      this.chosen(this.asked);
    });
  }

  offer(names: string[]): void {
    this.asked = -1;
    this.list.replaceChildren(...names.map((name) => new Option(name)));
    (this.list.closest(".field") as HTMLElement).hidden = names.length < 2;
  }

  /** What is in force; while an answer is awaited, what was asked for stays for a while. */
  show(index: number): void {
    if (index === this.asked || performance.now() - this.askedAt > 5000) this.asked = -1;
    if (this.asked < 0 && this.list.selectedIndex !== index) this.list.selectedIndex = index;
  }
}
