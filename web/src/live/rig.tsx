import { useFetched } from "./fetched.ts";
import type { Model } from "./model.ts";
import { NeedsSession } from "./needs_session.tsx";

/** The rig judged at rest, as `isorig selftest` judges it. */

export interface Line {
  check: string;
  verdict: "ok" | "skipped" | "warn" | "fail";
  found: string;
  to_do: string;
}

const SIGNS: Record<Line["verdict"], string> = { ok: "✓", skipped: "–", warn: "!", fail: "✕" };

/** What is to be looked at comes first; else in the order of the test. */
export function worstFirst(lines: Line[]): Line[] {
  const rank = ["fail", "warn", "skipped", "ok"];
  return [...lines].sort((a, b) => rank.indexOf(a.verdict) - rank.indexOf(b.verdict));
}

export function RigPage({ model }: { model: Model }) {
  if (!model.hello?.may_control) return <NeedsSession name="Rig" what="the self-test" model={model} />;
  return <SelfTest model={model} />;
}

function SelfTest({ model }: { model: Model }) {
  const test = useFetched<{ rig: string; simulated: boolean; state: string; lines: Line[] }>("/api/selftest");
  const lines = worstFirst(test.value?.lines ?? []);
  const count = (v: Line["verdict"]) => lines.filter((l) => l.verdict === v).length;
  const verdict = count("fail") > 0 ? `✕ ${count("fail")} failed` : count("warn") > 0 ? `! ${count("warn")} to look at` : "✓ all is well";
  return (
    <main class="page">
      <section class="panel" aria-label="Rig">
        <h2>Rig {test.value?.rig ?? model.status?.rig ?? ""}{test.value?.simulated ? ", simulated" : ""}</h2>
        <div class="bar">
          {test.value && <p role="status"><b class={count("fail") ? "bad" : count("warn") ? "warning" : "good"}>{verdict}</b>
            {" "}· {count("ok")} good, {count("warn")} warnings, {count("fail")} failures, {count("skipped")} skipped</p>}
          <button type="button" onClick={test.again} disabled={test.busy}>{test.busy ? "Testing…" : "Test again"}</button>
        </div>
        {test.wrong && <p class="bad" role="alert">{test.wrong}</p>}
        {test.value && !["idle", "ready"].includes(test.value.state) && (
          <p class="warning">! The rig was {test.value.state}: noise, zeros and rates are those of a rig at rest only when nothing moves.</p>
        )}
        <div class="table-frame" tabIndex={0} role="region" aria-label="Checks">
          <table>
            <thead><tr><th scope="col">verdict</th><th scope="col">check</th><th scope="col">found</th><th scope="col">to do</th></tr></thead>
            <tbody>
              {lines.map((l) => (
                <tr key={l.check}>
                  <td class={l.verdict === "fail" ? "bad" : l.verdict === "warn" ? "warning" : l.verdict === "ok" ? "good" : ""}>{SIGNS[l.verdict]} {l.verdict}</td>
                  <th scope="row">{l.check}</th><td>{l.found}</td><td>{l.to_do}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
        <p class="note">Nothing moves and no valve opens for this. The air test, which fills and seals the chamber, and LCM are tested by hand: isorig selftest.</p>
      </section>
    </main>
  );
}
