import uPlot from "uplot";
import type { Envelope } from "./envelope.ts";

/** A signal that grows while it is looked at, on a canvas (reports draw SVG: chart.tsx): lowest to highest as a band, the
 *  mean as a line. */

export interface StripSignal {
  label: string;
  /** Of the palette, 0 to 7. */
  color: number;
  envelope: Envelope;
}

/** The palette as the style sheet has it now, for a canvas, which knows no variables. */
export function paletteColor(index: number): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--series-${((index % 8) + 8) % 8}`).trim();
}

/** Columns for uPlot: one abscissa for all signals, then low, high and mean of each; null where one has no stretch. */
export function stripData(signals: readonly StripSignal[]): (number | null)[][] {
  const times = [...new Set(signals.flatMap((s) => s.envelope.x))].sort((a, b) => a - b);
  const index = new Map(times.map((t, i) => [t, i]));
  const columns: (number | null)[][] = [times];
  for (const { envelope: e } of signals)
    for (const values of [e.low, e.high, e.mean]) {
      const column: (number | null)[] = new Array<number | null>(times.length).fill(null);
      e.x.forEach((t, i) => (column[index.get(t) as number] = values[i] ?? null));
      columns.push(column);
    }
  return columns;
}

/** Series and bands for uPlot that belong to stripData(): edges without a line of their own, the band between them. */
export function stripSeries(signals: readonly StripSignal[]): Pick<uPlot.Options, "series" | "bands"> {
  const series: uPlot.Series[] = [{}];
  const bands: uPlot.Band[] = [];
  for (const s of signals) {
    const stroke = () => paletteColor(s.color), first = series.length;
    series.push(
      { label: `${s.label}, lowest`, stroke, width: 0.5, points: { show: false } },
      { label: `${s.label}, highest`, stroke, width: 0.5, points: { show: false } },
      { label: s.label, stroke, width: 1.5, points: { show: false } },
    );
    bands.push({ series: [first + 1, first], fill: () => paletteColor(s.color) + "3d" });
  }
  return { series, bands };
}

/** A plot in `element`; give it new data with set(). */
export function strip(element: HTMLElement, signals: readonly StripSignal[], options: Partial<uPlot.Options>) {
  const plot = new uPlot(
    { width: element.clientWidth, height: 200, legend: { show: false }, ...options, ...stripSeries(signals) } as uPlot.Options,
    stripData(signals) as unknown as uPlot.AlignedData,
    element,
  );
  const followed = new ResizeObserver(() => plot.setSize({ width: element.clientWidth, height: plot.height }));
  followed.observe(element);
  return {
    plot,
    set(now: readonly StripSignal[]) {
      plot.setData(stripData(now) as unknown as uPlot.AlignedData);
    },
    destroy() {
      followed.disconnect();
      plot.destroy();
    },
  };
}
