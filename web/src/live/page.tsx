import { useEffect, useReducer, useRef, useState } from "preact/hooks";
import { number } from "../shared/format.ts";
import { Control, NoteDialog, Verbs } from "./controls.tsx";
import { Boundary } from "./boundary.tsx";
import { DiagnosisPage } from "./diagnosis.tsx";
import { post, type Model, type Reply } from "./model.ts";
import { Zone } from "./moment.tsx";
import { LoopPlot, PANELS, TimePlot, windowOf, type Window } from "./plots.ts";
import { STREAMS } from "./stretches.ts";
import { CalibrationPage } from "./calibration.tsx";
import { Lateness } from "./lateness.tsx";
import { LogPage } from "./log.tsx";
import { ProtocolPage } from "./protocol.tsx";
import { NeedsSession } from "./needs_session.tsx";
import { reportIn } from "./report_link.ts";
import { Check, Judged, Reading, value } from "./readings.tsx";
import { RigPage } from "./rig.tsx";
import { RunsPage } from "./runs.tsx";
import { StartDialog } from "./start.tsx";
import { Timeline } from "./timeline.tsx";
import { TwinDialog, TwinPanel, TwinValue } from "./twin.tsx";
import { ageText, clockTime, look, moves, readingAge_s, zone } from "./words.ts";
import { zoomed } from "./zoom.ts";

const WINDOWS = [
  { s: 10, name: "10 s" }, { s: 30, name: "30 s" }, { s: 120, name: "2 min" }, { s: 600, name: "10 min" },
  { s: 3600, name: "1 h" }, { s: 86_400, name: "24 h" },
];
/** Between two drawings of a plot: an eye sees no more of a curve that moves. A curve of ten minutes moves by a pixel in a
 *  second: it is drawn twice for each. */
const PLOT_PERIOD_MS = 50;
const LONGEST_PERIOD_MS = 500;
const LOOP_PERIOD_MS = 100;
const periodOf = (span_s: number, pixels: number) =>
  Math.min(LONGEST_PERIOD_MS, Math.max(PLOT_PERIOD_MS, (500 * span_s) / Math.max(1, pixels)));
const LOOP_S = 60;
const EVENTS_SHOWN = 60;
const MESSAGE_MS = 8000;

function Values({ model }: { model: Model }) {
  const s = model.status;
  if (!s) return null;
  const status_age_ms = performance.now() - model.status_ms, frame_age_s = readingAge_s(s.frame_age_s, status_age_ms);
  return (
    <div class="values">
      <Reading name="force" unit="N" value={value(s.force_N, 2)} age_s={frame_age_s}>
        <TwinValue model={model} />
        <p>{model.plan ? `limits ${model.plan.limits.force_min_N} to ${model.plan.limits.force_max_N}` : ""}</p>
      </Reading>
      <Reading name="position" unit="mm" value={value(s.position_mm, 3)} age_s={frame_age_s}>
        <p>{moves(s, model.plan) ? `to ${value(s.target_mm, 3)} at ${number(Math.abs(s.velocity_mm_s), 3)} mm/s` : `target ${value(s.target_mm, 3)}`}</p>
      </Reading>
      <Reading name="pressure" unit="psi" value={value(s.pressure_psi, 2)} age_s={readingAge_s(s.pressure_age_s, status_age_ms)}>
        <p>{s.sealed ? `SEALED, both valves shut; was ${value(s.setpoint_psi, 2)}` : `set ${value(s.setpoint_psi, 2)}`} · fill {s.fill_permille} ‰ · vent {s.vent_permille} ‰</p>
      </Reading>
    </div>
  );
}

function Health({ model }: { model: Model }) {
  const { status: s, web } = model;
  if (!s || !web) return null;
  const { lost } = web;
  const age = ageText((performance.now() - model.status_ms) / 1000);
  const recorded = (s.recorder?.lost_messages ?? 0) + (s.recorder?.dropped_records ?? 0) + (s.recorder?.missing_samples ?? 0);
  return (
    <section class={`panel health ${age ? "stale" : ""}`}>
      {age && <p class="age">{age}: what follows was so then</p>}
      <h2>Interlocks</h2>
      <ul class="checks">
        {s.interlock.watched ? <>
          <Check good={s.interlock.estop_closed}>emergency-stop chain {s.interlock.estop_closed ? "closed" : "OPEN"}</Check>
          <Check good={s.interlock.guard_closed}>guard {s.interlock.guard_closed ? "closed" : "OPEN"}</Check>
        </> : <Check good={null}>chain is not watched: {s.interlock.not_watched}</Check>}
        <Check good={s.zero_confirmed}>frame's zero {s.zero_confirmed ? "confirmed" : "not confirmed"}</Check>
      </ul>
      <h2>Clocks and loop</h2>
      <ul class="checks">
        <Judged name="frame" said={web.verdicts.frame} />
        <Judged name="pressure" said={web.verdicts.pressure} />
        <Judged name="loop" said={web.verdicts.loop} />
      </ul>
      <Lateness bins={web.lateness} />
      <h2>Data</h2>
      <ul class="checks">
        {s.recorder && <Check good={recorded === 0}>recording: {recorded === 0 ? "nothing lost" : `${recorded} lost`}, {number(s.recorder.written_MiB, 3)} MiB</Check>}
        {s.recorder && <Check good={s.recorder.error === ""}>disk: {number(s.recorder.free_MiB / 1024, 3)} GiB free{s.recorder.error ? ` · ${s.recorder.error}` : ""}</Check>}
        <Check good={lost + model.left_out === 0}>this page: {lost === 0 ? "no sample lost" : `${lost} samples lost`}{model.left_out ? `, ${model.left_out} messages left out` : ""}</Check>
        <li><span aria-hidden="true">◦</span> {web.viewers} {web.viewers === 1 ? "page looks" : "pages look"} on</li>
      </ul>
    </section>
  );
}

function Events({ model }: { model: Model }) {
  const now = (model.web?.unix_ms ?? 0) / 1000;
  return (
    <section class="panel events" aria-label="Events">
      <h2>Events<Zone /></h2>
      <ol tabIndex={0} aria-label="Events, newest first">
        {model.events.slice(-EVENTS_SHOWN).reverse().map((e) => (
          <li key={`${e.mono_ns} ${e.code}`} class={e.severity === "info" ? "" : e.severity === "warning" ? "warning" : "bad"}>
            <time>{clockTime(model.unix_s(e.mono_ns), now)}</time>{" "}
            {e.severity === "info" ? "" : <b>{e.severity}: </b>}{e.text || e.code}{e.count > 1 ? ` (${e.count} times)` : ""}
          </li>
        ))}
      </ol>
    </section>
  );
}

function Plots({ model, say, below, beside }: { model: Model; say: (reply: Reply) => void; below: preact.ComponentChildren; beside: (loop: preact.ComponentChildren) => preact.ComponentChildren }) {
  const [span, setSpan] = useState(30);
  const [zoom, setZoom] = useState<Window | null>(null);
  const now = useRef({ span, zoom });
  now.current = { span, zoom };
  const hasTwin = model.web?.twin.model != null;
  const strips = useRef<HTMLDivElement>(null), loop = useRef<HTMLDivElement>(null);
  const live = (seconds: number) => {
    setZoom(null);
    setSpan(seconds);
  };
  useEffect(() => {
    const places = [...(strips.current as HTMLElement).querySelectorAll<HTMLElement>(".strip")];
    const marked = (from: number, to: number) => void zoomed(model, from, to, places[0]?.clientWidth ?? 600).then((w) =>
      typeof w === "string" ? say({ ok: false, status: 0, text: w, body: {} }) : setZoom(w));
    const plots = PANELS.map((p, i) => new TimePlot(places[i] as HTMLElement, model, p, i === 0, i === PANELS.length - 1, marked));
    const over = new LoopPlot(loop.current as HTMLElement, model);
    let last = 0, lastLoop = 0, frame = 0;
    let shown: { span: number; zoom: Window | null } = { span: 0, zoom: null };
    // For who measures (web/test/live-frames.mjs): how many stretches of the frame were drawn, and the newest of them.
    let drawn = 0, until = -Infinity;
    const count = () => {
      const ring = model.fine[STREAMS.frame];
      if (!ring || !Number.isFinite(ring.newest)) return;
      for (let i = Number.isFinite(until) ? until + 1 : ring.newest; i <= ring.newest; ++i) drawn += ring.at(i) >= 0 ? 1 : 0;
      until = ring.newest;
      const data = (strips.current as HTMLElement).dataset;
      data["drawn"] = String(drawn);
      data["drawnUntil"] = String(until);
    };
    const draw = (t: number) => {
      frame = requestAnimationFrame(draw);
      const pixels = places[0]?.clientWidth ?? 600;
      const another = shown.span !== now.current.span || shown.zoom !== now.current.zoom;
      // Where every frame comes later than the plots are due, the loop still has its turn.
      const due = t - last >= periodOf(now.current.span, pixels), starved = t - lastLoop >= 3 * LOOP_PERIOD_MS;
      if (another || (due && !starved)) {
        const w = now.current.zoom ?? windowOf(model, now.current.span, pixels);
        if (w === null) return;
        last = t;
        shown = now.current;
        for (const p of plots) if (p.element.clientHeight > 0) p.draw(w);
        if (w.rings === model.fine) count();
      } else if (t - lastLoop >= LOOP_PERIOD_MS) {  // in a frame of its own
        lastLoop = t;
        // Stretches of the loop stay as fine as they are: joined ones would be wide rectangles.
        const near = now.current.zoom ?? windowOf(model, Math.min(now.current.span, LOOP_S), Infinity);
        if (near !== null) over.draw(near);
      }
    };
    frame = requestAnimationFrame(draw);
    const keys = (e: KeyboardEvent) => {
      const w = WINDOWS[Number(e.key) - 1];
      if (e.key === "Escape") setZoom(null);
      else if (w && !document.querySelector("dialog[open]")) live(w.s);
    };
    addEventListener("keydown", keys);
    return () => {
      cancelAnimationFrame(frame);
      removeEventListener("keydown", keys);
    };
  }, []);
  return (
    <>
      <div class="column">
        <section class="panel strips" aria-label="Over time" ref={strips}>
          <div class="windows" role="group" aria-label="Time shown">
            {WINDOWS.map((w, i) => (
              <button type="button" key={w.s} aria-pressed={zoom === null && w.s === span} title={`key ${i + 1}`} onClick={() => live(w.s)}>{w.name}</button>
            ))}
            {zoom && <button type="button" class="back" onClick={() => setZoom(null)}>The past, enlarged · back to now</button>}
          </div>
          {PANELS.map((p) => (
            <div class="strip-frame" key={p.title} hidden={p.twin && !hasTwin}>
              <h3>{p.title} {p.signals.filter((s) => hasTwin || !s.label.startsWith("twin")).map((s) => <span key={s.label} class="key"><span class={`line s${s.color}${s.target ? " dashed" : ""}${s.band ? " wide" : ""}`} />{s.label}</span>)}</h3>
              <div class="strip" role="img" aria-label={`${p.title} over the last ${span} s`} />
            </div>
          ))}
          <p class="note">Line: mean; band: lowest to highest; every sample is in it. Times: {zone()}. Mark a stretch to enlarge it: the last ten minutes down to 1 ms, what is older as its stretches of 5 s.</p>
        </section>
        {below}
      </div>
      <div class="column side">
        {beside(
          <section class="panel loop" aria-label="Force over length">
            <h3>force over length, {zoom ? "the stretch that is marked" : `last ${Math.min(span, LOOP_S)} s`}</h3>
            <div class="loop-plot" role="img" aria-label="Force over position" ref={loop} />
          </section>,
        )}
      </div>
    </>
  );
}

function Theme() {
  const [theme, set] = useState(localStorage.getItem("theme") ?? "");
  useEffect(() => {
    if (theme) document.documentElement.dataset["theme"] = theme;
    else delete document.documentElement.dataset["theme"];
    localStorage.setItem("theme", theme);
  }, [theme]);
  const next = theme === "" ? "dark" : theme === "dark" ? "light" : "";
  return <button type="button" class="theme" title="Light, dark, or as the system has it" onClick={() => set(next)}>{theme === "" ? "◐ auto" : theme === "dark" ? "● dark" : "○ light"}</button>;
}

/** What a link in a report led to, of who has no session (report_link.ts). */
function ReportPage({ model }: { model: Model }) {
  const report = reportIn(location.hash);
  if (!model.hello?.may_control || report === null) return <NeedsSession name="Report" what="this report" model={model} />;
  return <main class="page"><section class="panel" aria-label="Report"><h2>Report</h2><p><a href={report}>Open the report</a></p></section></main>;
}

const PAGES = ["live", "protocol", "runs", "diagnosis", "log", "rig", "calibration"] as const;
type Shown = (typeof PAGES)[number] | "report";
const nameOf = (p: Shown) => p.charAt(0).toUpperCase() + p.slice(1);

/** Which page is open: what stands behind the # of the address, so that back, forward and a reload find it again. */
function useShown(): Shown {
  const read = (): Shown => PAGES.find((p) => location.hash === `#${p}`) ?? (reportIn(location.hash) === null ? "live" : "report");
  const [shown, set] = useState<Shown>(read);
  useEffect(() => {
    const changed = () => set(read());
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  return shown;
}

function Pages({ shown }: { shown: Shown }) {
  return (
    <nav aria-label="Pages">
      {PAGES.map((p) => <a key={p} href={`#${p}`} aria-current={p === shown ? "page" : undefined}>{nameOf(p)}</a>)}
    </nav>
  );
}

export function Page({ model }: { model: Model }) {
  const [, again] = useReducer((n: number) => n + 1, 0);
  const [said, setSaid] = useState<Reply | null>(null);
  const shownPage = useShown();
  const [dialog, setDialog] = useState<"" | "start" | "note" | "twin">("");
  useEffect(() => {
    const timer = setInterval(() => again(0), 1000);  // news that do not come are news, too
    const unwatch = model.watch(() => again(0));
    return () => {
      clearInterval(timer);
      unwatch();
    };
  }, []);
  useEffect(() => {
    if (!said) return;
    const gone = setTimeout(() => setSaid(null), MESSAGE_MS);
    return () => clearTimeout(gone);
  }, [said]);
  useEffect(() => {
    const keys = (e: KeyboardEvent) => {
      if (e.key !== "p" || e.ctrlKey || e.metaKey || e.altKey || !model.hello?.may_control || document.querySelector("dialog[open]")) return;
      if (e.target instanceof Element && e.target.matches("input:not([type=checkbox]), textarea, select")) return;  // somebody writes
      void post("pause").then(setSaid);
    };
    addEventListener("keydown", keys);
    return () => removeEventListener("keydown", keys);
  }, []);
  const s = model.status;
  const status_age_ms = performance.now() - model.status_ms, shown = look(s, model.plan, model.connected, status_age_ms, model.none);
  document.title = `${shown.sign} ${shown.word}${s?.run ? ` ${Math.round(s.progress * 100)} %` : ""} · ${s?.rig ?? "isorig"}`;
  const why = !model.connected ? "The connection to isorig-web is gone; the rig goes on. Tried again every second."
    : shown.word === "NO NEWS" ? `The newest status is ${Math.round(status_age_ms / 1000)} s old.` : s === null ? model.why : s.state === "idle" ? s.not_ready : "";
  return (
    <div class="frame" data-look={shown.look}>
      <header>
        <div role="status"><h1 class="state"><span aria-hidden="true">{shown.sign}</span> {shown.word}</h1></div>
        <Pages shown={shownPage} />
        <p class="rig"><b>{s?.rig ?? model.hello?.rig ?? ""}</b>{s?.simulated ? " · simulated" : ""}{why ? <> · <span class="why">{why}</span></> : ""}</p>
        <div class="right">
          <Control model={model} say={setSaid} />
          <Verbs model={model} say={setSaid} onStart={() => setDialog("start")} onNote={() => setDialog("note")} />
          <Theme />
        </div>
      </header>
      {said && <p class={`said ${said.ok ? "good" : "bad"}`} role="alert">{said.ok ? "✓" : "✕"} {said.text}</p>}
      {s !== null && s.faults.length > 0 && (
        <section class="faults" role="alert">
          <h2>{s.state === "faulted" ? "Stopped by" : "Since the last reset"}<Zone /></h2>
          <ul>{s.faults.map((f) => <li key={`${f.mono_ns}${f.code}`}><time>{clockTime(model.unix_s(f.mono_ns), (model.web?.unix_ms ?? 0) / 1000)}</time> <b>{f.severity} · {f.code}</b> {f.text}</li>)}</ul>
        </section>
      )}
      {(shownPage === "live" || s?.run) && <Boundary key={`protocol of ${s?.run?.id}`} name="The run"><Timeline model={model} /></Boundary>}
      <Boundary key={shownPage} name={nameOf(shownPage)}>
        {shownPage === "runs" && <RunsPage model={model} say={setSaid} />}
        {shownPage === "protocol" && <ProtocolPage model={model} say={setSaid} />}
        {shownPage === "diagnosis" && <DiagnosisPage model={model} say={setSaid} />}
        {shownPage === "report" && <ReportPage model={model} />}
        {shownPage === "log" && <LogPage model={model} />}
        {shownPage === "rig" && <RigPage model={model} />}
        {shownPage === "calibration" && <CalibrationPage model={model} />}
        {shownPage === "live" && <main>
          <Plots model={model} say={setSaid} below={<Events model={model} />} beside={(loop) => <><Values model={model} /><TwinPanel model={model} choose={() => setDialog("twin")} />{loop}<Health model={model} /></>} />
        </main>}
      </Boundary>
      <footer>
        {model.hello?.may_control ? "Keys: p pauses at once; 1 to 6 choose the time shown; Tab, then Enter or Space held, for the rest. " : "View only: isorig web, in a terminal on the rig's machine, gives a link that may control. "}
        Times: {zone()}. The emergency stop is the wired one at the rig.
      </footer>
      {dialog === "start" && <StartDialog model={model} say={setSaid} close={() => setDialog("")} />}
      {dialog === "twin" && <TwinDialog model={model} say={setSaid} close={() => setDialog("")} />}
      {dialog === "note" && <NoteDialog model={model} say={setSaid} close={() => setDialog("")} />}
    </div>
  );
}
