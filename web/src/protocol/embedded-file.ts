// What `palpate export` has put into the page: the worker's code, the engine and the organ, in elements that the browser
// does not run. A page that is served has none of them.

const element = (id: string) => document.getElementById(id)?.textContent ?? null;

/** Was this page exported? */
export const isExported = element("organ-data") !== null;

/** Address of the worker's code. */
export function workerAddress(): string {
  const code = element("worker-code");
  return code === null ? "static/worker.js" : URL.createObjectURL(new Blob([code], { type: "text/javascript" }));
}

/** The bytes of an element: base64 of gzip. */
async function bytes(id: string): Promise<ArrayBuffer> {
  const packed = Uint8Array.from(atob(element(id)!), (character) => character.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

export async function embeddedFile(): Promise<{ organ: ArrayBuffer; engine: ArrayBuffer }> {
  const [organ, engine] = await Promise.all([bytes("organ-data"), bytes("engine-module")]);
  return { organ, engine };
}
