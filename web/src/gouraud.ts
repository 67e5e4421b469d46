// Gouraud shading (1971): light is reckoned at the nodes and blended between them. On a mesh this fine it looks as light
// reckoned at each pixel does. Little is reckoned at a node either, since the processor may have to draw: the eye counts
// as far away, and all directions are the world's.
import { ShaderMaterial, Vector3, type Camera } from "three";

const SUN = new Vector3(-0.5, 0.8, 1).normalize(); // seen from the eye: a lamp over the left shoulder
const HALF = SUN.clone().add(new Vector3(0, 0, 1)).normalize(); // between the lamp and the eye (Blinn 1977)

// Lambert's law, a sky that is brighter above, and a highlight of power 16.
const VERTEX = `
uniform vec3 sun, between;
varying vec3 shade;
void main() {
  float lit = max(dot(normal, sun), 0.0), shine = max(dot(normal, between), 0.0);
  shine *= shine; shine *= shine; shine *= shine; shine *= shine;
  shade = color.rgb * (vec3(0.3, 0.302, 0.324) + normal.z * vec3(0.18, 0.178, 0.156) + 0.73 * lit) + 0.07 * shine;
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(position, 1.0));
}`;
const FRAGMENT = `
uniform float opacity;
varying vec3 shade;
void main() {
  gl_FragColor = vec4(shade, opacity);
  #include <colorspace_fragment>
}`;

/** Of the organ's skin, coloured node by node. */
export class Flesh extends ShaderMaterial {
  constructor() {
    const uniforms = { opacity: { value: 1 }, sun: { value: SUN.clone() }, between: { value: HALF.clone() } };
    super({ vertexShader: VERTEX, fragmentShader: FRAGMENT, vertexColors: true, uniforms });
  }

  /** The lamp goes with the eye. */
  light(eye: Camera): void {
    this.uniforms.sun.value.copy(SUN).transformDirection(eye.matrixWorld);
    this.uniforms.between.value.copy(HALF).transformDirection(eye.matrixWorld);
  }

  /** Lets what lies behind shine through. */
  set translucent(on: boolean) {
    this.transparent = on;
    this.uniforms.opacity.value = on ? 0.45 : 1;
    this.needsUpdate = true;
  }
}
