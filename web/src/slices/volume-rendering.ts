// Volume rendering by Niivue, which is loaded on first use.
import type { Niivue } from "@niivue/niivue";
import type { Side } from "./view-state";
import type { ImageSource } from "./image-source";

const MAX_VOXELS = 4_000_000; // so that a laptop rotates them smoothly
const FLOAT32 = 16; // NIfTI's code
const BONES = { colormap: "ct_bones", low: 100, high: 500 }; // Niivue's colors of bone, HU

export class VolumeRendering {
  readonly element = document.createElement("figure");
  readonly canvas = document.createElement("canvas");
  private readonly bonesButton = document.createElement("button");
  private niivue: Niivue | null = null;
  private shown = "";
  private bones: boolean;

  constructor(private readonly side: Side, readonly sideIndex: number) {
    this.element.className = "pane render";
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "Rendering of the volume: drag to turn it");
    this.bones = side.source.stack.unit === "HU";
    this.bonesButton.textContent = "Bones";
    this.bonesButton.title = "Bone alone, or all that the window shows";
    this.bonesButton.hidden = !this.bones;
    this.bonesButton.addEventListener("click", () => {
      this.bones = !this.bones;
      this.draw();
    });
    this.element.append(this.canvas, this.bonesButton);
  }

  /** Fetches Niivue and hands it the volume. Rejects where there is no WebGL 2. */
  async open(): Promise<void> {
    if (!document.createElement("canvas").getContext("webgl2"))
      throw new Error("this browser has no WebGL 2, which the rendering needs; the slices work without it");
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
    const { dims, pixels, affine, values } = subsample(this.side.source);
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

  /** Shows bone, or the display window of the slices. */
  draw(): void {
    this.bonesButton.setAttribute("aria-pressed", String(this.bones));
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

  /** Draws at once, so that the canvas can be read afterwards. */
  redraw(): void {
    this.niivue?.drawScene();
  }
}

/** Every k-th voxel along the axes, until few enough are left, with the NIfTI affine (RAS). */
function subsample(source: ImageSource): { dims: number[]; pixels: number[]; affine: number[]; values: Float32Array } {
  const { shape, spacing } = source;
  const steps = [1, 1, 1];
  const count = () => steps.map((s, a) => Math.ceil(shape[a] / s));
  while (count().reduce((a, b) => a * b) > MAX_VOXELS) {
    const lengths = steps.map((s, a) => (s < shape[a] ? s * spacing[a] : Infinity));
    steps[lengths.indexOf(Math.min(...lengths))]++;
  }
  const [nz, ny, nx] = count();
  const values = new Float32Array(nz * ny * nx);
  for (let z = 0, at = 0; z < nz; z++)
    for (let y = 0; y < ny; y++)
      for (let x = 0; x < nx; x++, at++)
        values[at] = source.values[(z * steps[0] * shape[1] + y * steps[1]) * shape[2] + x * steps[2]];
  const [dz, dy, dx] = steps.map((s, a) => s * spacing[a]);
  const { origin, direction: d } = source.image;
  const ras = [-1, -1, 1]; // LPS to RAS
  const rows = ras.map((sign, i) => [d[3 * i] * dx, d[3 * i + 1] * dy, d[3 * i + 2] * dz, origin[i]].map((v) => sign * v));
  return { dims: [nx, ny, nz], pixels: [dx, dy, dz], affine: [...rows.flat(), 0, 0, 0, 1], values };
}
