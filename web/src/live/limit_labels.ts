/** Where the words of horizontal lines go, so that none stands on another or out of the plot: baselines in pixels, in the order
 *  of `lines` (from the top). Above its line, or below it where there is no room above. `text` is the height of a line of text. */
export function labelBaselines(lines: number[], top: number, text: number): number[] {
  const gap = text / 3, out = new Array<number>(lines.length);
  let taken = top;  // down to which words or lines stand
  for (const i of lines.map((_, k) => k).sort((a, b) => (lines[a] as number) - (lines[b] as number))) {
    const y = lines[i] as number, above = y - gap - text >= taken;
    out[i] = above ? y - gap : Math.max(y, taken) + text;
    taken = above ? y : (out[i] as number) + gap;
  }
  return out;
}
