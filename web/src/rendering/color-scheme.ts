// Light or dark: what the system says, or the notebook that shows the page in a frame.
const QUERY = "(prefers-color-scheme: dark)";
const root = document.documentElement;
const listeners: (() => void)[] = [];

/** Calls back after each change. */
export function onColorScheme(heard: () => void): void {
  listeners.push(heard);
  matchMedia(QUERY).addEventListener("change", heard);
}

/** Overrules the system: the style sheets' rules for dark pages hold always, or never. */
export function setDark(dark: boolean): void {
  root.style.colorScheme = dark ? "dark" : "light";
  for (const rule of [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules]))
    if (rule instanceof CSSMediaRule && [QUERY, "all", "not all"].includes(rule.media.mediaText)) rule.media.mediaText = dark ? "all" : "not all";
  for (const heard of listeners) heard();
}

if (root.dataset.dark) setDark(root.dataset.dark === "true");
