// Bundles the page into dist/: two scripts, the page, its style, and the licences of what is bundled.
import { build } from "esbuild";
import { copyFile, mkdir, readFile, rm, writeFile } from "node:fs/promises";

await rm("dist", { recursive: true, force: true });
await mkdir("dist");
await build({
  entryPoints: ["src/main.ts", "src/worker.ts"],
  outdir: "dist",
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  legalComments: "linked",
  logLevel: "warning",
});
for (const file of ["index.html", "style.css"]) await copyFile(file, `dist/${file}`);
const three = JSON.parse(await readFile("node_modules/three/package.json", "utf8"));
const licence = await readFile("node_modules/three/LICENSE", "utf8");
await writeFile("dist/LICENSES.txt", `This page contains three.js ${three.version}, under this licence:\n\n${licence}`);
