// Bundles the pages into dist/: the organ's and the viewer's scripts, the pages, their style, and the licences of what
// is bundled. The rendering of the viewer is a part of its own, fetched when it is asked for.
import { build } from "esbuild";
import { copyFile, mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";

const how = {
  outdir: "dist",
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  legalComments: "linked",
  logLevel: "warning",
  metafile: true,
};
await rm("dist", { recursive: true, force: true });
await mkdir("dist");
const touch = await build({ ...how, entryPoints: [{ in: "src/touch/main.ts", out: "main" }, { in: "src/worker.ts", out: "worker" }, { in: "src/engine/prediction-worker.ts", out: "predict" }] });
const view = await build({
  ...how,
  entryPoints: [{ in: "src/slices/main.ts", out: "view" }],
  splitting: true,
  chunkNames: "view-[hash]",
  external: ["numcodecs/*"], // Niivue's decoders of Zarr files, which the page never opens
});
// The viewer without its rendering, for a page that holds everything; and the widget of a notebook.
const whole = await build({
  ...how,
  entryPoints: [{ in: "src/slices/main.ts", out: "view-file" }, { in: "src/notebook/widget.ts", out: "notebook" }],
  external: ["@niivue/niivue"],
});
for (const file of ["index.html", "view.html", "style.css", "touch.css", "view.css"]) await copyFile(file, `dist/${file}`);

// Every package that a bundle contains a part of, and the licence that came with it.
const inputs = [touch, view, whole].flatMap(({ metafile }) => Object.keys(metafile.inputs));
const packages = new Set(inputs.map((path) => /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path)?.[1]).filter(Boolean));
const texts = [];
for (const name of [...packages].sort()) {
  const folder = `node_modules/${name}`;
  const { version, license } = JSON.parse(await readFile(`${folder}/package.json`, "utf8"));
  const file = (await readdir(folder)).find((each) => /^licen[cs]e/i.test(each));
  // A package that ships without its licence has it here.
  const text = await readFile(file ? `${folder}/${file}` : `licences/${name.replace("/", "-")}.txt`, "utf8");
  texts.push(`${name === "three" ? "three.js" : name} ${version}, ${license}\n\n${text}`);
}
await writeFile("dist/LICENSES.txt", `These pages contain parts of the following, under these licences.\n\n${texts.join("\n\n----\n\n")}`);
