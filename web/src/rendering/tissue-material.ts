// Moist tissue: light that scatters below the surface, a film of liquid on it, grain, shadow under tools, paleness where it is
// pressed, blood where it is cut. It is drawn in steps (`LEVEL`), since the processor may have to draw.
import { ShaderMaterial, Vector3, Vector4, type Camera } from "three";
import { TOOLS } from "../protocol/server-messages";
import { LIGHT } from "./gouraud-material";
import { CELLS, noiseTexture } from "./tissue-noise";

const GRAIN = 0.05; // of the organ's radius: the length of a bump
const FIRST_PALE = 4.3; // kPa: at this pressure it is half as pale as it can be: that of blood in capillaries, 32 mmHg (Landis 1930)

const VERTEX = `
in vec3 rest;
in vec4 base, surface;
out vec3 vRest, vNormal, vPosition;
out vec4 vBase;
out vec3 vSurface;
void main() {
  vRest = rest;
  vNormal = normal;
  vPosition = (modelMatrix * vec4(position, 1.0)).xyz; // a loose piece has moved
  vBase = base;
  vSurface = surface.xyz;
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(position, 1.0));
}`;

// Bumps: the gradient of a height that is known at pixels alone (Mikkelsen, J. Graphics GPU Game Tools 15, 2010). Scattering:
// light wraps around the terminator (Green, GPU Gems, chapter 16, 2004), farther in the colors that the tissue absorbs less.
// Film: GGX (Walter et al., EGSR 2007) and Fresnel (Schlick, Computer Graphics Forum 13, 1994) of water. Shadow of a tool: the
// part of the hemisphere that a sphere covers, cos (r/d)^2.
const FRAGMENT = `
precision highp sampler3D;
uniform vec3 light, eye;
uniform float opacity, grainScale;
uniform sampler3D noise;
uniform vec4 spheres[${TOOLS}]; // of tools: center and radius, mm; 0: none
uniform vec4 contacts[${TOOLS}]; // at rest, mm, and how pale
uniform float contactRadius;
in vec3 vRest, vNormal, vPosition;
in vec4 vBase;
in vec3 vSurface;
void main() {
  vec3 n = normalize(vNormal), v = normalize(eye - vPosition), base = vBase.rgb;
  float open = 1.0, mottle = 0.5;
#if LEVEL > 2
  open = vSurface.x;
  float bump = texture(noise, grainScale * vRest).r;
  mottle = texture(noise, 0.21 * grainScale * vRest.yzx + 0.4).r;
  float height = 0.3 / grainScale * 0.1 * vBase.a * bump;
  vec3 dx = dFdx(vPosition), dy = dFdy(vPosition), across = cross(dy, n), down = cross(n, dx);
  float area = dot(dx, across);
  vec3 bent = abs(area) * n - sign(area) * (dFdx(height) * across + dFdy(height) * down);
  n = normalize(bent + 1e-9 * n);
  base *= 1.0 + vBase.a * (1.1 * (mottle - 0.5) + 0.35 * (bump - 0.5));
#endif
  float shadow = 1.0, pale = 0.0;
  for (int i = 0; i < ${TOOLS}; i++) {
    if (spheres[i].w > 0.0) {
      vec3 d = spheres[i].xyz - vPosition;
      float square = dot(d, d), r = spheres[i].w;
      shadow *= 1.0 - 0.75 * clamp(dot(n, d) * inversesqrt(square), 0.0, 1.0) * min(1.0, r * r / square);
    }
    if (contacts[i].w > 0.0) {
      vec3 d = (contacts[i].xyz - vRest) / contactRadius;
      pale = max(pale, contacts[i].w * exp(-0.5 * dot(d, d)));
    }
  }
  base = mix(base, mix(base, vec3(0.66, 0.45, 0.36), 0.8), pale);
  float blood = smoothstep(0.45, 0.7, vSurface.y + 0.6 * (mottle - 0.5)), wet = mix(vSurface.z, 1.0, blood);
  base = mix(base, vec3(0.17, 0.006, 0.008), blood);
  float lambert = dot(n, light);
  vec3 wrap = 0.45 * base / max(base.r, max(base.g, base.b));
  vec3 diffuse = max((lambert + wrap) / (1.0 + wrap), 0.0);
  vec3 sky = vec3(0.3, 0.302, 0.324) + n.z * vec3(0.18, 0.178, 0.156);
  vec3 lit = base * shadow * (sky * open * open + 0.78 * diffuse * mix(1.0, open, 0.5));
  vec3 h = normalize(light + v);
  float facing = max(dot(n, h), 0.0);
#if LEVEL > 1
  const float a2 = 0.012; // roughness^4 of a film that follows the surface
  float nv = max(dot(n, v), 0.02), nl = max(lambert, 0.0), around = facing * facing * (a2 - 1.0) + 1.0;
  float distribution = a2 / (around * around), fresnel = 0.024 + 0.976 * pow(1.0 - max(dot(h, v), 0.0), 5.0);
  float gloss = fresnel * distribution * nl / (4.0 * max(nv, nl) + 0.1);
  float rim = 0.024 + 0.35 * pow(1.0 - nv, 5.0);
  vec3 mirrored = reflect(-v, n);
  float above = smoothstep(-0.2, 0.9, mirrored.z);
  lit += shadow * wet * open * (vec3(0.9 * min(gloss, 1.2)) + rim * (0.05 + 0.95 * above) * vec3(0.9, 0.95, 1.0));
#else
  lit += 0.09 * shadow * wet * pow(facing, 16.0);
#endif
  gl_FragColor = vec4(lit, opacity);
  #include <colorspace_fragment>
}`;

/** Material of the outer surface, as tissue; needs the attributes of `setSurfaceAttributes`. */
export class TissueMaterial extends ShaderMaterial {
  private readonly radius = { value: 1 };

  constructor() {
    const four = () => Array.from({ length: TOOLS }, () => new Vector4());
    super({
      vertexShader: VERTEX, fragmentShader: FRAGMENT, defines: { LEVEL: 3 },
      uniforms: {
        opacity: { value: 1 }, light: { value: LIGHT.clone() }, eye: { value: new Vector3() }, grainScale: { value: 1 }, noise: { value: noiseTexture() },
        spheres: { value: four() }, contacts: { value: four() }, contactRadius: { value: 1 },
      },
    });
    this.uniforms.contactRadius = this.radius;
  }

  /** 1 to 3: what is drawn. */
  set level(level: number) {
    if (this.defines.LEVEL === level) return;
    this.defines.LEVEL = level;
    this.needsUpdate = true;
  }

  /** size: radius of the organ, contact: of a tool's contact, mm. */
  setSizes(size: number, contact: number): void {
    this.uniforms.grainScale.value = 1 / (CELLS * GRAIN * size);
    this.radius.value = contact;
  }

  /** The shadow of a tool and the paleness under it. sphere: center and radius, mm, 0: none; point: at rest, mm; force: N. */
  setTool(tool: number, sphere: Vector4, point: Vector3, force: number): void {
    (this.uniforms.spheres.value as Vector4[])[tool].copy(sphere);
    const pressure = (1000 * force) / (Math.PI * this.radius.value ** 2); // kPa
    (this.uniforms.contacts.value as Vector4[])[tool].set(point.x, point.y, point.z, pressure / (pressure + FIRST_PALE));
  }

  followCamera(camera: Camera): void {
    this.uniforms.eye.value.setFromMatrixPosition(camera.matrixWorld);
    this.uniforms.light.value.copy(LIGHT).transformDirection(camera.matrixWorld);
  }

  set translucent(on: boolean) {
    this.transparent = on;
    this.uniforms.opacity.value = on ? 0.45 : 1;
    this.needsUpdate = true;
  }
}
