/** What the daemon answers to a protocol that is checked (docs/api.md, POST /v1/check), and what is drawn of it. */
import type { Panel, Series } from "../shared/figure.ts";
import type { Step } from "./model.ts";

export interface Diagnostic {
  file: string;
  line: number;
  column: number;
  message: string;
  /** "file:line:column: message", as `isorig check` prints it. */
  text: string;
}

/** A column for each quantity; `text` of the first thousand steps. */
export interface StepColumns {
  do: string[];
  session: (number | null)[];
  start_s: number[];
  nominal_s: number[];
  worst_s: number[];
  position_before_mm: number[];
  position_after_mm: number[];
  amplitude_mm: number[];
  pressure_psi: number[];
  /** Slope of the set-point in a pressurize, else 0. */
  rate_psi_s: number[];
  line: number[];
  text: string[];
}

export interface CheckedPlan {
  rig: string;
  protocol: string;
  description: string;
  nominal_s: number;
  worst_s: number;
  full_rate_s: number;
  average_interval_s: number;
  travel_mm: number;
  peak_speed_mm_s: number;
  position_min_mm: number;
  position_max_mm: number;
  pressure_max_psi: number;
  sessions: string[];
  warnings: string[];
  steps: StepColumns;
}

/** The steps for a line of time; `worst`: each takes its longest. */
export function stepsOf(plan: CheckedPlan, worst: boolean): Step[] {
  const s = plan.steps;
  let at = 0;
  return s.do.map((kind, i) => {
    const lasts = (worst ? s.worst_s[i] : s.nominal_s[i]) as number;
    const start_s = worst ? at : (s.start_s[i] as number);
    at += lasts;
    return { do: kind, text: s.text[i] ?? "", session: s.session[i] ?? null, start_s, nominal_s: lasts, worst_s: s.worst_s[i] as number };
  });
}

export const KIND_NAMES = ["pressurize", "settle", "ramp", "hold", "wave", "mark"] as const;

/** "2 pressurize, 4 ramp": how many there are of each kind. */
export function countsOf(plan: CheckedPlan): string {
  return KIND_NAMES.map((k) => [plan.steps.do.filter((d) => d === k).length, k] as const)
    .filter(([n]) => n > 0).map(([n, k]) => `${n} ${k}`).join(", ");
}

/** Up to so many steps are drawn corner by corner; of more, what each stretch spans. */
const EXACT = 1500;
const STRETCHES = 900;

export interface Course {
  /** Of the plan's time, s. */
  x: number[];
  low: number[];
  high: number[];
  /** Set-point of the pressure from here on. */
  pressure_low: number[];
  pressure_high: number[];
  exact: boolean;
}

/** Set-points of position and pressure from `from` to `to` seconds of the plan. Nothing is skipped: of many steps a stretch
 *  has the lowest and the highest of all that lie in it. A wave spans its amplitude. */
export function courseOf(plan: CheckedPlan, from: number, to: number): Course {
  const s = plan.steps, n = s.do.length;
  const inside: number[] = [];
  for (let i = 0; i < n; ++i) {
    if ((s.start_s[i] as number) <= to && (s.start_s[i] as number) + (s.nominal_s[i] as number) >= from) inside.push(i);
  }
  const out: Course = { x: [], low: [], high: [], pressure_low: [], pressure_high: [], exact: inside.length <= EXACT };
  /** Where the set-point comes from, and how long it takes from there. */
  const before_psi = (i: number) => (i > 0 ? (s.pressure_psi[i - 1] as number) : 0);
  const rises_s = (i: number) => {
    const rate = s.rate_psi_s[i] as number, way = Math.abs((s.pressure_psi[i] as number) - before_psi(i));
    return rate > 0 ? Math.min(way / rate, s.nominal_s[i] as number) : 0;
  };
  const put = (x: number, low: number, high: number, pressure: number) => {
    out.x.push(x);
    out.low.push(low);
    out.high.push(high);
    out.pressure_low.push(pressure);
    out.pressure_high.push(pressure);
  };
  if (out.exact) {
    for (const i of inside) {
      const start = s.start_s[i] as number, a = s.amplitude_mm[i] as number, p = s.pressure_psi[i] as number;
      const before = s.position_before_mm[i] as number, after = s.position_after_mm[i] as number;
      const rise = rises_s(i);
      if (rise > 0) put(start, before - a, before + a, before_psi(i));
      put(start + rise, before - a, before + a, p);
      put(start + (s.nominal_s[i] as number), after - a, after + a, p);
    }
    return out;
  }
  const width = (to - from) / STRETCHES;
  const low = new Array<number>(STRETCHES).fill(Infinity), high = new Array<number>(STRETCHES).fill(-Infinity);
  const least = new Array<number>(STRETCHES).fill(Infinity), greatest = new Array<number>(STRETCHES).fill(-Infinity);
  for (const i of inside) {
    const start = s.start_s[i] as number, lasts = s.nominal_s[i] as number, a = s.amplitude_mm[i] as number;
    const before = s.position_before_mm[i] as number, after = s.position_after_mm[i] as number, p = s.pressure_psi[i] as number;
    const at = (t: number) => before + (lasts > 0 ? (after - before) * Math.min(1, Math.max(0, (t - start) / lasts)) : after - before);
    const rise = rises_s(i);
    const pressure = (t: number) => (rise > 0 && t < start + rise ? before_psi(i) + ((p - before_psi(i)) * Math.max(0, t - start)) / rise : p);
    const first = Math.max(0, Math.floor((start - from) / width)), last = Math.min(STRETCHES - 1, Math.floor((start + lasts - from) / width));
    for (let k = first; k <= last; ++k) {
      const [v, w] = [at(Math.max(start, from + k * width)), at(Math.min(start + lasts, from + (k + 1) * width))];
      low[k] = Math.min(low[k] as number, v - a, w - a);
      high[k] = Math.max(high[k] as number, v + a, w + a);
      const [q, r] = [pressure(Math.max(start, from + k * width)), pressure(Math.min(start + lasts, from + (k + 1) * width))];
      least[k] = Math.min(least[k] as number, q, r);
      greatest[k] = Math.max(greatest[k] as number, q, r);
    }
  }
  for (let k = 0; k < STRETCHES; ++k) {
    if (low[k] === Infinity) continue;
    out.x.push(from + (k + 0.5) * width);
    out.low.push(low[k] as number);
    out.high.push(high[k] as number);
    out.pressure_low.push(least[k] as number);
    out.pressure_high.push(greatest[k] as number);
  }
  return out;
}

export const TIME_UNITS = [{ s: 86_400, name: "d" }, { s: 3600, name: "h" }, { s: 60, name: "min" }, { s: 1, name: "s" }];
export const timeUnit = (span_s: number) => TIME_UNITS.find((u) => span_s >= 3 * u.s) ?? { s: 1, name: "s" };

/** Set-points over time as panels over one another. */
export function panelsOf(plan: CheckedPlan, from: number, to: number, unit: { s: number; name: string }): Panel[] {
  const c = courseOf(plan, from, to);
  const x = c.x.map((t) => t / unit.s);
  const middle = (low: number[], high: number[]) => low.map((v, i) => (v + (high[i] as number)) / 2);
  const spans = (low: number[], high: number[]) => low.some((v, i) => v !== high[i]);
  const series = (color: number, label: string, low: number[], high: number[]): Series[] => [
    ...(spans(low, high) ? [{ mark: "band" as const, color, label, x, y: low, y2: high }] : []),
    { mark: "line" as const, color, label, x, y: middle(low, high) },
  ];
  const axis = { name: "time", unit: unit.name };
  const sessions = plan.steps.session;
  const verticals = plan.sessions.length > 30 ? [] : plan.sessions.map((label, k) => {
    const first = sessions.indexOf(k);
    return { at: (plan.steps.start_s[first] ?? 0) / unit.s, label };
  });
  return [
    { x: { ...axis, name: "" }, y: { name: "position", unit: "mm" }, verticals, series: series(2, "position asked for", c.low, c.high) },
    { x: axis, y: { name: "pressure", unit: "psi" }, series: series(1, "pressure asked for", c.pressure_low, c.pressure_high) },
  ];
}
