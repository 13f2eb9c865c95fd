// One color per take.

export const COLORS = [
  ...["#2f8f9d", "#e2694a", "#7a68c4", "#d99a2b", "#5c9452", "#c75c86", "#4a7fc1", "#8a7260"],
];

export function colorsOf(takes) {
  return takes.map((_, i) => COLORS[i % COLORS.length]);
}
