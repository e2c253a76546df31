import { number } from "../shared/format.ts";

/** How late the loop woke up: of each hundredth of a second the latest tick, by powers of two of a microsecond
 *  (Lateness, webserver/rules/history.hpp). Bin 0 is below 1 µs, bin k from 2^(k-1) to 2^k µs, the last one all above. */

const timeText = (us: number) => (us < 1000 ? `${us} µs` : `${number(us / 1000, 3)} ms`);

/** The first bin that lies beyond 1 ms as a whole. */
export const LATE_BIN = 11;

/** Where a bin ends: "below 4.1 ms", "over 65.5 ms" for the last one. */
export function binText(bins: number[], k: number): string {
  return k === bins.length - 1 ? `over ${timeText(2 ** (k - 1))}` : `below ${timeText(2 ** k)}`;
}

/** How late `part` of what is counted was at most, as far as the bins tell. */
export function lateBy(bins: number[], part: number): string {
  const all = bins.reduce((a, b) => a + b, 0);
  let sum = 0;
  for (let k = 0; k < bins.length; ++k) {
    sum += bins[k] as number;
    if (sum >= part * all) return binText(bins, k);
  }
  return "–";
}

export function latenessText(bins: number[]): string {
  return `latest tick of each 10 ms, over 10 min: in 99 % ${lateBy(bins, 0.99)} late, in all ${lateBy(bins, 1)}`;
}

/** On a logarithmic height, so that one late tick is seen. */
export function Lateness({ bins }: { bins: number[] }) {
  const all = bins.reduce((a, b) => a + b, 0);
  if (all === 0) return null;
  const width = 100 / bins.length, top = Math.log1p(all), text = latenessText(bins);
  return (
    <figure class="lateness">
      <svg viewBox="0 0 100 24" preserveAspectRatio="none" role="img" aria-label={text}>
        {bins.map((n, k) => n > 0 && (
          <rect key={k} class={k >= LATE_BIN ? "late" : ""} x={k * width + 0.4} width={width - 0.8} y={24 - (22 * Math.log1p(n)) / top} height={(22 * Math.log1p(n)) / top}>
            <title>{`${n} × 10 ms ${binText(bins, k)}`}</title>
          </rect>
        ))}
      </svg>
      <figcaption>{text}</figcaption>
    </figure>
  );
}
