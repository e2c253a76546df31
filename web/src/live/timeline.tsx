import { useEffect, useRef } from "preact/hooks";
import { duration } from "../shared/format.ts";
import type { Model, Plan, Step } from "./model.ts";
import { clockTime, worstRemaining_s } from "./words.ts";

/** The protocol as a line of time: steps in their colours with their names, what is done, now, when it ends. */

/** Colour of the palette and name for a kind of step; others are grey. */
const KINDS: Record<string, { color: number; name: string }> = {
  pressurize: { color: 5, name: "pressurize" },
  settle: { color: 7, name: "settle" },
  ramp: { color: 1, name: "ramp" },
  hold: { color: 8, name: "hold" },
  wave: { color: 2, name: "wave" },
};

/** Seconds of the plan's time at which the run is: in the middle of the step under way, as far as the progress says. */
function now_s(plan: Plan, step: Step | undefined, progress: number): number {
  const at = progress * (plan.nominal_s ?? 0);
  if (step === undefined) return at;
  return Math.min(step.start_s + step.nominal_s, Math.max(step.start_s, at));
}

function css(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** The steps from `from` to `to` seconds of the plan's time; those before `current` are done. */
export function paintSteps(canvas: HTMLCanvasElement, steps: Step[], from: number, to: number, current = 0, first = 0, names = true): void {
  const dpr = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== width * dpr || canvas.height !== height * dpr) {
    canvas.width = width * dpr;
    canvas.height = height * dpr;
  }
  const c = canvas.getContext("2d") as CanvasRenderingContext2D;
  c.setTransform(dpr, 0, 0, dpr, 0, 0);
  c.clearRect(0, 0, width, height);
  c.font = `12px ${css("sans")}`;
  c.textAlign = "center";
  c.textBaseline = "middle";
  const x = (t: number) => ((t - from) / Math.max(1e-9, to - from)) * width;
  let drawn = -1;
  steps.forEach((s, i) => {
    const left = x(s.start_s), right = x(s.start_s + s.nominal_s);
    // Of 50,000 steps those that end within a pixel that is drawn already are left out.
    if (right - drawn < 0.5) return;
    drawn = right;
    const kind = KINDS[s.do];
    c.globalAlpha = first + i < current ? 0.45 : 1;
    c.fillStyle = kind === undefined || kind.color === 8 ? css("rule") : css(`series-${kind.color}`);
    c.fillRect(left, 4, Math.max(0.5, right - left - (right - left > 3 ? 1 : 0)), height - 8);
    const name = kind?.name ?? s.do;
    if (names && right - left > c.measureText(name).width + 8) {
      c.globalAlpha = 1;
      c.fillStyle = css("ground");
      const w = c.measureText(name).width + 6;
      c.fillRect((left + right) / 2 - w / 2, height / 2 - 8, w, 16);
      c.fillStyle = css("ink");
      c.fillText(name, (left + right) / 2, height / 2);
    }
  });
  c.globalAlpha = 1;
}

function paint(canvas: HTMLCanvasElement, steps: Step[], from: number, to: number, now: number, current: number, first: number, names: boolean): void {
  paintSteps(canvas, steps, from, to, current, first, names);
  const c = canvas.getContext("2d") as CanvasRenderingContext2D;
  c.fillStyle = css("ink");
  const at = ((now - from) / Math.max(1e-9, to - from)) * canvas.clientWidth;
  const height = canvas.clientHeight;
  c.fillRect(at - 1.5, 0, 3, height);
  c.beginPath();
  c.moveTo(at - 6, 0);
  c.lineTo(at + 6, 0);
  c.lineTo(at, 7);
  c.fill();
}

/** The key of the colours. */
export function Kinds({ steps }: { steps: Step[] }) {
  const kinds = [...new Set(steps.slice(0, 5000).map((s) => s.do))].filter((k) => KINDS[k] !== undefined && KINDS[k]?.color !== 8);
  return (
    <ul class="kinds" aria-hidden="true">
      {kinds.map((k) => <li key={k}><span class={`swatch s${KINDS[k]?.color}`} />{k}</li>)}
    </ul>
  );
}

export function Timeline({ model }: { model: Model }) {
  const whole = useRef<HTMLCanvasElement>(null), part = useRef<HTMLCanvasElement>(null);
  const { plan, status } = model;
  const run = status?.run;
  const steps = plan?.run && plan.steps ? plan.steps : null;
  const session = run?.session ?? null;
  useEffect(() => {
    if (!steps || !plan || !run || !status) return;
    const now = now_s(plan, steps[run.step], status.progress);
    const end = plan.nominal_s ?? 0;
    if (whole.current) paint(whole.current, steps, 0, end, now, run.step, 0, part.current === null);
    if (part.current) {
      const from = steps.findIndex((s) => s.session === session);
      let to = from;
      while (to + 1 < steps.length && (steps[to + 1] as Step).session === session) ++to;
      const own = steps.slice(Math.max(0, from), to + 1);
      const last = own[own.length - 1];
      if (last) paint(part.current, own, (own[0] as Step).start_s, last.start_s + last.nominal_s, now, run.step, Math.max(0, from), true);
    }
  });
  if (!status) return null;
  if (!run || !plan || !steps) {
    const last = status.last_run;
    return (
      <section class="timeline panel" aria-label="Protocol">
        <p class="summary">
          {last?.id ? <>Last run <b>{last.id}</b>: {last.outcome}{last.fault ? ` · ${last.fault}` : ""}</> : "No run is open."}
        </p>
      </section>
    );
  }
  const unix = (model.web?.unix_ms ?? 0) / 1000;
  const worst = worstRemaining_s(plan, run.step);
  const waits = status.state === "paused" || status.state === "faulted";
  const several = (plan.sessions?.length ?? 0) > 1;
  return (
    <section class="timeline panel" aria-label="Protocol">
      <h2>{run.protocol} <small>{run.session_text}{several && session !== null ? ` (session ${session + 1} of ${run.sessions})` : ""}</small></h2>
      {several && <canvas class="whole" ref={whole} role="img" aria-label={`The whole run, ${Math.round(status.progress * 100)} per cent done`} />}
      <canvas class="part" ref={several ? part : whole} role="img" aria-label={`Step ${run.step + 1} of ${run.steps}: ${run.step_text}`} />
      <p class="summary">
        <b>{Math.round(status.progress * 100)} %</b> · step {run.step + 1} of {run.steps} · {run.step_text} ·{" "}
        <b>{waits ? "would end" : "ends"} {clockTime(unix + status.remaining_s, unix, status.remaining_s < 3600)}</b>{" "}
        (in {duration(Math.round(status.remaining_s))}{worst === null ? "" : `; at worst ${clockTime(unix + worst, unix, worst < 3600)}`})
        {waits ? " if it went on now" : ""}
      </p>
      <Kinds steps={steps} />
    </section>
  );
}
