// What is shown, as one PNG.
import type { Render } from "./render";

/** The panes as they lie on the page, with a line of words below. */
export async function picture(stage: HTMLElement, renders: Render[], words: string): Promise<Blob> {
  for (const render of renders) render.redraw();
  const ratio = devicePixelRatio, strip = 26, box = stage.getBoundingClientRect();
  const canvas = document.createElement("canvas");
  canvas.width = Math.round(box.width * ratio);
  canvas.height = Math.round((box.height + strip) * ratio);
  const pen = canvas.getContext("2d")!;
  pen.scale(ratio, ratio);
  pen.fillStyle = "#000";
  pen.fillRect(0, 0, box.width, box.height + strip);
  for (const pane of stage.querySelectorAll("canvas")) {
    const at = pane.getBoundingClientRect();
    if (at.width) pen.drawImage(pane, at.left - box.left, at.top - box.top, at.width, at.height);
  }
  pen.fillStyle = "#c9d3d6";
  pen.font = "12px system-ui, sans-serif";
  pen.fillText(words, 10, box.height + strip - 9, box.width - 20);
  return new Promise((resolve, reject) =>
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("the browser made no picture"))), "image/png"),
  );
}

/** Hands a file to the browser's downloads. */
export function save(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
