/** What a figure is, as identify/report writes it into a report and as the live page may build it. */

export type Mark = "line" | "dashes" | "points" | "line-points" | "steps" | "band" | "bars";

/** null is a gap. A long signal comes as a band (lowest, highest) and a line (mean), never as chosen points. */
export interface Series {
  label?: string;
  mark: Mark;
  x: (number | null)[];
  y: (number | null)[];
  /** Of a band: the other edge. */
  y2?: (number | null)[];
  /** Bars of ± so much. */
  error?: (number | null)[];
  error_below?: (number | null)[];
  /** Of the palette, 0 to 7. */
  color: number;
  width?: number;
}

export interface Axis {
  name: string;
  unit?: string;
  log?: boolean;
  range?: [number, number];
  /** Names for 0, 1, 2 ... */
  categories?: string[];
}

export interface Panel {
  title?: string;
  x: Axis;
  y: Axis;
  series: Series[];
  verticals?: { at: number; label?: string }[];
  horizontals?: { at: number; label?: string }[];
  shaded?: { from: number; to: number; label?: string }[];
  /** Height over width of the drawing. */
  aspect?: number;
}

export interface Figure {
  name: string;
  caption: string;
  columns: number;
  panels: Panel[];
  /** Panels over one another share their abscissa: zooming into one zooms into all. */
  linked?: boolean;
}

export type Range = [number, number];

/** Of all finite values of an axis, with a margin; of a flat signal something round it. */
export function extent(panel: Panel, axis: "x" | "y", within?: Range): Range {
  const fixed = panel[axis].range;
  if (fixed && !within) return fixed;
  const log = panel[axis].log === true;
  let low = Infinity, high = -Infinity;
  const take = (v: number | null | undefined) => {
    if (v === null || v === undefined || !Number.isFinite(v) || (log && v <= 0)) return;
    low = Math.min(low, v);
    high = Math.max(high, v);
  };
  for (const s of panel.series) {
    const bars = s.mark === "bars";
    for (let i = 0; i < s.x.length; ++i) {
      const x = s.x[i];
      if (within && (x === null || x === undefined || x < within[0] || x > within[1])) continue;
      if (axis === "x") {
        take(x);
        continue;
      }
      const y = s.y[i], error = s.error?.[i] ?? 0, below = s.error_below?.[i] ?? error;
      if (y === null || y === undefined) continue;
      take(y - below);
      take(y + error);
      take(s.y2?.[i]);
      if (bars) take(0);
    }
  }
  if (axis === "x" && panel.x.categories) return [-0.5, panel.x.categories.length - 0.5];
  if (!(low <= high)) return log ? [0.1, 10] : [0, 1];
  if (log) return low === high ? [low / 2, high * 2] : [low, high];
  if (low === high) {
    const room = Math.abs(low) * 0.1 || 1;
    return [low - room, high + room];
  }
  // Points need room beside the frame; lines and bands fill it.
  const dots = panel.series.some((s) => s.mark === "points" || s.mark === "line-points");
  const margin = (axis === "y" ? 0.05 : dots ? 0.03 : 0) * (high - low);
  return [bars0(panel, axis) && low === 0 ? 0 : low - margin, high + margin];
}

function bars0(panel: Panel, axis: "x" | "y"): boolean {
  return axis === "y" && panel.series.some((s) => s.mark === "bars");
}
