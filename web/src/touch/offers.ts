// What a session lets the page offer: tools, colors, views, notes.
import type { Scene } from "../protocol/server-messages";
import { element, write } from "../ui/controls";

/** May the hand take this tool? The page measures by itself, and goes inside where there is a lumen. watches: it touches nothing. */
export function offersTool(scene: Scene, kind: string, watches: boolean): boolean {
  if (kind === "measure") return !scene.exam;
  if (kind === "camera") return !scene.exam && scene.lumen.length > 0;
  return !scene.replay && !watches && scene.tools.includes(kind);
}
/** May the page show these colors? Comparing with finite elements is work for the server, which in a room the teacher asks for. */
export const offersColor = (scene: Scene, mode: string, leads: boolean): boolean => scene.views.includes(mode) && (leads || mode !== "error");
/** May this session take notes? */
export const offersNotes = (scene: Scene): boolean => !scene.exam && !scene.replay;

/** Shows the controls that the session has, and hides the others. watches, leads: what the hand may do in a room. */
export function showOffers(scene: Scene, { watches, leads }: { watches: boolean; leads: boolean }): void {
  const buttons = (id: string) => [...document.querySelectorAll<HTMLElement>(`#${id} button`)];
  document.body.classList.toggle("replay", scene.replay);
  for (const button of buttons("tool")) button.hidden = !offersTool(scene, button.dataset.value!, watches);
  for (const button of buttons("color-mode")) button.hidden = !offersColor(scene, button.dataset.value!, leads);
  element("model-and-mesh").hidden = !leads || (scene.models.length < 2 && scene.organs.length < 2);
  element("note-kind").hidden = watches || !offersNotes(scene);
  element("shading").parentElement!.hidden = !scene.views.includes("wireframe");
  element("color-mode").parentElement!.hidden = buttons("color-mode").filter((button) => !button.hidden).length < 2;
  element("translucent").hidden = !scene.views.includes("inside");
  element("stiffness-row").hidden = element("linearity-row").hidden = element("mesh-error-row").hidden = scene.exam;
  element<HTMLButtonElement>("undo-cut").disabled = scene.made === 0 || !leads;
  element("use-neo-hookean").hidden = !leads;
  element("slices-toggle").hidden = !scene.images;
  element("task").hidden = element("found").hidden = !scene.task;
  write("task", scene.task);
}
