// The connection of a page with its server: fetches the scene, hears messages, and connects anew when the way is lost.
import { readScene, type SceneArrays } from "./scene-arrays";
import { RoomLiveness, type Liveness } from "./room-liveness";
import { CloseCode, encodeSeen } from "./server-messages";

const FIRST_RETRY = 250, LAST_RETRY = 4000; // ms
const SEEN_INTERVAL = 100, LOOK_INTERVAL = 50, NO_ANSWER = 8000; // ms

/** What it tells. */
export interface Listener {
  /** There is another scene to draw; cut: since the organ was cut. */
  scene(arrays: SceneArrays, cut: boolean): void;
  opened(): void;
  message(data: ArrayBuffer): void;
  notice(text: string): void;
  status(good: boolean, text: string): void;
  /** The room is silent for longer than usual: the force is not that of now. */
  stale(): void;
  /** Whether it is silent for so long that nothing may be predicted. */
  silent(on: boolean): void;
  /** The connection is lost; frames of the one before are not shown. */
  closed(): void;
}

/** The server lets nobody in with this address, and says why. */
class Refused extends Error {}

export class ServerConnection {
  readonly liveness = new RoomLiveness((now, before) => this.follow(now, before));
  private sceneAddress = "";
  private socket: WebSocket | null = null;
  private taken = 0; // frames on this connection
  private telling: ReturnType<typeof setTimeout> | null = null; // until the server is told of them
  private inRoom = false;
  private giveUp: (code: number) => void = () => {}; // the connection, and begin another one

  constructor(private readonly listener: Listener) {}

  /** Stays connected. Fetches the scene at each connection, since the server may have changed it. */
  async open(scene: string, address: string): Promise<void> {
    this.sceneAddress = scene;
    setInterval(() => this.inRoom && this.socket?.readyState === WebSocket.OPEN && this.liveness.watch(), LOOK_INTERVAL);
    for (let pause = FIRST_RETRY; ; pause = Math.min(2 * pause, LAST_RETRY)) {
      try {
        await this.fetchScene();
        this.connect(address);
        pause = FIRST_RETRY;
        const code = await new Promise<number>((closed) => {
          this.giveUp = closed;
          this.socket!.onclose = (event) => closed(event.code);
        });
        this.listener.silent(true); // until there is another one, with the scene
        if (code === CloseCode.scene_changed) {
          this.listener.status(false, "Loading another mesh…");
          continue;
        }
        this.listener.status(false, "Connection lost. Trying again…");
      } catch (problem) {
        const refused = problem instanceof Refused;
        this.listener.status(false, refused ? `Not let in: ${problem.message}.` : "palpate is not running. Trying again…");
      }
      this.listener.closed();
      await new Promise((again) => setTimeout(again, pause));
    }
  }

  /** Gets the scene as it is now. */
  async fetchScene(cut = false): Promise<void> {
    const ended = new AbortController(), late = setTimeout(() => ended.abort(), NO_ANSWER); // a lost host's connection may stay open
    const answer = await fetch(this.sceneAddress, { signal: ended.signal });
    clearTimeout(late);
    if (answer.status === 403) throw new Refused((await answer.text()).replace("refused: ", ""));
    if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
    const arrays = readScene(await answer.arrayBuffer());
    this.inRoom = arrays.scene.room !== "";
    this.listener.scene(arrays, cut);
  }

  send(message: ArrayBuffer): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(message);
  }

  /** Says soon how many frames have come on this connection, so that the server sends no more than the way can carry. */
  countFrame(): void {
    this.taken++;
    this.telling ??= setTimeout(() => {
      this.telling = null;
      this.send(encodeSeen({ count: this.taken }));
    }, SEEN_INTERVAL);
  }

  /** Where the engine and the solid are, with which a page predicts. */
  get predictionAddresses(): [engine: string, solid: string] {
    const query = new URL(this.sceneAddress, self.location.origin).search;
    return [`/engine${query}`, `/solid${query}`];
  }

  private connect(address: string): void {
    const socket = (this.socket = new WebSocket(address));
    socket.binaryType = "arraybuffer";
    this.taken = 0;
    socket.onopen = () => {
      this.liveness.begin();
      this.listener.status(true, "");
      this.listener.opened();
    };
    socket.onmessage = ({ data }: MessageEvent<ArrayBuffer | string>) => {
      this.liveness.hear();
      if (typeof data === "string") this.listener.notice(data);
      else this.listener.message(data);
    };
  }

  /** The room is heard, is silent, or is given up. */
  private follow(now: Liveness, before: Liveness): void {
    if (now === "given up") {
      this.socket!.onmessage = this.socket!.onclose = null;
      this.socket!.close();
      return this.giveUp(CloseCode.room_lost);
    }
    this.listener.silent(now !== "heard");
    if (now === "stale") this.listener.stale();
    else if (now === "lost") this.listener.status(false, "The room does not answer. Waiting…");
    else if (before === "lost") this.listener.status(true, "");
  }
}
