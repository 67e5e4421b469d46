// What `palpate export` has put into the page: the worker's code, the engine and the organ, in elements that the browser
// does not run, or in files that they name. A page of slices holds the list of images and their values instead. A page that
// is served has none of them.
import type { Album } from "./server-messages";

const find = (id: string) => document.getElementById(id) as HTMLScriptElement | null;

/** Was this page exported? */
export const isExported = find("organ-data") !== null;

/** Address of the worker's code. */
export function workerAddress(): string {
  const code = find("worker-code");
  if (!code) return "static/worker.js";
  return code.dataset.file ?? URL.createObjectURL(new Blob([code.textContent], { type: "text/javascript" }));
}

/** The bytes of an element's file; without one the element holds them, as base64 of gzip. */
async function bytes(id: string): Promise<ArrayBuffer> {
  const { dataset, textContent } = find(id)!;
  if (dataset.file) return (await fetch(dataset.file)).arrayBuffer();
  const packed = Uint8Array.from(atob(textContent), (character) => character.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

export async function embeddedFile(): Promise<{ organ: ArrayBuffer; engine: ArrayBuffer }> {
  const [organ, engine] = await Promise.all([bytes("organ-data"), bytes("engine-module")]);
  return { organ, engine };
}

/** The images of a page of slices; null if they are served. */
export function embeddedAlbum(): Album | null {
  const text = find("album")?.textContent;
  return text ? JSON.parse(text) : null;
}

/** The values of one stack of an image. */
export const embeddedValues = (image: number, stack: number): Promise<ArrayBuffer> => bytes(`values-${image}-${stack}`);
