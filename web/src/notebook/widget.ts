// The front end of the widgets of palpate.display, for anywidget: a page in a sandboxed frame, and the values that it
// reports and takes. It runs in the notebook's document.
import { CONNECT, type Given, type Report, type Values } from "../protocol/notebook-messages";

interface Model {
  get(name: string): unknown;
  set(name: string, value: unknown): void;
  save_changes(): void;
  on(event: string, heard: () => void): void;
  off(event: string, heard: () => void): void;
}

/** Is the notebook dark? JupyterLab and VS Code say so on their bodies; elsewhere the system does. */
function isDark(): boolean {
  const { jpThemeLight, vscodeThemeKind } = document.body.dataset;
  if (jpThemeLight) return jpThemeLight === "false";
  if (vscodeThemeKind) return /dark|high-contrast$/.test(vscodeThemeKind);
  return matchMedia("(prefers-color-scheme: dark)").matches;
}

async function unpacked(packed: DataView<ArrayBuffer>): Promise<string> {
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

function render({ model, el }: { model: Model; el: HTMLElement }): () => void {
  const frame = document.createElement("iframe");
  frame.title = model.get("title") as string;
  frame.setAttribute("sandbox", "allow-scripts allow-downloads"); // an origin of its own: it cannot reach the notebook
  frame.allow = "gamepad; xr-spatial-tracking; autoplay; fullscreen";
  frame.style.cssText = `display: block; width: 100%; height: ${Number(model.get("height"))}px; border: 0; border-radius: 6px`;
  // The picture for readers without a kernel hides while this is here, and with it its part of the notebook's output.
  const picture = `.${model.get("_picture") as string}`, hidden = document.createElement("style");
  hidden.textContent = `${picture}, .jp-OutputArea-child:has(${picture}) { display: none !important }`;
  el.classList.add("palpate-widget");
  el.append(hidden, frame);

  const settable = model.get("_settable") as string[];
  const given = new Map<string, number>(); // the newest message with each value
  let port: MessagePort | null = null, serial = 0, taking = false;
  const post = (values: Values) => {
    serial++;
    for (const name of Object.keys(values)) given.set(name, serial);
    port?.postMessage({ serial, values } satisfies Given);
  };
  const themes = new MutationObserver(() => post({ dark: isDark() }));
  themes.observe(document.body, { attributes: true });

  /** Gives the page values that were set here or in Python, but for those that it has reported itself. */
  const give = (names: string[]) => {
    const values = names.map((name) => [name, model.get(name)]).filter(([, value]) => value !== null && value !== undefined);
    if (!taking && values.length) post(Object.fromEntries(values));
  };
  /** Takes a report, but for values that were set here after it: the page reports again when it has taken those. */
  const take = ({ data }: MessageEvent<Report>) => {
    taking = true;
    for (const [name, value] of Object.entries(data.values)) if ((given.get(name) ?? 0) <= data.taken) model.set(name, value);
    taking = false;
    model.save_changes();
  };
  // Each time: a notebook that moves the frame in its document loads it anew.
  const connect = () => {
    const channel = new MessageChannel();
    port?.close();
    port = channel.port1;
    port.onmessage = take;
    frame.contentWindow?.postMessage(CONNECT, "*", [channel.port2]);
    give(settable);
  };
  const heard = settable.map((name): [string, () => void] => [`change:${name}`, () => give([name])]);
  for (const [event, listener] of heard) model.on(event, listener);

  void unpacked(model.get("_page") as DataView<ArrayBuffer>).then((page) => {
    frame.addEventListener("load", connect);
    frame.srcdoc = page.replace("<html", `<html data-dark="${isDark()}"`);
  });
  return () => {
    for (const [event, listener] of heard) model.off(event, listener);
    themes.disconnect();
    port?.close();
    hidden.remove();
    frame.remove(); // and with it its worker, which runs the engine
  };
}

export default { render };
