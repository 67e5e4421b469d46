// The viewer's picture as a PNG file.
import type { VolumeRendering } from "./volume-rendering";

/** All panes as arranged on the page, with a line of text below. */
export async function exportPng(stage: HTMLElement, renderings: VolumeRendering[], label: string): Promise<Blob> {
  for (const rendering of renderings) rendering.redraw();
  const ratio = devicePixelRatio, strip = 26, box = stage.getBoundingClientRect();
  const canvas = document.createElement("canvas");
  canvas.width = Math.round(box.width * ratio);
  canvas.height = Math.round((box.height + strip) * ratio);
  const context = canvas.getContext("2d")!;
  context.scale(ratio, ratio);
  context.fillStyle = "#000";
  context.fillRect(0, 0, box.width, box.height + strip);
  for (const pane of stage.querySelectorAll("canvas")) {
    const at = pane.getBoundingClientRect();
    if (at.width) context.drawImage(pane, at.left - box.left, at.top - box.top, at.width, at.height);
  }
  context.fillStyle = "#c9d3d6";
  context.font = "12px system-ui, sans-serif";
  context.fillText(label, 10, box.height + strip - 9, box.width - 20);
  return new Promise((resolve, reject) =>
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("the browser could not make a PNG file; save a screenshot instead"))), "image/png"),
  );
}
