// What is said above and below the organ: what is shown; what the selected tool does, or for some seconds a message.
import type { MeasureKind } from "../organ/measurement";
import type { Scene } from "../protocol/server-messages";
import type { ToolKind } from "../tools/tool-controller";
import { write } from "../ui/controls";

const HINTS: Record<ToolKind, string> = {
  press: "Hold on the organ to press, move to stroke; the wheel presses deeper.",
  pull: "Hold a point of the organ and drag it; the wheel lifts it.",
  grasp: "Two jaws hold left and right; drag to move them, the wheel closes them.",
  needle: "Click where the needle enters; the wheel or the slider inserts it.",
  cut: "Draw over the organ to cut it; the slider is the depth, at its end all the way through. Pull beside the cut to open it.",
  measure: "",
  camera: "Drag to look around; the wheel goes forward and back. G flies on, Q leaves.",
};
const MEASURE_HINTS: Record<MeasureKind, string> = {
  distance: "Click two points of the organ.",
  angle: "Click three points of the organ: the angle is at the second.",
  area: "Click around an area, and its first point again to close it.",
  note: "Click the point of the organ that you write of.",
};
const MESSAGE_TIME = 3000; // ms

let messageUntil = 0;

export function showMessage(text: string): void {
  messageUntil = performance.now() + MESSAGE_TIME;
  write("hint", text);
}

/** What is said where there is no message. refused: the tissue is fixed where the tool is. */
export function showHint(tool: ToolKind, measure: MeasureKind, refused: boolean, replay: boolean): void {
  if (performance.now() < messageUntil) return;
  if (refused) write("hint", "The tissue is fixed here: hold it somewhere else.");
  else if (tool === "camera") write("hint", HINTS.camera);
  else if (tool === "measure") write("hint", `${MEASURE_HINTS[measure]} Drag outside to rotate.`);
  else write("hint", replay ? "A recorded session." : `${HINTS[tool]} Drag outside to rotate.`);
}

/** What is shown. */
export function aboutText(scene: Scene): string {
  const inside = scene.parts.filter((part) => part.inside).map((part) => part.name);
  const about = [`${scene.elements.toLocaleString("en")} tetrahedra`];
  if (scene.models.length < 2) about.push(`model ${scene.model}`);
  if (scene.made) about.push(scene.made > 1 ? `${scene.made} cuts` : "1 cut");
  if (scene.beside.length) about.push(scene.beside.join(", "));
  if (inside.length) about.push(`inside: ${inside.join(", ")}`);
  if (scene.replay) about.push("replay");
  return about.join(" · ");
}
