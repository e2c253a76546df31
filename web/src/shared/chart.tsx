import { scaleLinear, scaleLog } from "d3-scale";
import { area, line, curveStepAfter } from "d3-shape";
import { useEffect, useRef, useState } from "preact/hooks";
import type { JSX } from "preact";
import { nearest } from "./envelope.ts";
import { extent, type Panel, type Range, type Series } from "./figure.ts";
import { axisLabel, number } from "./format.ts";

/** One panel as SVG: vector on paper, text that can be selected, colours that follow the theme. Drag to zoom, double click
 *  or Escape for all of it; with the keyboard + and - zoom, the arrows move. */

export const colour = (index: number) => `var(--series-${((index % 8) + 8) % 8})`;

type Scale = ReturnType<typeof scaleLinear<number>> | ReturnType<typeof scaleLog<number>>;

function scaleOf(log: boolean | undefined, domain: Range, range: Range): Scale {
  return log ? scaleLog(domain, range) : scaleLinear(domain, range);
}

interface Tick {
  at: number;
  text: string;
}

function ticksOf(scale: Scale, log: boolean | undefined, count: number): Tick[] {
  if (log) {
    const [from, to] = scale.domain() as [number, number];
    const decades = Math.log10(to / from);
    const values = scale.ticks(count);
    const powers = values.filter((v) => Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-9);
    const shown = decades > 1.2 && powers.length >= 2 ? powers : values;
    const every = Math.ceil(shown.length / Math.max(2, count));
    return shown.filter((_, i) => i % every === 0).map((at) => ({ at, text: number(at, 2) }));
  }
  const format = (scale as ReturnType<typeof scaleLinear<number>>).tickFormat(count);
  const values = scale.ticks(count);
  const largest = Math.max(...values.map(Math.abs), 0);
  const tiny = largest > 0 && (largest < 1e-3 || largest >= 1e6);
  return values.map((at) => ({ at, text: tiny ? number(Math.abs(at) < largest * 1e-9 ? 0 : at, 3) : format(at) }));
}

/** A category's name in lines of at most so many characters; one word may be longer. */
export function wrapped(text: string, most: number): string[] {
  const lines: string[] = [];
  for (const word of text.split(" ")) {
    const last = lines.length - 1, line = lines[last];
    if (line !== undefined && line.length + 1 + word.length <= most) lines[last] = `${line} ${word}`;
    else lines.push(word);
  }
  return lines;
}

interface Props {
  panel: Panel;
  /** Of the ordinate's numbers, at least: panels over one another begin at one abscissa. */
  characters?: number;
  /** In CSS pixels, of the drawing's own coordinates. */
  width: number;
  height: number;
  name: string;
  zoom?: Range | null;
  onZoom?: (range: Range | null) => void;
  /** Shown at the pointer, of all panels of a figure. */
  cursor?: number | null;
  onCursor?: (x: number | null) => void;
}

export function Chart({ panel, characters = 2, width, height, name, zoom, onZoom, cursor, onCursor }: Props): JSX.Element {
  const box = useRef<SVGSVGElement>(null);
  const [brush, setBrush] = useState<Range | null>(null);
  const whole = extent(panel, "x");
  const xRange = zoom ?? whole;
  const yRange = zoom && !panel.y.range ? extent(panel, "y", zoom) : extent(panel, "y");
  const yTicks = ticksOf(scaleOf(panel.y.log, yRange, [1, 0]), panel.y.log, Math.max(3, Math.round(height / 45)));
  const longest = Math.max(characters, ...yTicks.map((t) => t.text.length));
  const categories = panel.x.categories;
  const left = 26 + 7 * Math.min(longest, 10), right = 12, top = panel.title ? 24 : 10;
  const perName = Math.floor((width - left - right) / Math.max(1, categories?.length ?? 1) / 6.6);
  const names = (categories ?? []).map((c) => wrapped(c, perName));
  const slanted = names.some((lines) => lines.some((line) => line.length > perName));
  const longestCategory = Math.max(0, ...(categories ?? []).map((c) => c.length));
  const bottom = (panel.x.name ? 40 : 24) +
    (slanted ? Math.min(110, longestCategory * 4.2) : 14 * Math.max(0, ...names.map((lines) => lines.length - 1)));
  const x = scaleOf(panel.x.log, xRange, [left, width - right]);
  const y = scaleOf(panel.y.log, yRange, [height - bottom, top]);
  const xTicks: Tick[] = categories
    ? categories.map((text, at) => ({ at, text }))
    : ticksOf(x, panel.x.log, Math.max(2, Math.round((width - left - right) / 85)));
  const clip = `clip-${name.replace(/[^A-Za-z0-9_-]/g, "_")}`;
  const inside = (v: number) => Math.min(width - right, Math.max(left, v));

  const at = (event: PointerEvent): number => {
    const r = (box.current as SVGSVGElement).getBoundingClientRect();
    return x.invert(inside(((event.clientX - r.left) * width) / r.width));
  };
  const zoomable = onZoom !== undefined && !categories;
  const begin = useRef<number | null>(null);
  const down = (event: PointerEvent) => {
    if (!zoomable || event.button !== 0 || event.pointerType === "touch") return;
    begin.current = at(event);
    box.current?.setPointerCapture(event.pointerId);
  };
  const move = (event: PointerEvent) => {
    const v = at(event);
    onCursor?.(v);
    if (begin.current !== null) setBrush([Math.min(begin.current, v), Math.max(begin.current, v)]);
  };
  const up = () => {
    if (brush && Math.abs(x(brush[1]) - x(brush[0])) > 6) onZoom?.(brush);
    begin.current = null;
    setBrush(null);
  };
  const keys = (event: KeyboardEvent) => {
    if (!zoomable || panel.x.log) return;
    const [from, to] = xRange, span = to - from;
    const go = (a: number, b: number) => {
      onZoom?.(b - a >= whole[1] - whole[0] ? null : [a, b]);
      event.preventDefault();
    };
    if (event.key === "+" || event.key === "=") go(from + span / 4, to - span / 4);
    else if (event.key === "-") go(from - span / 2, to + span / 2);
    else if (event.key === "ArrowLeft") go(from - span / 5, to - span / 5);
    else if (event.key === "ArrowRight") go(from + span / 5, to + span / 5);
    else if (event.key === "Escape" || event.key === "0") onZoom?.(null);
  };

  const label = [panel.title, `${panel.y.name} over ${panel.x.name}`].filter(Boolean).join(": ");
  return (
    <svg ref={box} class="chart" viewBox={`0 0 ${width} ${height}`} role="img" aria-label={label}
      tabindex={zoomable ? 0 : undefined} onPointerDown={down} onPointerMove={move} onPointerUp={up}
      onPointerLeave={() => onCursor?.(null)} onDblClick={() => onZoom?.(null)} onKeyDown={keys}>
      <defs>
        <clipPath id={clip}>
          <rect x={left} y={top} width={width - left - right} height={height - top - bottom} />
        </clipPath>
      </defs>
      {panel.title && <text class="title" x={left} y={15}>{panel.title}</text>}
      {yTicks.map((t) => <line key={`y${t.at}`} class="grid" x1={left} x2={width - right} y1={y(t.at)} y2={y(t.at)} />)}
      {!categories && xTicks.map((t) => <line key={`x${t.at}`} class="grid" x1={x(t.at)} x2={x(t.at)} y1={top} y2={height - bottom} />)}
      <g clip-path={`url(#${clip})`}>
        {panel.shaded?.map((s) => (
          <rect class="shaded" x={x(s.from)} y={top} width={Math.max(1.5, x(s.to) - x(s.from))} height={height - top - bottom} />
        ))}
        {!panel.y.log && yRange[0] < 0 && yRange[1] > 0 && <line class="zero" x1={left} x2={width - right} y1={y(0)} y2={y(0)} />}
        {panel.series.map((s, i) => <Marks key={i} series={s} x={x} y={y} of={panel.series} />)}
        {panel.horizontals?.map((h) => <line class="vertical" x1={left} x2={width - right} y1={y(h.at)} y2={y(h.at)} />)}
        {panel.verticals?.map((v) => <line class="vertical" x1={x(v.at)} x2={x(v.at)} y1={top} y2={height - bottom} />)}
        {cursor !== null && cursor !== undefined && <line class="cursor" x1={x(cursor)} x2={x(cursor)} y1={top} y2={height - bottom} />}
        {brush && <rect class="brush" x={x(brush[0])} y={top} width={x(brush[1]) - x(brush[0])} height={height - top - bottom} />}
      </g>
      <VerticalLabels panel={panel} x={x} range={xRange} top={top} right={width - right} />
      {panel.horizontals?.filter((h) => h.label).map((h) => (
        <text x={width - right - 3} y={y(h.at) - 4} text-anchor="end">{h.label}</text>
      ))}
      <line class="axis" x1={left} x2={left} y1={top} y2={height - bottom} />
      <line class="axis" x1={left} x2={width - right} y1={height - bottom} y2={height - bottom} />
      {yTicks.map((t) => <text key={t.at} x={left - 6} y={y(t.at)} dy="0.32em" text-anchor="end">{t.text}</text>)}
      {xTicks.map((t) =>
        slanted ? (
          <text key={t.at} text-anchor="end" transform={`translate(${x(t.at) + 3} ${height - bottom + 14}) rotate(-32)`}>{t.text}</text>
        ) : (
          <text key={t.at} x={x(t.at)} y={height - bottom + 16} text-anchor="middle">
            {categories ? names[t.at]?.map((line, k) => <tspan key={k} x={x(t.at)} dy={k === 0 ? 0 : 14}>{line}</tspan>) : t.text}
          </text>
        ))}
      {panel.x.name && <text x={(left + width - right) / 2} y={height - 6} text-anchor="middle">{axisLabel(panel.x.name, panel.x.unit ?? "")}</text>}
      {panel.y.name && (
        <text transform={`translate(13 ${(top + height - bottom) / 2}) rotate(-90)`} text-anchor="middle">{axisLabel(panel.y.name, panel.y.unit ?? "")}</text>
      )}
    </svg>
  );
}

/** Names of vertical lines on rows of their own where they would run into each other. */
function VerticalLabels({ panel, x, range, top, right }: { panel: Panel; x: Scale; range: Range; top: number; right: number }) {
  const ends: number[] = [];
  return (
    <>
      {[...(panel.verticals ?? [])].filter((v) => v.label && v.at >= range[0] && v.at <= range[1])
        .sort((a, b) => a.at - b.at)
        .map((v) => {
          const text = v.label as string, wide = text.length * 6.4;
          const flip = x(v.at) + wide + 6 > right;
          const from = flip ? x(v.at) - wide - 4 : x(v.at) + 4;
          let row = ends.findIndex((end) => end < from);
          if (row < 0) row = ends.push(0) - 1;
          ends[row] = from + wide;
          return row < 4 ? <text x={from} y={top + 12 + 14 * row}>{text}</text> : null;
        })}
    </>
  );
}

function Marks({ series: s, x, y, of }: { series: Series; x: Scale; y: Scale; of: Series[] }): JSX.Element | null {
  const stroke = colour(s.color);
  const log = y.domain()[0] as number > 0 && "base" in y;
  const good = (v: number | null | undefined): v is number => v !== null && v !== undefined && Number.isFinite(v) && (!log || v > 0);
  const index = s.x.map((_, i) => i);
  const defined = (i: number) => good(s.y[i]) && s.x[i] !== null && Number.isFinite(s.x[i]);
  const px = (i: number) => x(s.x[i] as number), py = (i: number) => y(s.y[i] as number);
  const path = (curve?: typeof curveStepAfter) => {
    const made = line<number>().defined(defined).x(px).y(py);
    if (curve) made.curve(curve);
    return made(index) ?? "";
  };
  const bars = s.error && index.filter(defined).map((i) => {
    const e = s.error?.[i], below = s.error_below?.[i] ?? e;
    if (!good(e ?? null) || !good(below ?? null) || !(e || below)) return null;
    const v = s.y[i] as number, end = v - (below as number), low = log ? Math.max(end, (y.domain()[0] as number) / 10) : end;
    return <path key={i} d={`M${px(i)} ${y(low)}V${y(v + (e as number))}M${px(i) - 3} ${y(low)}h6M${px(i) - 3} ${y(v + (e as number))}h6`} stroke={stroke} fill="none" />;
  });
  const points = () => index.filter(defined).map((i) => <circle key={i} cx={px(i)} cy={py(i)} r={s.width ?? 2.6} fill={stroke} />);
  const width = s.width ?? 1.6;
  switch (s.mark) {
    case "band": {
      const made = area<number>().defined((i) => defined(i) && good(s.y2?.[i])).x(px).y0((i) => y(s.y2?.[i] as number)).y1(py);
      return <path d={made(index) ?? ""} fill={stroke} stroke={stroke} stroke-width={0.6} stroke-opacity={0.35} fill-opacity="var(--band-opacity)" />;
    }
    case "steps":
      return <path d={path(curveStepAfter)} fill="none" stroke={stroke} stroke-width={width} />;
    case "points":
      return <g>{bars}{points()}</g>;
    case "line-points":
      return <g><path d={path()} fill="none" stroke={stroke} stroke-width={1} stroke-dasharray="4 3" stroke-opacity={0.7} />{bars}{points()}</g>;
    case "bars": {
      const among = of.filter((o) => o.mark === "bars"), k = among.indexOf(s);
      const wide = Math.abs(x(1) - x(0)) * 0.7 / among.length;
      const foot = log ? (y.domain()[0] as number) : 0;
      return (
        <g>
          {index.filter(defined).map((i) => {
            const a = px(i) - (wide * among.length) / 2 + k * wide;
            return <rect key={i} x={a} width={wide} y={Math.min(py(i), y(foot))} height={Math.abs(y(foot) - py(i))} fill={stroke} fill-opacity={0.75} />;
          })}
          {bars}
        </g>
      );
    }
    default:
      return (
        <g>
          <path d={path()} fill="none" stroke={stroke} stroke-width={width} stroke-linejoin="round"
            stroke-dasharray={s.mark === "dashes" ? "6 4" : undefined} />
          {bars}
        </g>
      );
  }
}

/** The key of a figure, with the values at the pointer. Series of one name in several panels stand once. */
export function Legend({ panels, cursor }: { panels: Panel[]; cursor?: number | null }): JSX.Element | null {
  const entries = new Map<string, { series: Series; unit: string; marks: Set<string> }>();
  for (const panel of panels)
    for (const s of panel.series) {
      if (!s.label) continue;
      const known = entries.get(s.label);
      if (known) known.marks.add(s.mark);
      else entries.set(s.label, { series: s, unit: panel.y.unit ?? "", marks: new Set([s.mark]) });
    }
  if (entries.size === 0) return null;
  return (
    <ul class="legend">
      {[...entries].map(([label, { series: s, marks }]) => (
        <li key={label}>
          <svg width="22" height="12" aria-hidden="true">
            {marks.has("band") && <rect x="1" y="1" width="20" height="10" fill={colour(s.color)} fill-opacity="var(--band-opacity)" stroke={colour(s.color)} stroke-opacity="0.4" />}
            {marks.has("bars") && <rect x="4" y="1" width="14" height="10" fill={colour(s.color)} fill-opacity="0.75" />}
            {["line", "steps", "dashes", "line-points"].some((m) => marks.has(m)) && (
              <line x1="1" x2="21" y1="6" y2="6" stroke={colour(s.color)} stroke-width="2"
                stroke-dasharray={s.mark === "dashes" ? "5 3" : s.mark === "line-points" ? "3 3" : undefined} />
            )}
            {(marks.has("points") || marks.has("line-points")) && <circle cx="11" cy="6" r="3" fill={colour(s.color)} />}
          </svg>
          <span>{label}</span>
          {cursor !== null && cursor !== undefined && <span class="value" aria-hidden="true">{valueAt(s, cursor)}</span>}
        </li>
      ))}
    </ul>
  );
}

function valueAt(s: Series, cursor: number): string {
  const xs = s.x.map((v) => v ?? NaN);
  if (xs.some((v, i) => i > 0 && v < (xs[i - 1] as number))) return "";
  const i = nearest(xs, cursor);
  if (i < 0 || cursor < (xs[0] as number) || cursor > (xs[xs.length - 1] as number)) return "";
  const text = number(s.y[i] ?? null, 4);
  return s.mark === "band" ? `${text} to ${number(s.y2?.[i] ?? null, 4)}` : text;
}

/** Width of an element in CSS pixels, followed. */
export function useWidth(fallback: number): [{ current: HTMLDivElement | null }, number] {
  const element = useRef<HTMLDivElement>(null);
  const [width, setWidth] = useState(fallback);
  useEffect(() => {
    const target = element.current;
    if (!target) return undefined;
    const measure = () => {
      const now = Math.round(target.getBoundingClientRect().width);
      if (now > 0) setWidth(now);
    };
    measure();
    if (typeof ResizeObserver === "undefined") return undefined;
    const observer = new ResizeObserver(measure);
    observer.observe(target);
    return () => observer.disconnect();
  }, []);
  return [element, width];
}
