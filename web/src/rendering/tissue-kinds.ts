// What each kind of tissue looks like. The name of an organ chooses, and of nothing inside it: so a picture does not tell what is inside.
import { ORGAN_COLORS } from "../organ/color-map";
import type { Scene } from "../protocol/server-messages";

export interface TissueKind {
  name: string;
  /** sRGB, of moist tissue in white light. */
  color: number;
  /** 0 (dry) to 1 (a film of liquid all over). */
  wet: number;
  /** 0 (smooth) to 1. */
  grain: number;
}

const kind = (name: string, color: number, wet: number, grain: number): TissueKind => ({ name, color, wet, grain });
/** The first whose words are in the name: hepatic vein and perirenal fat come before liver and kidney. Colors are choices by eye. */
const KINDS: [RegExp, TissueKind][] = [
  [/vein|vena\b|portal/, kind("vein", 0x5c4a78, 0.8, 0.2)],
  [/arter|aorta|vessel/, kind("artery", 0xc0453c, 0.8, 0.2)],
  [/\bfat\b|adipos|omentum/, kind("fat", 0xe0bd67, 0.7, 0.9)],
  [/bone|skull|spine|vertebra|\bribs?\b|femur/, kind("bone", 0xe2d6ba, 0.25, 0.35)],
  [/cartilage|\bdisc\b/, kind("cartilage", 0xd6d8d2, 0.5, 0.15)],
  [/kidney|renal|\bren\b|niere/, kind("kidney", 0x8f3f38, 1, 0.55)],
  [/liver|hepat|leber/, kind("liver", 0x7d382c, 1, 0.4)],
  [/spleen|lien\b|milz/, kind("spleen", 0x6b2f3f, 1, 0.5)],
  [/lung|pulmo|lunge/, kind("lung", 0xd08f8d, 0.6, 1)],
  [/heart|cardi|myocard/, kind("heart", 0x96382f, 1, 0.6)],
  [/pancrea/, kind("pancreas", 0xd2a06c, 0.8, 1)],
  [/gall|bile/, kind("gallbladder", 0x6f8450, 1, 0.2)],
  [/stomach|gastr/, kind("stomach", 0xcf8a80, 1, 0.5)],
  [/bowel|colon|intestin|duoden|bladder|ureter|esophag|airway|trachea/, kind("hollow organ", 0xd6938a, 1, 0.4)],
  [/breast|mamma/, kind("breast", 0xd9a38a, 0.12, 0.35)],
  [/skin|hand|face|\bhead\b/, kind("skin", 0xd6a184, 0.12, 0.45)],
  [/brain|cerebr/, kind("brain", 0xd9aea6, 0.9, 0.5)],
  [/muscle|psoas/, kind("muscle", 0x8f302a, 0.7, 0.8)],
];
/** In the colors of the plain style. */
const UNKNOWN_COLOR = 0xc47c73;

/** The kind of tissue that a name tells, or one in the plain color. */
export function kindOf(name: string, plain = UNKNOWN_COLOR): TissueKind {
  const words = name.toLowerCase().replace(/[_\W]+/g, " ");
  return KINDS.find(([pattern]) => pattern.test(words))?.[1] ?? kind("", plain, 0.8, 0.5);
}

/** Of each organ of a scene. */
export const kindsOf = (scene: Scene): TissueKind[] =>
  scene.beside.length ? scene.beside.map((name, i) => kindOf(name, ORGAN_COLORS[i % ORGAN_COLORS.length])) : [kindOf(scene.title)];
