import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Chart, Legend, useWidth } from "../shared/chart.tsx";
import type { Range } from "../shared/figure.ts";
import { duration, number } from "../shared/format.ts";
import { countsOf, panelsOf, stepsOf, timeUnit, type CheckedPlan } from "./checked_plan.ts";
import { Kinds, paintSteps } from "./timeline.tsx";

/** What a protocol would do: how long, how far, at which pressures; its steps as a line of time, its set-points, its list. */

const LISTED = 300;
const about = (s: number) => duration(s < 60 ? s : Math.round(s));

export function PlanView({ plan, goTo }: { plan: CheckedPlan; goTo: (line: number) => void }) {
  const [box, width] = useWidth(700);
  const expected = useRef<HTMLCanvasElement>(null), worst = useRef<HTMLCanvasElement>(null);
  const [zoom, setZoom] = useState<Range | null>(null);
  const [cursor, setCursor] = useState<number | null>(null);
  const unit = timeUnit(plan.nominal_s);
  useEffect(() => setZoom(null), [plan]);
  const steps = useMemo(() => [stepsOf(plan, false), stepsOf(plan, true)] as const, [plan]);
  useEffect(() => {
    if (expected.current) paintSteps(expected.current, steps[0], 0, plan.worst_s);
    if (worst.current) paintSteps(worst.current, steps[1], 0, plan.worst_s);
  });
  const panels = useMemo(() => panelsOf(plan, (zoom?.[0] ?? 0) * unit.s, zoom ? zoom[1] * unit.s : plan.nominal_s, unit), [plan, zoom]);
  const s = plan.steps;
  return (
    <div ref={box} class="plan">
      <dl class="seen">
        <dt>duration</dt><dd><b>{about(plan.nominal_s)}</b> expected; {about(plan.worst_s)} at worst, if every settle and pressurize runs out of time</dd>
        <dt>steps</dt><dd>{s.do.length}: {countsOf(plan)}</dd>
        <dt>sessions</dt><dd>{plan.sessions.length}: {plan.sessions[0]}{plan.sessions.length > 1 ? ` to ${plan.sessions[plan.sessions.length - 1]}` : ""}</dd>
        <dt>travel</dt><dd>{number(plan.travel_mm, 6)} mm, between {number(plan.position_min_mm, 6)} and {number(plan.position_max_mm, 6)} mm of the rest length</dd>
        <dt>peak speed</dt><dd>{number(plan.peak_speed_mm_s, 6)} mm/s</dd>
        <dt>pressure</dt><dd>up to {number(plan.pressure_max_psi, 6)} psi</dd>
        <dt>recording</dt><dd>full rate for {about(plan.full_rate_s)}, elsewhere a mean, minimum and maximum per {number(plan.average_interval_s, 6)} s</dd>
        <dt>limits</dt><dd class="good">✓ within those of {plan.rig}</dd>
        {plan.warnings.map((w) => <><dt>warning</dt><dd class="warning">! {w}</dd></>)}
      </dl>
      <h3>steps as expected, and each at its longest</h3>
      <canvas ref={expected} role="img" aria-label={`${s.do.length} steps in ${about(plan.nominal_s)} as expected`} />
      <canvas ref={worst} role="img" aria-label={`The same steps, each at its longest, in ${about(plan.worst_s)}`} />
      <Kinds steps={steps[0]} />
      <h3>set-points</h3>
      <Legend panels={panels} cursor={cursor} />
      {panels.map((panel, k) => (
        <Chart key={k} panel={panel} name={`plan-${k}`} characters={6} width={Math.max(260, width)} height={k === 0 ? 190 : 170}
          zoom={zoom ?? [0, plan.nominal_s / unit.s]} onZoom={setZoom} cursor={cursor} onCursor={setCursor} />
      ))}
      {zoom && <button type="button" onClick={() => setZoom(null)}>whole range</button>}
      <h3>{s.do.length > LISTED ? `the first ${LISTED} steps` : "steps"}</h3>
      <div class="table-frame steps" tabIndex={0} role="region" aria-label="Steps">
        <table>
          <thead><tr><th scope="col" class="number">step</th><th scope="col" class="number">after</th><th scope="col" class="number">lasts</th><th scope="col" class="number">at worst</th>
            <th scope="col">what</th><th scope="col">line</th></tr></thead>
          <tbody>
            {s.text.slice(0, LISTED).map((text, i) => (
              <tr key={i}>
                <th scope="row" class="number">{i + 1}</th><td class="number">{about(s.start_s[i] as number)}</td>
                <td class="number">{about(s.nominal_s[i] as number)}</td><td class="number">{about(s.worst_s[i] as number)}</td>
                <td>{text}</td><td><button type="button" class="link" onClick={() => goTo(s.line[i] as number)}>{s.line[i]}</button></td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {s.do.length > LISTED && <p class="note">All {s.do.length} are drawn above; isorig plan lists them.</p>}
    </div>
  );
}
