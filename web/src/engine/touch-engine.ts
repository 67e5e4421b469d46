// The engine of the real-time loop as WebAssembly (cpp/wasm/engine.cpp): one organ, one thread, ticks in lockstep.
const TOOLS = 4;
const FRAME_NUMBERS = 4 + TOOLS + 3 * 3 * TOOLS + TOOLS;
const MOST_TICKS = 64; // in one call

interface Exports {
  memory: WebAssembly.Memory;
  _initialize(): void;
  allocate(bytes: number): number;
  release(at: number): void;
  make(
    nodes: number, node: number, tets: number, tet: number, region: number, lam: number, mu: number, fixed: number,
    triangles: number, triangle: number, shownNodes: number, shown: number, regions: number, labels: number, cutCount: number, cutSizes: number, blade: number, edge: number,
    radius: number, limit: number, friction: number, toughness: number,
  ): number;
  incise(points: number, point: number, depth: number, x: number, y: number, z: number): number;
  blade_corners(out: number): void;
  cut(triangles: number, corners: number): number;
  undo(): number;
  opened(out: number): void;
  command(tool: number, kind: number, x: number, y: number, z: number, u: number, v: number, w: number, serial: number): void;
  step(ticks: number, forces: number): void;
  follow_clock(on: number): void;
  prepare(): number;
  frame(out: number): number;
  missing_tables(): number;
  set_missing_tables(recorded: number): void;
  digest_high(): number;
  digest_low(): number;
}

/** The numbers of an organ, and the settings of its session: mm and N. Its arrays follow in the file (`arrays`).
 * description: what a record says of the session as a whole. */
interface Header {
  description: Record<string, unknown>;
  nodes: number;
  tets: number;
  triangles: number;
  shown: number;
  regions: number;
  parts: { name: string; volume: number }[]; // regions in the same order: names, mm³
  cuts: number; // that it comes with
  blade: number; // triangles of these
  edge: number; // mm, of a mean element
  radius: number;
  limit: number;
  friction: number;
  toughness: number; // J/m²
}

/** What is drawn of a body that was cut, as a `Scene` has it, mm; and of all its cuts the area, mm², and what they have freed. */
export interface OpenedBody {
  rest: Float32Array<ArrayBuffer>; // (vertices, 3)
  triangles: Uint32Array<ArrayBuffer>;
  lips: number[];
  area: number;
  taken: number[]; // mm³ of the pieces that came free and are no longer there, by region
}

/** Why a cut is not made, by the number that the engine gives; 0: it is. */
const REFUSALS = [
  "",
  "The cut body cannot be computed; cut less deep.",
  "Nothing would be left that is held; cut less deep, or less far.",
  "The cut has too many places where its lips may meet; cut less.",
  "The blade has met nothing.",
];

export class CutRefused extends Error {}

/** The state after a tick: lengths in mm, force in N of the tissue on the tool, tool after tool. */
export interface EngineFrame {
  tick: number;
  faults: number;
  serial: number;
  energy: number; // N mm
  contact: number[];
  point: number[];
  displacement: number[];
  force: number[];
  insertion: number[];
  shown: Float32Array; // (shown nodes, 3) mm; valid until the next call
}

/** Bytes of each array of an organ's file, in their order. */
const arrays = ({ nodes, tets, triangles, shown, regions, blade, cuts }: Header) => ({
  blade: 72 * blade, node: 24 * nodes, lam: 8 * tets, mu: 8 * tets, tet: 16 * tets, region: 4 * tets, triangle: 12 * triangles, shown: 4 * shown, labels: 4 * regions, sizes: 4 * cuts, fixed: nodes,
});
const OPENED_NUMBERS = 8;

/** An address in the engine's memory: beyond 2 GB the number that comes is negative. */
const address = (given: number): number => given >>> 0;

export class TouchEngine {
  private readonly engine: Exports;
  private readonly forces: number;
  private readonly numbers: number;
  private drawn = 0; // vertices
  private drawnFirst = 0; // of the organ as it came
  first: OpenedBody | null = null; // what is drawn of an organ that came with cuts
  edge = 0; // mm
  parts: { name: string; volume: number }[] = []; // its regions, the largest first; mm³
  description: Record<string, unknown> = {};

  private constructor(engine: Exports) {
    this.engine = engine;
    this.forces = address(engine.allocate(8 * 3 * TOOLS * MOST_TICKS));
    this.numbers = address(engine.allocate(8 * FRAME_NUMBERS));
  }

  /** Compiles the module. Of what WASI offers it uses the clock alone. */
  static async load(module: BufferSource): Promise<TouchEngine> {
    const compiled = await WebAssembly.compile(module);
    const system: Record<string, (...given: number[]) => number> = {};
    for (const { name } of WebAssembly.Module.imports(compiled)) system[name] = () => 0;
    system.clock_time_get = (_clock, _precision, at) => {
      new DataView(engine.memory.buffer).setBigUint64(at, BigInt(Math.round(1e6 * performance.now())), true); // ns
      return 0;
    };
    const { exports } = await WebAssembly.instantiate(compiled, { wasi_snapshot_preview1: system });
    const engine = exports as unknown as Exports;
    engine._initialize();
    return new TouchEngine(engine);
  }

  /** Makes the organ of a file's bytes: assembles its stiffness and factors it. */
  make(file: Uint8Array): void {
    const length = new DataView(file.buffer, file.byteOffset).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(file.subarray(4, 4 + length))) as Header;
    const at: Record<string, number> = {};
    let from = 4 + length;
    for (const [name, bytes] of Object.entries(arrays(header))) {
      if (from + bytes > file.length) throw new Error(`the organ's file ends within ${name}`);
      at[name] = address(this.engine.allocate(bytes));
      new Uint8Array(this.engine.memory.buffer, at[name], bytes).set(file.subarray(from, from + bytes));
      from += bytes;
    }
    const { nodes, tets, triangles, shown, regions, cuts, edge, radius, limit, friction, toughness } = header;
    const failed = this.engine.make(
      nodes, at.node, tets, at.tet, at.region, at.lam, at.mu, at.fixed, triangles, at.triangle, shown, at.shown, regions, at.labels, cuts, at.sizes, at.blade, edge,
      radius, limit, friction, toughness,
    );
    for (const each of Object.values(at)) this.engine.release(each);
    if (failed) throw new Error(cuts ? REFUSALS[failed] : "the organ's stiffness is not positive definite");
    this.first = cuts ? this.opened() : null;
    this.drawn = this.drawnFirst = this.first ? this.first.rest.length / 3 : shown;
    this.edge = edge;
    this.parts = header.parts;
    this.description = header.description;
  }

  /** Commands a tool, as a `ToolCommand` does. */
  command(tool: number, kind: number, [x, y, z]: readonly number[], [u, v, w]: readonly number[], serial: number): void {
    this.engine.command(tool, kind, x, y, z, u, v, w, serial);
  }

  /** Runs ticks and returns the forces after each, (ticks, tools, 3) N; valid until the next call. */
  step(ticks: number): Float64Array {
    if (!(ticks <= MOST_TICKS)) throw new Error(`step: at most ${MOST_TICKS} ticks`);
    this.engine.step(ticks, this.forces);
    return new Float64Array(this.engine.memory.buffer, this.forces, 3 * TOOLS * ticks);
  }

  /** Off: a tick makes the tables that it lacks, so that the forces depend on the commands alone; until then they follow late. */
  followClock(on: boolean): void {
    this.engine.follow_clock(Number(on));
  }

  /** Makes tables that the next ticks will need, for some ms. False: there was nothing to make. */
  prepare(): boolean {
    return this.engine.prepare() !== 0;
  }

  frame(): EngineFrame {
    const shown = address(this.engine.frame(this.numbers));
    const numbers = [...new Float64Array(this.engine.memory.buffer, this.numbers, FRAME_NUMBERS)];
    const take = (count: number) => numbers.splice(0, count);
    const [tick, faults, serial, energy] = take(4);
    return {
      tick, faults, serial, energy,
      contact: take(TOOLS), point: take(3 * TOOLS), displacement: take(3 * TOOLS), force: take(3 * TOOLS), insertion: take(TOOLS),
      shown: new Float32Array(this.engine.memory.buffer, shown, 3 * this.drawn),
    };
  }

  /** The blade of a cut along a way on the surface at rest (mm), `depth` mm deep: its triangles, (triangles, 3, 3) mm.
   * direction: of the blade; (0, 0, 0): against the surface's mean normal. */
  incision(way: readonly (readonly number[])[], depth: number, [x, y, z]: readonly number[] = [0, 0, 0]): Float64Array {
    const points = this.put(Float64Array.from(way.flat())), count = 9 * this.engine.incise(way.length, points, depth, x, y, z);
    this.engine.release(points);
    if (count === 0) throw new CutRefused("The blade has no way into the tissue here; cut less far around.");
    const at = address(this.engine.allocate(8 * count));
    this.engine.blade_corners(at);
    const corners = new Float64Array(this.engine.memory.buffer, at, count).slice();
    this.engine.release(at);
    return corners;
  }

  /** Cuts by the triangles of a blade. The cut body takes over at once; no tick runs while it is made. */
  cut(blade: Float64Array): OpenedBody {
    const corners = this.put(blade), refused = this.engine.cut(blade.length / 9, corners);
    this.engine.release(corners);
    if (refused) throw new CutRefused(REFUSALS[refused]);
    return this.opened();
  }

  /** Takes the last cut back; left: how many cuts there are then beside those that it came with. Null: none is left. */
  undo(left: number): OpenedBody | null {
    const refused = this.engine.undo();
    if (refused) throw new CutRefused(REFUSALS[refused]);
    if (left > 0) return this.opened();
    this.drawn = this.drawnFirst;
    return null;
  }

  private opened(): OpenedBody {
    this.engine.opened(this.numbers);
    const { buffer } = this.engine.memory, numbers = new Float64Array(buffer, this.numbers, OPENED_NUMBERS);
    const [vertices, triangles, regions, area, rest, triangle, lips, taken] = numbers;
    this.drawn = vertices;
    return {
      rest: new Float32Array(buffer, rest, 3 * vertices).slice(),
      triangles: new Uint32Array(buffer, triangle, 3 * triangles).slice(),
      lips: [...new Int32Array(buffer, lips, regions)],
      area,
      taken: [...new Float64Array(buffer, taken, regions)],
    };
  }

  private put(numbers: Float64Array): number {
    const at = address(this.engine.allocate(8 * numbers.length));
    new Float64Array(this.engine.memory.buffer, at, numbers.length).set(numbers);
    return at;
  }

  /** Which tables the last tick lacked, as a record keeps it. */
  get missingTables(): number {
    return this.engine.missing_tables();
  }

  /** For a replay, not by the clock: the next tick lacks what the recorded one lacked. */
  set missingTables(recorded: number) {
    this.engine.set_missing_tables(recorded);
  }

  /** Of state and forces, to compare replays: 16 hexadecimal digits. */
  digest(): string {
    return [this.engine.digest_high(), this.engine.digest_low()].map((half) => half.toString(16).padStart(8, "0")).join("");
  }
}
