/** A long signal for a narrow screen: lowest, highest and mean of equal stretches of x, drawn as a band with its mean.
 *  Nothing is skipped: an outlier of one sample reaches the edge of the band. */

export interface Envelope {
  /** Middle of each stretch that holds a sample. */
  x: number[];
  low: number[];
  high: number[];
  mean: number[];
}

/** `x` increasing. A `y` that is null or no number is left out. */
export function envelope(
  x: ArrayLike<number>,
  y: ArrayLike<number | null>,
  stretches: number,
  range?: readonly [number, number],
): Envelope {
  const out: Envelope = { x: [], low: [], high: [], mean: [] };
  const n = Math.min(x.length, y.length);
  if (n === 0 || stretches < 1) return out;
  const from = range?.[0] ?? (x[0] as number);
  const to = range?.[1] ?? (x[n - 1] as number);
  const width = (to - from) / stretches || 1;
  let at = -1, count = 0, low = 0, high = 0, sum = 0;
  const close = () => {
    if (count === 0) return;
    out.x.push(from + (at + 0.5) * width);
    out.low.push(low);
    out.high.push(high);
    out.mean.push(sum / count);
  };
  for (let i = 0; i < n; ++i) {
    const t = x[i] as number, v = y[i];
    if (v === null || v === undefined || Number.isNaN(v) || t < from || t > to) continue;
    const stretch = Math.min(stretches - 1, Math.floor((t - from) / width));
    if (stretch !== at) {
      close();
      at = stretch;
      count = 0;
      sum = 0;
      low = high = v;
    }
    low = Math.min(low, v);
    high = Math.max(high, v);
    sum += v;
    ++count;
  }
  close();
  return out;
}

/** Index of the value of increasing `x` that is nearest to `at`; -1 of nothing. */
export function nearest(x: ArrayLike<number>, at: number): number {
  let low = 0, high = x.length - 1;
  if (high < 0) return -1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if ((x[middle] as number) < at) low = middle;
    else high = middle;
  }
  return Math.abs((x[low] as number) - at) <= Math.abs((x[high] as number) - at) ? low : high;
}
