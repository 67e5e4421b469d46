// The volume as a whole, rendered by Niivue, which is fetched only when it is asked for.
import type { Niivue } from "@niivue/niivue";
import type { Side } from "./state";
import type { Stored } from "./stored";

const MOST = 4_000_000; // voxels: the graphics card of a laptop, or software, must turn them smoothly
const FLOAT32 = 16; // NIfTI's code
const BONES = { colormap: "ct_bones", low: 100, high: 500 }; // Niivue's colours of bone, HU

export class Render {
  readonly element = document.createElement("figure");
  readonly canvas = document.createElement("canvas");
  private readonly only = document.createElement("button");
  private niivue: Niivue | null = null;
  private shown = "";
  private bones: boolean;

  constructor(private readonly side: Side, readonly number: number) {
    this.element.className = "pane render";
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "Rendering of the volume: drag to turn it");
    this.bones = side.stored.stack.unit === "HU";
    this.only.textContent = "Bones";
    this.only.title = "Bone alone, or all that the window shows";
    this.only.hidden = !this.bones;
    this.only.addEventListener("click", () => {
      this.bones = !this.bones;
      this.draw();
    });
    this.element.append(this.canvas, this.only);
  }

  /** Fetches Niivue and hands it the volume. Rejects where there is no WebGL 2. */
  async open(): Promise<void> {
    if (!document.createElement("canvas").getContext("webgl2"))
      throw new Error("this browser offers no WebGL 2, which the rendering needs; the slices do without");
    const { Niivue, NVImage, SLICE_TYPE } = await import("@niivue/niivue");
    const niivue = new Niivue({
      backColor: [0, 0, 0, 1],
      sliceType: SLICE_TYPE.RENDER,
      isOrientCube: this.side.image.patient,
      isOrientationTextVisible: false,
      show3Dcrosshair: false,
      crosshairWidth: 0,
      isColorbar: false,
      dragAndDropEnabled: false,
      loadingText: "",
      logLevel: "error",
    });
    await niivue.attachToCanvas(this.canvas);
    const { dims, pixels, affine, values } = smaller(this.side.stored);
    const file = NVImage.createNiftiArray(dims, pixels, affine, FLOAT32, values);
    const image = await NVImage.loadFromUrl({
      url: file, name: "volume.nii", colormap: "gray", cal_min: this.side.low, cal_max: this.side.high, colorbarVisible: false,
    });
    niivue.addVolume(image);
    niivue.setRenderAzimuthElevation(this.side.image.patient ? 160 : 150, 15);
    await niivue.setVolumeRenderIllumination(0.4); // shading tells depth
    this.niivue = niivue;
    this.draw();
  }

  get ready(): boolean {
    return this.niivue !== null;
  }

  /** Shows bone, or what the window of the slices shows. */
  draw(): void {
    this.only.setAttribute("aria-pressed", String(this.bones));
    const image = this.niivue?.volumes[0];
    const { colormap, low, high } = this.bones ? BONES : { colormap: "gray", low: this.side.low, high: this.side.high };
    const shown = `${colormap} ${low} ${high}`;
    if (!this.niivue || !image || shown === this.shown) return;
    this.shown = shown;
    image.colormap = colormap;
    image.cal_min = low;
    image.cal_max = high;
    this.niivue.updateGLVolume();
  }

  /** Draws now, so that the canvas can be read in the same breath. */
  redraw(): void {
    this.niivue?.drawScene();
  }
}

/** Every k-th voxel, with its NIfTI affine (RAS), until the rest is few enough. */
function smaller(stored: Stored): { dims: number[]; pixels: number[]; affine: number[]; values: Float32Array } {
  const { shape, spacing } = stored;
  const steps = [1, 1, 1];
  const count = () => steps.map((s, a) => Math.ceil(shape[a] / s));
  while (count().reduce((a, b) => a * b) > MOST) {
    const lengths = steps.map((s, a) => (s < shape[a] ? s * spacing[a] : Infinity));
    steps[lengths.indexOf(Math.min(...lengths))]++;
  }
  const [nz, ny, nx] = count();
  const values = new Float32Array(nz * ny * nx);
  for (let z = 0, at = 0; z < nz; z++)
    for (let y = 0; y < ny; y++)
      for (let x = 0; x < nx; x++, at++)
        values[at] = stored.values[(z * steps[0] * shape[1] + y * steps[1]) * shape[2] + x * steps[2]];
  const [dz, dy, dx] = steps.map((s, a) => s * spacing[a]);
  const { origin, direction: d } = stored.image;
  const ras = [-1, -1, 1]; // LPS to RAS
  const rows = ras.map((sign, i) => [d[3 * i] * dx, d[3 * i + 1] * dy, d[3 * i + 2] * dz, origin[i]].map((v) => sign * v));
  return { dims: [nx, ny, nz], pixels: [dx, dy, dz], affine: [...rows.flat(), 0, 0, 0, 1], values };
}
