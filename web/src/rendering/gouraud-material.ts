// Gouraud shading (1971): lighting is computed at the nodes and interpolated. On a fine mesh it looks like shading at each
// pixel. It is kept cheap, since the processor may have to draw: the viewer counts as infinitely far away, and all
// directions are in world coordinates.
import { ShaderMaterial, Vector3, type Camera } from "three";

export const LIGHT = new Vector3(-0.5, 0.8, 1).normalize(); // in camera coordinates: above the left shoulder
const HALFWAY = LIGHT.clone().add(new Vector3(0, 0, 1)).normalize(); // between light and viewer (Blinn 1977)

// Lambert's law, hemisphere light, and a specular highlight with exponent 16.
const VERTEX = `
uniform vec3 light, halfway, eye;
uniform float inside;
varying vec3 shade;
void main() {
  float diffuse = max(dot(normal, light), 0.0), specular = max(dot(normal, halfway), 0.0);
  specular *= specular; specular *= specular; specular *= specular; specular *= specular;
  shade = color.rgb * (vec3(0.3, 0.302, 0.324) + normal.z * vec3(0.18, 0.178, 0.156) + 0.73 * diffuse) + 0.07 * specular;
  if (inside > 0.0) { // the light is at the eye, and fades with the square of the distance
    vec3 ray = eye - position;
    float distance = length(ray), lambert = max(dot(normal, ray) / distance, 0.0);
    float gloss = pow(lambert, 24.0);
    shade = (color.rgb * (0.1 + 1.15 * lambert) + 0.3 * gloss) / (1.0 + distance * distance / (16.0 * inside * inside));
  }
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(position, 1.0));
}`;
const FRAGMENT = `
uniform float opacity;
varying vec3 shade;
void main() {
  gl_FragColor = vec4(shade, opacity);
  #include <colorspace_fragment>
}`;

/** Material of the outer surface, colored by node. */
export class GouraudMaterial extends ShaderMaterial {
  constructor() {
    const uniforms = { opacity: { value: 1 }, light: { value: LIGHT.clone() }, halfway: { value: HALFWAY.clone() }, eye: { value: new Vector3() }, inside: { value: 0 } };
    super({ vertexShader: VERTEX, fragmentShader: FRAGMENT, vertexColors: true, uniforms });
  }

  /** mm, the size of what is seen from inside; 0 from outside. */
  get inside(): number {
    return this.uniforms.inside.value as number;
  }
  set inside(size: number) {
    this.uniforms.inside.value = size;
  }

  /** Moves the light with the camera. */
  followCamera(camera: Camera): void {
    this.uniforms.eye.value.setFromMatrixPosition(camera.matrixWorld);
    this.uniforms.light.value.copy(LIGHT).transformDirection(camera.matrixWorld);
    this.uniforms.halfway.value.copy(HALFWAY).transformDirection(camera.matrixWorld);
  }

  set translucent(on: boolean) {
    this.transparent = on;
    this.uniforms.opacity.value = on ? 0.45 : 1;
    this.needsUpdate = true;
  }
}
