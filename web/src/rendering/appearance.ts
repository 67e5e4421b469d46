// Tissue or plain: what the user chose, remembered, and how much of it this machine draws fast enough.
const KEY = "palpate-look", SLOWEST = 1000 / 30; // ms a picture
const FIRST = 12, PICTURES = 40; // not counted at first, since shaders are compiled; then counted before a step

export type Look = "tissue" | "plain";

/** A browser that refuses storage still shows the page. */
const remembered = (): Look => {
  try {
    return localStorage.getItem(KEY) === "plain" ? "plain" : "tissue";
  } catch {
    return "tissue";
  }
};

export class Appearance {
  /** 3: everything; 2: without grain and ambient occlusion; 1: without the film of liquid; 0: plain. */
  affordable = 3;
  /** Colors mean something, so light must not change them much. */
  colored = false;
  private chosen = remembered();
  private last: { now: number; drawn: boolean } | null = null;
  private spent: number[] = [];
  private told = false;

  constructor(private readonly tell: (text: string) => void = () => {}) {}

  get look(): Look {
    return this.chosen;
  }
  /** A choice of tissue tries everything again. */
  set look(look: Look) {
    this.chosen = look;
    if (look === "tissue") this.affordable = 3;
    this.spent = [];
    try {
      localStorage.setItem(KEY, look);
    } catch {
      // It is not remembered.
    }
  }

  /** What is drawn now: 0 to 3. */
  get level(): number {
    return this.chosen === "plain" || this.colored ? 0 : this.affordable;
  }

  /** Called once a display frame. now: ms; drawn: whether a picture is drawn in it. The time to the next display frame is that
   * picture's; where nothing was drawn, it says nothing. */
  count(now: number, drawn: boolean): void {
    if (this.last?.drawn && this.level > 0 && now - this.last.now < 1000) this.spent.push(now - this.last.now); // else the page was hidden
    this.last = { now, drawn };
    if (this.spent.length < FIRST + PICTURES) return;
    const mean = this.spent.slice(FIRST).reduce((sum, x) => sum + x, 0) / PICTURES;
    this.spent = [];
    if (mean <= SLOWEST) return;
    this.affordable -= 1;
    if (!this.told) this.tell("This machine draws slowly: the organ is drawn more simply.");
    this.told = true;
  }
}
