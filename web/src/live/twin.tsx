import { useState } from "preact/hooks";
import { number } from "../shared/format.ts";
import { Dialog, useLibrary, type Say } from "./controls.tsx";
import { post, type Model, type Twin } from "./model.ts";
import { ageText, clockTime } from "./words.ts";

/** The live twin: a model stepped beside the rig on the measured position and pressure (docs/web.md). */

const signed = (v: number, digits: number) => `${v < 0 ? "\u2212" : "+"}${number(Math.abs(v), digits)}`;

export function TwinValue({ model }: { model: Model }) {
  const twin = model.web?.twin;
  if (!twin || twin.force_N == null) return null;
  return <p class="twin-value">twin {twin.force_N.toFixed(2).replace("-", "\u2212")}{twin.half_N ? ` ± ${number(twin.half_N, 2)}` : ""} N</p>;
}

function phase(twin: Twin): string {
  switch (twin.phase) {
    case "waits": return "begins when a session's filling is done";
    case "settles": return "learns what its arms hold; is judged from the first move on";
    case "stands": return "is not judged while the run stands";
    case "parted": return "and the muscle have parted";
    default: return twin.learning ? "is judged; how alike its residuals are is learnt in the first minute" : "is judged";
  }
}

/** How far the sum is on its way to the alarm. */
function Sum({ name, value, h }: { name: string; value: number; h: number }) {
  const share = Math.min(1, value / h);
  return (
    <div class="sum">
      <span>{name}</span>
      <meter min={0} max={1} high={0.99} value={share} aria-label={`${name}: ${Math.round(100 * share)} per cent of the alarm`} />
      <span>{number(value, 2)} of {number(h, 3)}</span>
    </div>
  );
}

export function TwinPanel({ model, choose }: { model: Model; choose: () => void }) {
  const twin = model.web?.twin;
  if (!twin) return null;
  const mine = model.lease.mine;
  const button = model.hello?.may_control && (
    <button type="button" disabled={!mine} title={mine ? undefined : "Take control first"} onClick={choose}>Twin…</button>
  );
  if (twin.model === null) {
    if (!button && !twin.why) return null;
    return (
      <section class="panel twin" aria-label="Twin">
        <h2>Twin {button}</h2>
        {twin.why ? <p class="warning">! {twin.why}</p> : <p>No model is stepped beside the rig.</p>}
      </section>
    );
  }
  const judged = twin.judged ?? 0;
  const p = twin.parting;
  const age = ageText((performance.now() - model.status_ms) / 1000);
  return (
    <section class={`panel twin ${p ? "parted" : ""} ${age ? "stale" : ""}`} aria-label="Twin">
      <h2>Twin {button}</h2>
      {age && <p class="age">{age}</p>}
      <p><b>{twin.model}</b> {phase(twin)}{twin.by_protocol ? " (the protocol's)" : ""}.
        {twin.on_parting === "mark" ? "" : ` A parting will ${twin.on_parting} the run.`}</p>
      {p && (
        <p class="bad" role="alert">✕ Parted {clockTime(model.unix_s(p.mono_ns), (model.web?.unix_ms ?? 0) / 1000)} in step {p.step + 1}, {p.text}:
          {" "}measured minus twin {signed(p.residual_N, 3)} N</p>
      )}
      {twin.band === false && <p class="warning">! The model does not say what it has seen: no band, not judged.</p>}
      {twin.outside && <p class="warning">! Outside of what the model has seen; the band is wider.</p>}
      {judged > 0 && (
        <>
          <p>In the band: <b>{(100 * (twin.covered ?? 0) / judged).toFixed(1)} %</b> of {judged.toLocaleString("en-GB")} samples (95 % expected);
            now {signed(twin.residual ?? 0, 2)} standard errors</p>
          <Sum name="CUSUM +" value={twin.high ?? 0} h={twin.h ?? 1} />
          <Sum name="CUSUM −" value={twin.low ?? 0} h={twin.h ?? 1} />
        </>
      )}
      {(twin.notes ?? []).map((n) => <p key={n} class="note">{n}</p>)}
    </section>
  );
}

export function TwinDialog({ model, close, say }: { model: Model; close: () => void; say: Say }) {
  const library = useLibrary();
  const now = model.web?.twin;
  const [file, setFile] = useState(now?.model ?? "");
  const [upload, setUpload] = useState<{ name: string; text: string } | null>(null);
  const [parting, setParting] = useState(now?.on_parting ?? "mark");
  const [refused, setRefused] = useState("");
  const send = async (body: object) => {
    const reply = await post("twin", body);
    if (!reply.ok) return setRefused(reply.text);
    say(reply);
    close();
  };
  const ready = upload !== null || library.models.includes(file);
  return (
    <Dialog title="A model beside the rig" close={close}>
      <form onSubmit={(e) => {
        e.preventDefault();
        void send({ on_parting: parting, ...(upload ? { model: upload.text, model_name: upload.name } : { model_file: file }) });
      }}>
        <p>The model is stepped on the measured position and pressure. Its force is drawn beside the measured one, and where the two part is marked.</p>
        <label>Model
          <select value={upload ? "" : file} onChange={(e) => { setUpload(null); setFile(e.currentTarget.value); }}>
            <option value="">{upload ? upload.name : "choose…"}</option>
            {library.models.map((name) => <option key={name}>{name}</option>)}
          </select>
        </label>
        <label>or a file of yours (model.toml of a diagnosis)
          <input type="file" accept=".toml" onChange={async (e) => {
            const chosen = e.currentTarget.files?.[0];
            if (chosen) setUpload({ name: chosen.name, text: await chosen.text() });
          }} />
        </label>
        <label>Where model and muscle part
          <select value={parting} onChange={(e) => setParting(e.currentTarget.value as typeof parting)}>
            <option value="mark">mark it</option>
            <option value="pause">mark it, and pause the run</option>
            <option value="abort">mark it, and abort the run (the pressure vents)</option>
          </select>
        </label>
        {refused && <pre class="refused" role="alert">{refused}</pre>}
        <div class="row">
          <button type="button" onClick={close}>Cancel</button>
          {now?.model && <button type="button" onClick={() => void send({})}>Put away</button>}
          <button type="submit" class="start" disabled={!ready}>Step it</button>
        </div>
      </form>
    </Dialog>
  );
}
