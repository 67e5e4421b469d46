// The controls of the view from inside: where along the centre line, which branch, fly on, leave.
import { element, write } from "../ui/controls";
import type { Endoscope } from "../endoscopy/endoscope";

export class EndoscopePanel {
  private readonly slider = element<HTMLInputElement>("along");
  private readonly branches = element<HTMLSelectElement>("branch");
  private readonly fly = element<HTMLButtonElement>("fly");
  private shown = "";

  constructor(private readonly endoscope: Endoscope, leave: () => void) {
    this.slider.addEventListener("input", () => {
      endoscope.fly(false, 0);
      endoscope.goTo(endoscope.branch, Number(this.slider.value));
    });
    this.branches.addEventListener("change", () => {
      endoscope.fly(false, 0);
      endoscope.goTo(Number(this.branches.value), 0);
    });
    this.fly.addEventListener("click", () => this.toggleFlight());
    element("outside").addEventListener("click", leave);
  }

  setOrgan(): void {
    const count = this.endoscope.centerline?.branches.length ?? 0;
    this.branches.replaceChildren(...Array.from({ length: count }, (_, i) => new Option(i ? `branch ${i}` : "main", String(i))));
    element("branch-row").hidden = count < 2;
    this.shown = "";
  }

  toggleFlight(): void {
    const { endoscope } = this;
    if (!endoscope.active) return;
    const { mm, length } = endoscope.along;
    if (!endoscope.flying && mm > 0.98 * length) endoscope.goTo(endoscope.branch, 0);
    endoscope.fly(!endoscope.flying, performance.now());
  }

  /** Called once a frame. */
  update(): void {
    element("camera-row").hidden = !this.endoscope.active;
    document.body.classList.toggle("inside", this.endoscope.active);
    if (!this.endoscope.active) return;
    const { branch, mm, length } = this.endoscope.along, text = `${Math.round(mm)} of ${Math.round(length)} mm`;
    const now = `${branch} ${text} ${this.endoscope.flying}`;
    if (now === this.shown) return;
    this.shown = now;
    this.slider.max = String(length);
    this.slider.value = String(mm);
    this.slider.setAttribute("aria-valuetext", text);
    write("along-set", text);
    this.branches.value = String(branch);
    this.fly.textContent = this.endoscope.flying ? "Stop" : "Fly";
  }
}
