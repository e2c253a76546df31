import { useState } from "preact/hooks";
import { duration } from "../shared/format.ts";
import { Dialog, useLibrary, type Say } from "./controls.tsx";
import { HoldButton } from "./hold.tsx";
import { post, type Model, type Reply } from "./model.ts";

/** The start of a run, or of what is left of one: with specimen and operator, shown first, then held. */

const OWN = " own";

/** A run that goes on: what may be different from before is said by the person for each. */
interface Resumed {
  run: string;
  aborted: boolean;
}

const DIFFERENT = [
  { key: "another_specimen", text: "another specimen is mounted than it was begun with; noted in the run" },
  { key: "on_another_rig", text: "it was begun on another rig; noted in the run" },
] as const;

export function StartDialog({ model, close, say, given, resume }: {
  model: Model; close: () => void; say: Say;
  /** The text to start, in place of a choice. */
  given?: { name: string; text: string };
  resume?: Resumed;
}) {
  const library = useLibrary();
  const [file, setFile] = useState("");
  const [upload, setUpload] = useState<{ name: string; text: string } | null>(given ?? null);
  const [specimen, setSpecimen] = useState("");
  const [operator, setOperator] = useState(model.hello?.name ?? "");
  const [different, setDifferent] = useState<Record<string, boolean>>({});
  const [seen, setSeen] = useState<Reply | null>(null);
  const [asking, setAsking] = useState(false);
  const ready = (resume !== undefined || file !== "" || upload !== null) && specimen !== "" && operator.trim() !== "" &&
    (!resume?.aborted || different["resume_aborted"] === true);
  const body = () => ({
    operator: operator.trim(),
    specimen_file: specimen === OWN ? "" : specimen,
    ...(resume ? { resume_run: resume.run, ...different }
      : upload ? { protocol: upload.text, protocol_name: upload.name }
      : { protocol_from: file.split("/")[0], protocol_file: file.split("/")[1] }),
  });
  const changed = <T,>(set: (value: T) => void) => (value: T) => {
    set(value);
    setSeen(null);
  };
  const check = async () => {
    setAsking(true);
    setSeen(await post("preview", body()));
    setAsking(false);
  };
  const start = async () => {
    const { protocol_version, specimen_version } = seen?.body ?? {};  // what was shown is what starts
    const reply = await post("start", { ...body(), protocol_version, specimen_version });
    say(reply);
    if (reply.ok) close();
    else setSeen(reply);
  };
  const p = seen?.ok ? seen.body : null;
  const value = (key: string) => Number(p?.[key] ?? 0);
  const box = (key: string, text: string) => (
    <label class="box" key={key}>
      <input type="checkbox" checked={different[key] === true} onChange={(e) => changed(setDifferent)({ ...different, [key]: e.currentTarget.checked })} />
      <span>{text}</span>
    </label>
  );
  return (
    <Dialog title={resume ? `Go on with ${resume.run}` : "Start a run"} close={close}>
      <form onSubmit={(e) => { e.preventDefault(); if (ready) void check(); }}>
        {resume && <p>Its protocol goes on from the first repetition that is not done.</p>}
        {given && <p>Protocol <b>{given.name}</b>, as it stands in the editor.</p>}
        {!resume && !given && <>
          <label>Protocol
            <select value={upload ? "" : file} onChange={(e) => { setUpload(null); changed(setFile)(e.currentTarget.value); }}>
              <option value="">{upload ? upload.name : "choose…"}</option>
              <Protocols library={library} />
            </select>
          </label>
          <label>or a file of yours
            <input type="file" accept=".toml" onChange={async (e) => {
              const chosen = e.currentTarget.files?.[0];
              if (chosen) changed(setUpload)({ name: chosen.name, text: await chosen.text() });
            }} />
          </label>
        </>}
        <label>Specimen that is mounted
          <select value={specimen} onChange={(e) => changed(setSpecimen)(e.currentTarget.value)}>
            <option value="">choose…</option>
            <option value={OWN}>the one that the rig's file names</option>
            {library.specimens.map((name) => <option key={name}>{name}</option>)}
          </select>
        </label>
        <label>Operator
          <input value={operator} maxLength={64} onInput={(e) => changed(setOperator)(e.currentTarget.value)} />
        </label>
        {resume && (
          <fieldset>
            <legend>Go on although …</legend>
            {resume.aborted && box("resume_aborted", "an operator had ended it")}
            {DIFFERENT.map((d) => box(d.key, d.text))}
          </fieldset>
        )}
        {seen && !seen.ok && <pre class="refused" role="alert">{seen.text}</pre>}
        {p && (
          <dl class="seen">
            <dt>rig</dt><dd>{String(p["rig"] ?? "")}{p["simulated"] ? " (simulated)" : ""}</dd>
            <dt>specimen</dt><dd>{String(p["specimen"] ?? "")}, {value("rest_length_mm")} mm at rest</dd>
            <dt>protocol</dt><dd>{String(p["protocol"] ?? "")}: {value("sessions")} sessions, {duration(Math.round(value("nominal_s")))}, {duration(Math.round(value("worst_s")))} at worst</dd>
            {resume && <><dt>goes on</dt><dd>from repetition {value("first_session") + 1} of {value("sessions")}</dd></>}
            <dt>reach</dt><dd>up to {value("pressure_max_psi")} psi, {value("position_min_mm")} to {value("position_max_mm")} mm</dd>
            {p["changed"] ? <><dt>changed</dt><dd class="warning">{String(p["changed"])}</dd></> : null}
            {p["warnings"] ? <><dt>warnings</dt><dd class="warning">{String(p["warnings"]).trim()}</dd></> : null}
          </dl>
        )}
        <div class="row">
          <button type="button" onClick={close}>Cancel</button>
          <button type="submit" disabled={!ready || asking}>{asking ? "Checking…" : "Check"}</button>
          <HoldButton class="start" disabled={p === null} title={p === null ? "Check first" : "Hold to start"} act={() => void start()}>{resume ? "Go on" : "Start"}</HoldButton>
        </div>
      </form>
    </Dialog>
  );
}

/** Options of a choice: where a protocol lies, a slash, its name. */
export function Protocols({ library }: { library: { protocols: string[]; saved: string[] } }) {
  return (
    <>
      {library.saved.length > 0 && <optgroup label="saved here">{library.saved.map((n) => <option key={`saved/${n}`} value={`saved/${n}`}>{n}</option>)}</optgroup>}
      <optgroup label="installed">{library.protocols.map((n) => <option key={`shipped/${n}`} value={`shipped/${n}`}>{n}</option>)}</optgroup>
    </>
  );
}
