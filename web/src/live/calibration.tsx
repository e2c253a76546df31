import { number } from "../shared/format.ts";
import { useFetched } from "./fetched.ts";
import type { Model } from "./model.ts";
import { Moment, Zone } from "./moment.tsx";
import { NeedsSession } from "./needs_session.tsx";

/** What corrects the readings, until when, and every record there is. */

interface InForce {
  unit: string;
  scale: number;
  offset: number;
  /** Empty: as the devices send it. */
  id: string;
  made_utc?: string;
  due?: string;
  overdue?: boolean;
  operator?: string;
  reference?: string;
  uncertainty_k2?: number;
  as_found_max_error?: number;
  within_error_band?: boolean;
}

interface Kept {
  id: string;
  channel: string;
  mode: string;
  made_utc: string;
  due: string;
  operator: string;
  reference: string;
  scale: number;
  offset: number;
  uncertainty_k2: number;
  supersedes: string;
  toml: string;
}

export function CalibrationPage({ model }: { model: Model }) {
  if (!model.hello?.may_control) return <NeedsSession name="Calibration" what="the calibration" model={model} />;
  return <Records model={model} />;
}

function Records({ model }: { model: Model }) {
  const all = useFetched<{ in_force: Record<string, InForce>; records: Kept[]; directory: string }>("/api/calibrations");
  const records = [...(all.value?.records ?? [])].sort((a, b) => b.made_utc.localeCompare(a.made_utc));
  return (
    <main class="page">
      <section class="panel" aria-label="Calibration in force">
        <h2>Calibration in force</h2>
        <div class="bar">
          <p class="note">Readings are corrected as scale × reading + offset; the raw ones are recorded beside them. A new record: isorig calibrate, with a reference at the rig.</p>
          <button type="button" onClick={all.again} disabled={all.busy}>Look again</button>
        </div>
        {all.wrong && <p class="bad" role="alert">{all.wrong}</p>}
        <div class="table-frame" tabIndex={0} role="region" aria-label="In force">
          <table>
            <thead><tr><th scope="col">channel</th><th scope="col">state</th><th scope="col">scale</th><th scope="col">offset</th><th scope="col">± (k = 2)</th>
              <th scope="col">as found</th><th scope="col">made<Zone /></th><th scope="col">due</th><th scope="col">operator</th><th scope="col">reference</th></tr></thead>
            <tbody>
              {Object.entries(all.value?.in_force ?? {}).map(([channel, f]) => (
                <tr key={channel}>
                  <th scope="row">{channel}</th>
                  <td class={f.id === "" ? "warning" : f.overdue ? "bad" : "good"}>{f.id === "" ? "! none on record" : f.overdue ? "✕ overdue" : "✓ in force"}</td>
                  <td>{number(f.scale, 6)}</td>
                  <td>{number(f.offset, 4)} {f.unit}</td>
                  <td>{f.uncertainty_k2 === undefined ? "–" : `${number(f.uncertainty_k2, 2)} ${f.unit}`}</td>
                  <td class={f.within_error_band === false ? "bad" : ""}>{f.as_found_max_error === undefined ? "–" : `off by up to ${number(f.as_found_max_error, 2)} ${f.unit}${f.within_error_band ? "" : ": outside of its error band"}`}</td>
                  <td>{f.made_utc ? <Moment utc={f.made_utc} day /> : "–"}</td><td>{f.due ?? "–"}</td><td>{f.operator ?? "–"}</td><td>{f.reference ?? "–"}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      </section>
      <section class="panel" aria-label="Calibration records">
        <h2>Records</h2>
        {all.value && records.length === 0 && <p>There is none yet in {all.value.directory}. The rig {model.status?.rig ?? ""} reads as its devices send.</p>}
        {records.length > 0 && (
          <div class="table-frame" tabIndex={0} role="region" aria-label="Records">
            <table>
              <thead><tr><th scope="col">made<Zone /></th><th scope="col">channel</th><th scope="col">record</th><th scope="col">mode</th><th scope="col">scale</th><th scope="col">offset</th>
                <th scope="col">± (k = 2)</th><th scope="col">due</th><th scope="col">operator</th><th scope="col">reference</th><th scope="col">replaces</th></tr></thead>
              <tbody>
                {records.map((r) => (
                  <tr key={r.id}>
                    <td><Moment utc={r.made_utc} /></td><td>{r.channel}</td>
                    <th scope="row"><details><summary>{r.id}</summary><pre>{r.toml}</pre></details></th>
                    <td>{r.mode}</td><td>{number(r.scale, 6)}</td><td>{number(r.offset, 4)}</td><td>{number(r.uncertainty_k2, 2)}</td>
                    <td>{r.due}</td><td>{r.operator}</td><td>{r.reference}</td><td>{r.supersedes || "–"}</td>
                  </tr>
                ))}
              </tbody>
            </table>
          </div>
        )}
      </section>
    </main>
  );
}
