// The color of each person in a room: dark enough for white letters, and far from that of tissue.
const COLORS = [0x1d4ed8, 0x7e22ce, 0x15803d, 0xa16207, 0x0f766e, 0xbe185d, 0x4338ca, 0x4d7c0f];

export const personColor = (person: number): number => COLORS[(person - 1) % COLORS.length];
export const personCss = (person: number): string => `#${personColor(person).toString(16).padStart(6, "0")}`;
