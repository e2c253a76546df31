import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Chart, Legend, useWidth } from "../shared/chart.tsx";
import type { Panel } from "../shared/figure.ts";
import { NoteDialog, type Say } from "./controls.tsx";
import { StartDialog } from "./start.tsx";
import { reportAt } from "./report_link.ts";
import { getReport, useFetched } from "./fetched.ts";
import { Moment, Zone } from "./moment.tsx";
import { NeedsSession } from "./needs_session.tsx";
import type { Model } from "./model.ts";
import { CurveStore, matches, mayGoOn, overlaid, recordedText, type Curves } from "./run_list.ts";

/** The runs there are: looked for, noted at, their pages, their force-velocity curves over each other. */

export interface Run {
  id: string;
  started_utc: string;
  state: string;
  fault: string;
  specimen: string;
  rig: string;
  protocol: string;
  operator: string;
  attempts: number;
  sessions: number;
  sessions_done: number;
  /** Of all attempts together. */
  recorded_s: number;
  report: boolean;
  /** Where its report lies. */
  page: string;
  notes: { at_utc?: string; by?: string; specimen?: string; operator?: string; text?: string }[];
}

const SIGNS: Record<string, string> = { done: "✓", running: "▶", aborted: "■", failed: "✕", refused: "✕", interrupted: "✕" };
const SHOWN = 100;
/** The palette tells so many apart. */
const OVERLAID = 8;

const store = new CurveStore(getReport);

function Overlay({ ids }: { ids: string[] }) {
  const [box, width] = useWidth(800);
  const [curves, setCurves] = useState<Curves[]>([]);
  const [wrong, setWrong] = useState("");
  const key = ids.join(" ");
  useEffect(() => {
    let gone = false;
    setWrong("");
    Promise.all(ids.map((id) => store.get(id))).then((c) => !gone && setCurves(c), (e: Error) => !gone && setWrong(e.message));
    return () => {
      gone = true;
    };
  }, [key]);
  const panel: Panel | null = overlaid(curves);
  const without = curves.filter((c) => c.panel === null).map((c) => c.id);
  return (
    <section class="panel overlay" aria-label="Force-velocity curves">
      <h2>Force-velocity curves over each other</h2>
      {wrong && <p class="bad" role="alert">{wrong}</p>}
      {without.length > 0 && <p class="note">Without curves: {without.join(", ")} (no ramps that could be analysed).</p>}
      <div ref={box as never}>
        {panel && <><Legend panels={[panel]} /><Chart panel={panel} name="overlay" width={width} height={Math.round(Math.min(420, width * 0.5))} /></>}
      </div>
      {panel && <p class="note">Points are measured, lines are fits, as on each run's own page. A colour is a run; its pressures have the same colour.</p>}
    </section>
  );
}

export function RunsPage({ model, say }: { model: Model; say: Say }) {
  if (!model.hello?.may_control) return <NeedsSession name="Runs" what="the runs" model={model} />;
  return <RunList model={model} say={say} />;
}

function RunList({ model, say }: { model: Model; say: Say }) {
  const list = useFetched<{ runs: Run[]; all: number }>("/api/runs");
  const [search, setSearch] = useState("");
  const [chosen, setChosen] = useState<string[]>([]);
  const [noted, setNoted] = useState<string | null>(null);
  const [resumed, setResumed] = useState<Run | null>(null);
  const notYet = !model.lease.mine ? "Take control first" : model.status?.state !== "ready" ? "The rig is not ready" : undefined;
  // A run that ended or began changes the list.
  const now = `${model.status?.run?.id ?? ""} ${model.status?.last_run?.id ?? ""} ${model.status?.last_run?.outcome ?? ""}`;
  const first = useRef(now);
  useEffect(() => {
    if (first.current !== now) list.again();
    first.current = now;
  }, [now]);
  const found = useMemo(() => (list.value?.runs ?? []).filter((r) => matches(r, search)), [list.value, search]);
  const choose = (id: string, on: boolean) => setChosen((c) => (on ? [...c, id].slice(-OVERLAID) : c.filter((x) => x !== id)));
  return (
    <main class="page">
      <section class="panel" aria-label="Runs">
        <h2>Runs</h2>
        <div class="bar">
          <label class="search">Search <input type="search" value={search} placeholder="specimen, protocol, operator, outcome, note…"
            onInput={(e) => setSearch(e.currentTarget.value)} /></label>
          <button type="button" onClick={list.again} disabled={list.busy}>Look again</button>
        </div>
        {list.wrong && <p class="bad" role="alert">{list.wrong}</p>}
        {list.value && (
          <p class="note" role="status">
            {found.length} of {list.value.runs.length} runs{found.length > SHOWN ? `, the newest ${SHOWN} shown` : ""}
            {list.value.all > list.value.runs.length ? `; ${list.value.all - list.value.runs.length} older ones: isorig runs, in a terminal` : ""}
          </p>
        )}
        <div class="table-frame" tabIndex={0} role="region" aria-label="List of runs">
          <table class="runs">
            <thead><tr><th scope="col">FV</th><th scope="col">run</th><th scope="col">started<Zone /></th><th scope="col" class="number">recorded</th><th scope="col">outcome</th><th scope="col">sessions</th>
              <th scope="col">specimen</th><th scope="col">protocol</th><th scope="col">operator</th><th scope="col">notes</th></tr></thead>
            <tbody>
              {found.slice(0, SHOWN).map((r) => (
                <tr key={r.id}>
                  <td><input type="checkbox" aria-label={`Curves of ${r.id}`} checked={chosen.includes(r.id)} disabled={!r.report}
                    onChange={(e) => choose(r.id, e.currentTarget.checked)} /></td>
                  <th scope="row">{r.report ? <a href={reportAt(r.page)} target="_blank" rel="noopener">{r.id}</a> : r.id}</th>
                  <td><Moment utc={r.started_utc} /></td>
                  <td class="number">{recordedText(r.recorded_s)}</td>
                  <td class={r.state === "done" || r.state === "running" ? "" : "bad"}>{SIGNS[r.state] ?? "?"} {r.state}{r.fault ? <small> {r.fault}</small> : null}</td>
                  <td>{r.sessions_done} of {r.sessions}{r.attempts > 1 ? `, ${r.attempts} attempts` : ""}{" "}
                    {mayGoOn(r) && <button type="button" aria-label={`Go on with ${r.id}`} disabled={notYet !== undefined} title={notYet} onClick={() => setResumed(r)}>Go on…</button>}</td>
                  <td>{r.specimen}</td>
                  <td>{r.protocol}</td>
                  <td>{r.operator}</td>
                  <td class="notes">
                    {r.notes.map((n, i) => (
                      <p key={i}>{n.text || ""}{n.operator ? ` operator is ${n.operator}` : ""}{n.specimen ? ` specimen is ${n.specimen}` : ""}
                        <small> {n.by ?? ""} {n.at_utc ? <Moment utc={n.at_utc} day /> : ""}</small></p>
                    ))}
                    {model.hello?.may_control && <button type="button" aria-label={`Note to ${r.id}`} onClick={() => setNoted(r.id)}>Note…</button>}
                  </td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      </section>
      {chosen.length > 0 && <Overlay ids={chosen} />}
      {resumed !== null && (
        <StartDialog model={model} resume={{ run: resumed.id, aborted: resumed.state === "aborted" }} say={(reply) => { say(reply); list.again(); }} close={() => setResumed(null)} />
      )}
      {noted !== null && <NoteDialog model={model} run={noted} say={(reply) => { say(reply); list.again(); }} close={() => setNoted(null)} />}
    </main>
  );
}
