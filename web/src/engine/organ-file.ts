// The organ as the engine takes it (src/palpate/server/solid_message.py): a header, then arrays.

/** The numbers of an organ, and the settings of its session: mm and N. Its arrays follow in the file (`bytesOf`).
 * description: what a record says of the session as a whole. */
export interface OrganHeader {
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
}

/** Bytes of each array of an organ's file, in their order. */
const bytesOf = ({ nodes, tets, triangles, shown, regions, blade, cuts }: OrganHeader) => ({
  blade: 72 * blade, node: 24 * nodes, lam: 8 * tets, mu: 8 * tets, toughness: 8 * regions, tet: 16 * tets, region: 4 * tets, triangle: 12 * triangles, shown: 4 * shown, labels: 4 * regions, sizes: 4 * cuts, fixed: nodes,
});

export function readOrgan(file: Uint8Array): { header: OrganHeader; arrays: Record<string, Uint8Array> } {
  let at = 4 + new DataView(file.buffer, file.byteOffset).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(file.subarray(4, at))) as OrganHeader, arrays: Record<string, Uint8Array> = {};
  for (const [name, bytes] of Object.entries(bytesOf(header))) {
    if (at + bytes > file.length) throw new Error(`the organ's file ends within ${name}`);
    arrays[name] = file.subarray(at, (at += bytes));
  }
  return { header, arrays };
}
