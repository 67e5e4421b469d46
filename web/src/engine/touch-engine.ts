// The engine of the real-time loop as WebAssembly (cpp/wasm/engine.cpp): one organ, one thread, ticks in lockstep.
import type { Vector } from "../protocol/server-messages";
import { readOrgan, type OrganHeader } from "./organ-file.ts"; // with its ending, for Node

const TOOLS = 4;
const FRAME_NUMBERS = 4 + TOOLS + 3 * 3 * TOOLS + TOOLS;
const MOST_TICKS = 64; // in one call

interface Exports {
  memory: WebAssembly.Memory;
  _initialize(): void;
  allocate(bytes: number): number;
  release(at: number): void;
  take_organ(
    nodes: number, node: number, tets: number, tet: number, region: number, lam: number, mu: number, fixed: number,
    triangles: number, triangle: number, shownNodes: number, shown: number, regions: number, labels: number, cutCount: number, cutSizes: number, blade: number, edge: number,
    radius: number, limit: number, friction: number, toughness: number,
  ): void;
  begin(): number;
  build(cuts: number, sizes: number, blade: number): number;
  arrays_at(out: number): number;
  room_for(which: number, bytes: number): number;
  adopt_body(how: Change, triangles: number, corners: number): number;
  change(how: Change, triangles: number, corners: number): number;
  enter(): void;
  incise(points: number, point: number, depth: number, x: number, y: number, z: number, way: number): number;
  blade_corners(out: number): void;
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

/** What is drawn of a body that was cut, as a `Scene` has it, mm; and of all its cuts the area, mm², and what they have freed. */
export interface OpenedBody {
  rest: Float32Array<ArrayBuffer>; // (vertices, 3)
  triangles: Uint32Array<ArrayBuffer>;
  lips: number[];
  area: number;
  taken: number[]; // mm³ of the pieces that came free and are no longer there, by region
}

/** How the cuts of an organ change: one more, the last one goes further (its blade takes the place of the one before), or the last one is taken back. */
export const Change = { once: 0, further: 1, undone: 2 } as const;
export type Change = (typeof Change)[keyof typeof Change];

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

const OPENED_NUMBERS = 8;
const MOST_ARRAYS = 64; // of a body
const COPIED = 2 ** 22; // bytes of a body at a time: a millisecond or two

/** An address in the engine's memory: beyond 2 GB the number that comes is negative. */
const address = (given: number): number => given >>> 0;

export class TouchEngine {
  private readonly engine: Exports;
  private readonly forces: number;
  private readonly numbers: number;
  private coming: { array: Uint8Array; at: number; which: number }[] = []; // what is still to be copied of the next body
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
    const { cuts, shown } = this.take(file), failed = this.engine.begin();
    if (failed) throw new Error(cuts ? REFUSALS[failed] : "the organ's stiffness is not positive definite");
    this.first = cuts ? this.opened() : null;
    this.drawn = this.drawnFirst = this.first ? this.first.rest.length / 3 : shown;
  }

  /** Takes the organ of a file's bytes, whose bodies it will build. */
  take(file: Uint8Array): OrganHeader {
    const { header, arrays } = readOrgan(file), at: Record<string, number> = {};
    for (const [name, array] of Object.entries(arrays)) {
      at[name] = address(this.engine.allocate(array.length));
      new Uint8Array(this.engine.memory.buffer, at[name], array.length).set(array);
    }
    const { nodes, tets, triangles, shown, regions, cuts, edge, radius, limit, friction } = header;
    this.engine.take_organ(
      nodes, at.node, tets, at.tet, at.region, at.lam, at.mu, at.fixed, triangles, at.triangle, shown, at.shown, regions, at.labels, cuts, at.sizes, at.blade, edge,
      radius, limit, friction, at.toughness,
    );
    for (const each of Object.values(at)) this.engine.release(each);
    this.edge = edge;
    this.parts = header.parts;
    this.description = header.description;
    return header;
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

  /** A blade enters: its whole way follows the surface as it is now. */
  enter(): void {
    this.engine.enter();
  }

  /** The edge of a blade that has entered at a point, from there into the tissue, mm. depth, direction: as of `incision`. */
  bladeEdge(point: Vector, depth: number, direction: Vector): Vector {
    return this.incise([point], depth, direction).into.map((x) => depth * x) as Vector;
  }

  /** The blade of a cut along a way on the surface at rest (mm), `depth` mm deep: its triangles, (triangles, 3, 3) mm.
   * direction: of the blade; (0, 0, 0): against the surface's mean normal. */
  incision(way: readonly Vector[], depth: number, direction: Vector = [0, 0, 0]): Float64Array {
    const { count } = this.incise(way, depth, direction);
    if (count === 0) throw new CutRefused("The blade has no way into the tissue here; cut less far around.");
    const at = address(this.engine.allocate(8 * count));
    this.engine.blade_corners(at);
    const corners = new Float64Array(this.engine.memory.buffer, at, count).slice();
    this.engine.release(at);
    return corners;
  }

  /** count: numbers of its corners. into: unit way into the tissue. */
  private incise(way: readonly Vector[], depth: number, [x, y, z]: Vector): { count: number; into: Vector } {
    const points = this.put(Float64Array.from(way.flat())), at = address(this.engine.allocate(24));
    const count = 9 * this.engine.incise(way.length, points, depth, x, y, z, at);
    const into = [...new Float64Array(this.engine.memory.buffer, at, 3)] as Vector;
    for (const each of [points, at]) this.engine.release(each);
    return { count, into };
  }

  /** Changes the cuts, and makes the body here: no tick runs meanwhile. left: how many cuts there are then, beside those
   * that the organ came with. Null: the body is the one that it came with. */
  change(how: Change, left: number, blade: Float64Array = new Float64Array()): OpenedBody | null {
    return this.changed(left, blade, (triangles, corners) => this.engine.change(how, triangles, corners));
  }

  /** Makes the body with these cuts, by their blades, beside those that the organ comes with; `receive` takes its arrays. */
  build(cuts: readonly Float64Array[]): Uint8Array<ArrayBuffer>[] {
    const sizes = this.put(Float64Array.from(cuts, (blade) => blade.length / 9)); // room enough for as many integers
    new Int32Array(this.engine.memory.buffer, sizes, cuts.length).set(cuts.map((blade) => blade.length / 9));
    const corners = this.put(Float64Array.from(cuts.flatMap((blade) => [...blade]))), refused = this.engine.build(cuts.length, sizes, corners);
    this.engine.release(corners);
    this.engine.release(sizes);
    if (refused) throw new CutRefused(REFUSALS[refused]);
    const out = this.put(new Float64Array(2 * MOST_ARRAYS)), { buffer } = this.engine.memory;
    const at = new Float64Array(buffer, out, 2 * this.engine.arrays_at(out)), arrays: Uint8Array<ArrayBuffer>[] = [];
    for (let k = 0; k < at.length; k += 2) arrays.push(new Uint8Array(buffer, at[k], at[k + 1]).slice() as Uint8Array<ArrayBuffer>);
    this.engine.release(out);
    return arrays;
  }

  /** The next body, made by another engine: `copy` takes it over piece by piece, then `adopt` the session goes on with it. */
  receive(arrays: readonly Uint8Array[]): void {
    this.coming = arrays.map((array, which) => ({ array, which, at: 0 }));
  }

  /** Copies some of the body that comes. False: all of it is there. */
  copy(): boolean {
    let left = COPIED;
    while (this.coming.length > 0 && left > 0) {
      const one = this.coming[0];
      if (one.at === 0) one.at = address(this.engine.room_for(one.which, one.array.length));
      const part = one.array.subarray(0, left);
      new Uint8Array(this.engine.memory.buffer, one.at, part.length).set(part);
      one.at += part.length;
      one.array = one.array.subarray(part.length);
      left -= part.length;
      if (one.array.length === 0) this.coming.shift();
    }
    return this.coming.length > 0;
  }

  /** Changes the cuts as `change` does; the body is the one that has come. */
  adopt(how: Change, left: number, blade: Float64Array = new Float64Array()): OpenedBody | null {
    while (this.copy());
    return this.changed(left, blade, (triangles, corners) => this.engine.adopt_body(how, triangles, corners));
  }

  private changed(left: number, blade: Float64Array, change: (triangles: number, corners: number) => number): OpenedBody | null {
    const corners = this.put(blade), refused = change(blade.length / 9, corners);
    this.engine.release(corners);
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
