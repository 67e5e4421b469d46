// What a trainee claims: a lump under the tool, a sample at the needle's tip.
import { MarkKind, type Frame, type Mark } from "../protocol/server-messages";
import { NEEDLE } from "../rendering/tool-meshes";
import type { ToolKind } from "../tools/tool-controller";
import { measure } from "../ui/force-readout";
import { showMessage } from "./hint";

export function markLump(frame: Frame | null, tool: ToolKind, send: (mark: Mark) => void): void {
  const measurement = frame && measure(frame, tool);
  send({ kind: MarkKind.lump, tool: measurement?.tool ?? 0 });
  showMessage(measurement ? "Noted: found, under the tool." : "Noted, but no tool touches the organ: press where the lump is.");
}

export function takeSample(frame: Frame | null, send: (mark: Mark) => void): void {
  if (!frame || !(frame.insertion[NEEDLE] > 0)) return showMessage("The needle is not in the tissue: insert it deeper.");
  send({ kind: MarkKind.sample, tool: NEEDLE });
  showMessage(`Sample taken ${frame.insertion[NEEDLE].toFixed(1)} mm deep.`);
}
