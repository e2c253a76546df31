import uPlot from "uplot";
import { paletteColor } from "../shared/strip.ts";
import { labelBaselines } from "./limit_labels.ts";
import type { Event, Model } from "./model.ts";
import { grid, STREAMS, type Grid, type StretchRing } from "./stretches.ts";

/** The plots over time and force over length, drawn from the rings. Canvas: a band from lowest to highest with the mean
 *  as a line; limits, events and gaps as they are. */

interface Signal {
  label: string;
  stream: number;
  channel: number;
  color: number;
  /** What was asked for: dashed, without a band. */
  target?: boolean;
  /** From the lowest of this channel to the highest of the next one, without a line. */
  band?: boolean;
}

interface Panel {
  title: string;
  signals: Signal[];
  /** Least height of the scale, so that noise does not fill the plot. */
  span: number;
  limits: (model: Model) => { at: number; text: string }[];
  /** Shown while there is a twin. */
  twin?: boolean;
}

export const PANELS: Panel[] = [
  {
    title: "force (N)", span: 0.5,
    signals: [
      { label: "twin, 95 %", stream: STREAMS.band, channel: 0, color: 1, band: true },
      { label: "force", stream: STREAMS.frame, channel: 1, color: 0 },
      { label: "twin", stream: STREAMS.twin, channel: 0, color: 1, target: true },
    ],
    limits: (m) => m.plan ? [
      { at: m.plan.limits.force_max_N, text: "limit" }, { at: m.plan.limits.force_min_N, text: "limit" }] : [],
  },
  {
    title: "measured minus twin (standard errors)", span: 8, twin: true,
    signals: [{ label: "residual", stream: STREAMS.twin, channel: 1, color: 3 }],
    limits: (m) => (m.web?.twin.band ? [{ at: 1.96, text: "95 %" }, { at: -1.96, text: "95 %" }] : []),
  },
  {
    title: "position (mm)", span: 0.1,
    signals: [
      { label: "position", stream: STREAMS.frame, channel: 0, color: 2 },
      { label: "target", stream: STREAMS.control, channel: 0, color: 7, target: true },
    ],
    limits: (m) => m.plan ? [
      { at: m.plan.limits.travel_max_mm, text: "limit" }, { at: m.plan.limits.travel_min_mm, text: "limit" }] : [],
  },
  {
    title: "pressure (psi)", span: 0.2,
    signals: [
      { label: "pressure", stream: STREAMS.pressure, channel: 0, color: 1 },
      { label: "set-point", stream: STREAMS.control, channel: 1, color: 7, target: true },
    ],
    limits: (m) => (m.plan ? [{ at: m.plan.limits.pressure_max_psi, text: "limit" }] : []),
  },
];

const ink = (name: string) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const SIGNS: Record<string, string> = { warning: "!", "program stop": "✕", "safe state": "✕" };
/** Events that every step has would hide all others. */
const EVERY_STEP = new Set(["step"]);

const LABEL_ROWS = 4;

/** What a window shows: which rings, and which of their stretches. */
export interface Window {
  rings: StretchRing[];
  grid: Grid;
  width_ns: number;
  from_ns: number;
  to_ns: number;
}

export function windowOf(model: Model, span_s: number, pixels: number): Window | null {
  const h = model.hello;
  if (h === null || model.fine.length === 0) return null;
  const coarse = span_s * 1e9 > h.fine_kept_ns;
  const rings = coarse ? model.coarse : model.fine, width_ns = coarse ? h.coarse_ns : h.fine_ns;
  const to_ns = model.newest_ns(), from_ns = to_ns - span_s * 1e9;
  return { rings, width_ns, from_ns, to_ns, grid: grid(from_ns, to_ns, width_ns, pixels) };
}

/** Columns for uPlot: time, then of each signal the mean, or low, high and mean. */
export function columnsOf(model: Model, panel: Panel, w: Window): (number | null)[][] {
  const step = w.grid.join * w.width_ns;
  const columns: (number | null)[][] = [
    Array.from({ length: w.grid.count }, (_, k) => model.unix_s((w.grid.first + k + 0.5) * step)),
  ];
  for (const s of panel.signals) {
    const r = (w.rings[s.stream] as StretchRing).reduce(s.channel, w.grid);
    if (s.band) columns.push(r.low, (w.rings[s.stream] as StretchRing).reduce(s.channel + 1, w.grid).high);
    else if (s.target) columns.push(r.mean);
    else columns.push(r.low, r.high, r.mean);
  }
  return columns;
}

/** From the lowest to the highest value shown, at least `span`, with a margin. */
function scaleOf(columns: (number | null)[][], span: number): [number, number] {
  let low = Infinity, high = -Infinity;
  for (const column of columns.slice(1))
    for (const v of column) {
      if (v === null) continue;
      low = Math.min(low, v);
      high = Math.max(high, v);
    }
  if (low > high) return [0, span];
  const middle = (low + high) / 2, half = Math.max(span, (high - low) * 1.12) / 2;
  return [middle - half, middle + half];
}

function drawLimits(u: uPlot, limits: { at: number; text: string }[]): void {
  const { ctx, bbox } = u;
  const [low, high] = [u.scales["y"]?.min ?? 0, u.scales["y"]?.max ?? 1];
  const dpr = devicePixelRatio;
  ctx.save();
  ctx.strokeStyle = ctx.fillStyle = ink("bad");
  ctx.textAlign = "left";
  ctx.font = `${11 * dpr}px ${ink("sans")}`;
  const inside = limits.filter(({ at }) => at >= low && at <= high);
  const words_y = labelBaselines(inside.map(({ at }) => u.valToPos(at, "y", true)), bbox.top, 12 * dpr);
  for (const limit of limits) {
    const { at, text } = limit, left = bbox.left + 4 * dpr, k = inside.indexOf(limit);
    if (k >= 0) {
      const y = u.valToPos(at, "y", true);
      ctx.lineWidth = 2 * dpr;
      ctx.setLineDash([8 * dpr, 4 * dpr]);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.fillText(`${text} ${at}`, left, words_y[k] as number);
    } else {
      // Off the scale: said at the edge towards which it lies, on a ground of its own over what is drawn there.
      const words = `${at > high ? "↑" : "↓"} ${text} ${at}`, y = at > high ? bbox.top + 12 * dpr : bbox.top + bbox.height - 5 * dpr;
      ctx.fillStyle = ink("panel");
      ctx.globalAlpha = 0.7;  // what lies under it stays seen
      ctx.fillRect(left - 2 * dpr, y - 10 * dpr, ctx.measureText(words).width + 4 * dpr, 13 * dpr);
      ctx.globalAlpha = 1;
      ctx.fillStyle = ink("bad");
      ctx.fillText(words, left, y);
    }
  }
  ctx.restore();
}

function drawEvents(u: uPlot, events: Event[], unix_s: (ns: number) => number, signs: boolean): void {
  const { ctx, bbox } = u;
  const [from, to] = [u.scales["x"]?.min ?? 0, u.scales["x"]?.max ?? 0];
  const dpr = devicePixelRatio;
  ctx.save();
  ctx.font = `${11 * dpr}px ${ink("sans")}`;
  const rows = new Array<number>(LABEL_ROWS).fill(-Infinity);  // where the last label of each row ends
  for (const e of events) {
    const t = unix_s(e.mono_ns);
    if (t < from || t > to || EVERY_STEP.has(e.code)) continue;
    const serious = e.severity !== "info";
    ctx.strokeStyle = ctx.fillStyle = serious ? ink("bad") : ink("muted");
    ctx.lineWidth = (serious ? 2 : 1) * dpr;
    ctx.setLineDash(serious ? [] : [3 * dpr, 3 * dpr]);
    const x = u.valToPos(t, "x", true);
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    if (!signs) continue;
    const label = `${SIGNS[e.severity] ?? ""} ${e.code}`.trim();
    const width = ctx.measureText(label).width + 8 * dpr;
    const row = rows.findIndex((end) => end < x);
    if (row < 0) continue;  // the list of events has it
    rows[row] = x + width;
    const right = x + width > bbox.left + bbox.width;
    ctx.textAlign = right ? "right" : "left";
    ctx.fillText(label, x + (right ? -3 : 3) * dpr, bbox.top + (11 + 13 * row) * dpr);
  }
  ctx.restore();
}

const axis = (): uPlot.Axis => ({
  stroke: () => ink("muted"), grid: { stroke: () => ink("grid"), width: 1 }, ticks: { stroke: () => ink("grid"), width: 1 },
  font: `12px ${ink("sans")}`,
});

/** "21:25:15", with tenths or hundredths where the ticks are closer than a second. */
function tickTime(unix_s: number, step_s: number): string {
  const time = new Date(unix_s * 1000).toLocaleTimeString("en-GB");
  if (step_s >= 1) return time;
  const digits = step_s >= 0.1 ? 1 : step_s >= 0.01 ? 2 : 3;
  return time + (unix_s - Math.floor(unix_s)).toFixed(digits).slice(1);
}

/** One plot over time; `zoomed` is called with two times (Unix s) when a stretch of it was marked with the mouse. */
export class TimePlot {
  readonly plot: uPlot;

  constructor(readonly element: HTMLElement, readonly model: Model, readonly panel: Panel, first: boolean, last: boolean,
    zoomed: (from_s: number, to_s: number) => void) {
    const series: uPlot.Series[] = [{}];
    const bands: uPlot.Band[] = [];
    for (const s of panel.signals) {
      const stroke = () => paletteColor(s.color);
      if (s.target) {
        series.push({ label: s.label, stroke, width: 1.5, dash: [6, 4], spanGaps: true, points: { show: false }, paths: uPlot.paths.stepped?.({ align: 1 }) });
        continue;
      }
      const at = series.length;
      if (s.band) {
        series.push({ label: `${s.label}, from`, stroke, width: 1, points: { show: false } }, { label: `${s.label}, to`, stroke, width: 1, points: { show: false } });
        bands.push({ series: [at + 1, at], fill: () => paletteColor(s.color) + "40" });
        continue;
      }
      series.push(
        { label: `${s.label}, lowest`, stroke, width: 0.5, points: { show: false } },
        { label: `${s.label}, highest`, stroke, width: 0.5, points: { show: false } },
        { label: s.label, stroke, width: 1.5, points: { show: false } });
      bands.push({ series: [at + 1, at], fill: () => paletteColor(s.color) + "3d" });
    }
    this.plot = new uPlot({
      width: Math.max(200, element.clientWidth), height: Math.max(90, element.clientHeight), legend: { show: false }, series, bands,
      cursor: { drag: { x: true, y: false, setScale: false }, sync: { key: "live" }, points: { show: false } },
      scales: { x: { time: true }, y: {} },
      axes: [last ? { ...axis(), values: (_, splits, __, ___, step) => splits.map((t) => tickTime(t, step)) } : { ...axis(), values: (_, splits) => splits.map(() => ""), size: 2 }, { ...axis(), size: 60 }],
      padding: [6, 8, last ? 0 : 6, 0],
      hooks: { draw: [(u) => {
        drawEvents(u, model.events, (ns) => model.unix_s(ns), first);
        drawLimits(u, panel.limits(model));
      }], setSelect: [(u) => {
        // A mark is in all plots, also in one that is hidden, which has no scale.
        if (u.select.width < 4 || element.clientHeight === 0) return;
        zoomed(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
        u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      }] },
    }, [[], ...series.slice(1).map(() => [])] as unknown as uPlot.AlignedData, element);
    new ResizeObserver(() => this.plot.setSize({ width: Math.max(200, element.clientWidth), height: Math.max(90, element.clientHeight) }))
      .observe(element);
  }

  draw(w: Window): void {
    const columns = columnsOf(this.model, this.panel, w);
    const [low, high] = scaleOf(columns, this.panel.span);
    this.plot.batch(() => {
      this.plot.setData(columns as unknown as uPlot.AlignedData, false);
      this.plot.setScale("x", { min: this.model.unix_s(w.from_ns), max: this.model.unix_s(w.to_ns) });
      this.plot.setScale("y", { min: low, max: high });
    });
  }
}

/** Force over length: each stretch as the rectangle that its samples lie in, the means joined. */
export class LoopPlot {
  readonly plot: uPlot;
  private window: Window | null = null;

  constructor(readonly element: HTMLElement, readonly model: Model) {
    this.plot = new uPlot({
      width: Math.max(160, element.clientWidth), height: Math.max(160, element.clientHeight), legend: { show: false },
      series: [{}, { show: true, points: { show: false } }],
      cursor: { show: false }, scales: { x: { time: false }, y: {} },
      axes: [{ ...axis(), label: "position (mm)", labelSize: 18, labelFont: `12px ${ink("sans")}` },
        { ...axis(), label: "force (N)", labelSize: 18, labelFont: `12px ${ink("sans")}`, size: 48 }],
      hooks: { draw: [(u) => this.paint(u)] },
    }, [[], []] as unknown as uPlot.AlignedData, element);
    new ResizeObserver(() => this.plot.setSize({ width: Math.max(160, element.clientWidth), height: Math.max(160, element.clientHeight) }))
      .observe(element);
  }

  draw(w: Window): void {
    this.window = w;
    const ring = w.rings[STREAMS.frame] as StretchRing;
    const x = ring.reduce(0, w.grid), y = ring.reduce(1, w.grid);
    const [x0, x1] = scaleOf([[], x.low, x.high], 0.2), [y0, y1] = scaleOf([[], y.low, y.high], 0.5);
    this.plot.batch(() => {
      this.plot.setData([[x0, x1], [null, null]] as unknown as uPlot.AlignedData, false);
      this.plot.setScale("x", { min: x0, max: x1 });
      this.plot.setScale("y", { min: y0, max: y1 });
    });
  }

  private paint(u: uPlot): void {
    const w = this.window;
    if (w === null) return;
    const ring = w.rings[STREAMS.frame] as StretchRing;
    const x = ring.reduce(0, w.grid), y = ring.reduce(1, w.grid);
    const { ctx, bbox } = u;
    const dpr = devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.fillStyle = paletteColor(0) + "3d";
    ctx.strokeStyle = paletteColor(0);
    ctx.lineWidth = 1.5 * dpr;
    ctx.lineJoin = "round";
    ctx.beginPath();
    let open = false;
    let last: [number, number] | null = null;
    for (let k = 0; k < w.grid.count; ++k) {
      const [xl, xh, xm] = [x.low[k], x.high[k], x.mean[k]], [yl, yh, ym] = [y.low[k], y.high[k], y.mean[k]];
      if (xm == null || ym == null) {
        open = false;
        continue;
      }
      const left = u.valToPos(xl as number, "x", true), right = u.valToPos(xh as number, "x", true);
      const top = u.valToPos(yh as number, "y", true), bottom = u.valToPos(yl as number, "y", true);
      // The line through the mean covers a rectangle that is no wider and no higher than it.
      if (right - left > ctx.lineWidth || bottom - top > ctx.lineWidth) {
        ctx.fillRect(left, top, Math.max(dpr, right - left), Math.max(dpr, bottom - top));
      }
      const next: [number, number] = [u.valToPos(xm, "x", true), u.valToPos(ym, "y", true)];
      // A rig at rest stays in its pixel.
      if (open && last !== null && Math.abs(next[0] - last[0]) < 0.25 * dpr && Math.abs(next[1] - last[1]) < 0.25 * dpr) continue;
      last = next;
      if (open) ctx.lineTo(...last);
      else ctx.moveTo(...last);
      open = true;
    }
    ctx.stroke();
    if (last !== null) {
      ctx.beginPath();
      ctx.arc(...last, 5 * dpr, 0, 2 * Math.PI);
      ctx.fillStyle = ink("ground");
      ctx.fill();
      ctx.lineWidth = 2.5 * dpr;
      ctx.stroke();
    }
    ctx.restore();
  }
}
