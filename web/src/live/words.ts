import type { NoStatus, Plan, Status } from "./model.ts";

/** How a state is shown: never by colour alone. */
export interface Look {
  /** Of the style sheet: data-look. */
  look: "away" | "idle" | "ready" | "running" | "waiting" | "fault";
  sign: string;
  word: string;
}

const LOOKS: Record<string, Look> = {
  idle: { look: "idle", sign: "○", word: "NOT READY" },
  ready: { look: "ready", sign: "✓", word: "READY" },
  running: { look: "running", sign: "▶", word: "RUNNING" },
  paused: { look: "waiting", sign: "❚❚", word: "PAUSED" },
  stopping: { look: "waiting", sign: "■", word: "STOPPING" },
  faulted: { look: "fault", sign: "✕", word: "FAULT" },
  armed: { look: "waiting", sign: "◆", word: "ARMED" },
  countdown: { look: "running", sign: "◆", word: "COUNTDOWN" },
  setup: { look: "waiting", sign: "⚒", word: "SETUP" },
};

/** Status older than this is no longer what the rig does. */
export const STALE_MS = 2000;

/** A reading older than this is not of now: it is shown greyed, with its age, as at the terminal. */
export const STALE_READING_S = 1;

/** What stands beside a reading of this age: "" for one of now. A negative age is of a device that never sent any. */
export function ageText(age_s: number): string {
  if (age_s < 0) return "never read";
  return age_s > STALE_READING_S ? `STALE ${age_s < 10 ? age_s.toFixed(1) : Math.round(age_s)} s` : "";
}

/** The age of a reading now: the status that told of it grows old, too. */
export function readingAge_s(age_s: number, status_age_ms: number): number {
  return age_s < 0 ? age_s : age_s + status_age_ms / 1000;
}

/** The step under way moves the crosshead. */
export function moves(status: Status, plan: Plan | null): boolean {
  const step = status.run === undefined ? undefined : plan?.steps?.[status.run.step];
  return status.state === "running" && (step?.do === "ramp" || step?.do === "wave");
}

/** Why there is no status, in a word: only where nothing listens on the daemon's socket there is no daemon. */
const NO_STATUS: Record<NoStatus, string> = { "not yet": "NO STATUS YET", gone: "NO DAEMON", silent: "NO ANSWER", refused: "REFUSED" };

export function look(status: Status | null, plan: Plan | null, connected: boolean, age_ms: number, none: NoStatus): Look {
  if (!connected) return { look: "away", sign: "?", word: "PAGE CUT OFF" };
  if (status === null) return { look: "away", sign: "?", word: age_ms > STALE_MS && none !== "not yet" ? "NO NEWS" : NO_STATUS[none] };
  if (age_ms > STALE_MS) return { look: "away", sign: "?", word: "NO NEWS" };
  const known = LOOKS[status.state] ?? { look: "away", sign: "?", word: status.state.toUpperCase() };
  return moves(status, plan) ? { ...known, word: `${known.word} · MOVING` } : known;
}

/** Seconds that the run may still take if every step takes its longest; the step under way is counted whole. */
export function worstRemaining_s(plan: Plan | null, step: number): number | null {
  if (!plan?.steps || plan.run === null) return null;
  let sum = 0;
  for (let i = step; i < plan.steps.length; ++i) sum += plan.steps[i]?.worst_s ?? 0;
  return sum;
}

/** All times on the page are those of this zone: "Europe/Zurich". A name, since one offset is not that of summer and winter. */
export const zone = (): string => Intl.DateTimeFormat().resolvedOptions().timeZone;

/** "2026-11-23 05:14:10" of a moment, in `zone()`, with so many digits of the second. */
export function localTime(moment: Date, digits = 0): string {
  if (Number.isNaN(moment.getTime())) return "–";
  const two = (n: number) => String(n).padStart(2, "0");
  const fraction = digits > 0 ? `.${String(moment.getMilliseconds()).padStart(3, "0").slice(0, digits)}` : "";
  return `${localDay(moment)} ${two(moment.getHours())}:${two(moment.getMinutes())}:${two(moment.getSeconds())}${fraction}`;
}

/** "2026-11-23" of a moment, in `zone()`. */
export function localDay(moment: Date): string {
  if (Number.isNaN(moment.getTime())) return "–";
  const two = (n: number) => String(n).padStart(2, "0");
  return `${moment.getFullYear()}-${two(moment.getMonth() + 1)}-${two(moment.getDate())}`;
}

/** "05:14:10", with the day when it is another one. */
export function clockTime(unix_s: number, now_s: number, seconds = true): string {
  const then = new Date(unix_s * 1000), now = new Date(now_s * 1000);
  const time = then.toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit", ...(seconds ? { second: "2-digit" } : {}) });
  if (then.toDateString() === now.toDateString()) return time;
  return `${then.toLocaleDateString("en-GB", { weekday: "short", day: "numeric", month: "short" })} ${time}`;
}
