// Values between a page and the notebook that shows it in a frame (web/src/notebook/widget.ts), by name, over a port of
// their own. The frame is sandboxed: its origin is opaque, so nothing but this port connects the two.
import { CONNECT, type Given, type Report, type Values } from "./notebook-messages";

const INTERVAL = 50; // ms between two messages at least

/** Was this page made for a frame of a notebook? */
export const inNotebook = document.documentElement.dataset.host === "notebook";

const connected = new Promise<MessagePort>((resolve) => {
  if (!inNotebook) return;
  addEventListener("message", ({ data, ports, source }) => {
    if (source === parent && data === CONNECT && ports[0]) resolve(ports[0]);
  });
});

export class NotebookLink {
  private port: MessagePort | null = null;
  private sentAt = -Infinity; // ms
  private taken = 0;
  private readonly sent = new Map<string, string>(); // as JSON

  /** setters: what the notebook can set, from the first report on. */
  constructor(private readonly setters: Record<string, (value: never) => void>) {}

  /** Takes the values that the notebook sets. The page must be ready for them. */
  open(): void {
    void connected.then((port) => {
      port.onmessage = ({ data: { serial, values } }: MessageEvent<Given>) => {
        this.taken = serial;
        for (const [name, value] of Object.entries(values)) {
          this.setters[name]?.(value as never);
          this.sent.delete(name); // the page may have taken another value: it says which
        }
      };
      this.port = port;
    });
  }

  /** Sends those values that are others than the last time, unless that was a moment ago. Called once a frame. */
  report(now: number, values: Values): void {
    if (!this.port || now - this.sentAt < INTERVAL) return;
    const changed = Object.entries(values).filter(([name, value]) => {
      const text = JSON.stringify(value);
      return this.sent.get(name) !== text && this.sent.set(name, text);
    });
    if (!changed.length) return;
    this.sentAt = now;
    this.port.postMessage({ taken: this.taken, values: Object.fromEntries(changed) } satisfies Report);
  }
}
