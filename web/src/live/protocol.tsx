import { useEffect, useRef, useState } from "preact/hooks";
import { Dialog, useLibrary, type Say } from "./controls.tsx";
import type { CheckedPlan, Diagnostic } from "./checked_plan.ts";
import { isDirty, keepDraft, loadDraft, nameFault, SKELETON, type Draft } from "./draft.ts";
import { Editor } from "./editor.tsx";
import { getJson } from "./fetched.ts";
import { HoldButton } from "./hold.tsx";
import { post, type Model } from "./model.ts";
import { NeedsSession } from "./needs_session.tsx";
import { PlanView } from "./plan_view.tsx";
import { Protocols, StartDialog } from "./start.tsx";

/** A protocol is written, checked by the daemon while it is written, drawn, saved, and started by the dialog that starts any. */

/** After the last key. */
const SETTLED_MS = 400;
const BUSY_MS = 700;
const UNAVAILABLE = 503;

export function ProtocolPage({ model, say }: { model: Model; say: Say }) {
  if (!model.hello?.may_control) return <NeedsSession name="Protocol" what="and edit protocols" model={model} />;
  return <Workshop model={model} say={say} />;
}

interface Checked {
  /** That was checked; another text is not yet. */
  text: string;
  plan: CheckedPlan | null;
  wrong: Diagnostic[];
  /** What is wrong and has no place. */
  why: string;
}

/** The daemon's answer to the text, asked again when it has changed; one question at a time. */
function useChecked(name: string, text: string): Checked | null {
  const [checked, set] = useState<Checked | null>(null);
  const now = useRef({ name, text });
  now.current = { name, text };
  const busy = useRef(false), gone = useRef(false);
  const ask = async () => {
    if (busy.current || gone.current) return;
    busy.current = true;
    const asked = now.current;
    const reply = await post("check", { protocol: asked.text, protocol_name: asked.name });
    busy.current = false;
    if (gone.current) return;
    if (reply.status === UNAVAILABLE) {
      window.setTimeout(() => void ask(), BUSY_MS);
      return;
    }
    const wrong = (reply.body["diagnostics"] as Diagnostic[] | undefined) ?? [];
    set({ text: asked.text, plan: reply.ok ? (reply.body as unknown as CheckedPlan) : null, wrong, why: reply.ok || wrong.length > 0 ? "" : reply.text });
    if (now.current.text !== asked.text || now.current.name !== asked.name) void ask();
  };
  useEffect(() => {
    const timer = window.setTimeout(() => void ask(), SETTLED_MS);
    return () => window.clearTimeout(timer);
  }, [name, text]);
  useEffect(() => () => {
    gone.current = true;
  }, []);
  return checked;
}

function Workshop({ model, say }: { model: Model; say: Say }) {
  const [draft, setDraft] = useState<Draft>(() => loadDraft());
  const [turn, setTurn] = useState(0);
  const library = useLibrary(turn);
  const [go, setGo] = useState<{ line: number; column: number } | null>(null);
  const [conflict, setConflict] = useState<{ text: string; version: string } | null>(null);
  const [leaving, setLeaving] = useState<Draft | null>(null);
  const [starting, setStarting] = useState(false);
  const checked = useChecked(draft.name, draft.text);
  useEffect(() => keepDraft(draft), [draft]);
  const change = (part: Partial<Draft>) => {
    setConflict(null);
    setDraft((d) => ({ ...d, ...part }));
  };
  /** Another draft in place of this one; asked first when this one is not saved. */
  const take = (next: Draft) => (isDirty(draft) ? setLeaving(next) : change(next));
  const open = async (choice: string) => {
    const [from, name] = choice.split("/") as [string, string];
    try {
      const found = await getJson<{ protocol: string; version: string }>(`/api/protocol?from=${from}&name=${name}`);
      take({ name, text: found.protocol, version: found.version, opened: found.protocol });
    } catch (error) {
      say({ ok: false, status: 0, text: (error as Error).message, body: {} });
    }
  };
  const save = async (replaces: string) => {
    const { name, text } = draft;
    const reply = await post("save", { name, protocol: text, replaces });
    if (reply.body["there_already"] === true) return setConflict({ text: reply.text, version: String(reply.body["version"] ?? "") });
    say(reply);
    if (!reply.ok) return;
    setConflict(null);
    setDraft((d) => ({ ...d, version: String(reply.body["version"] ?? ""), opened: text }));
    setTurn((n) => n + 1);
  };
  const fresh = checked !== null && checked.text === draft.text;
  const fault = nameFault(draft.name);
  const ready = model.status?.state === "ready";
  const why = !model.lease.mine ? "Take control first" : !ready ? "The rig is not ready" : !fresh || !checked?.plan ? "Not yet: it has to be checked and well" : undefined;
  const places = checked?.wrong ?? [];
  return (
    <main class="page protocol">
      <section class="panel" aria-label="Protocol">
        <h2>Protocol {isDirty(draft) && <small>not saved</small>}</h2>
        <div class="bar">
          <label>Open
            <select value="" onChange={(e) => { const c = e.currentTarget.value; e.currentTarget.value = ""; if (c) void open(c); }}>
              <option value="">choose…</option>
              <Protocols library={library} />
            </select>
          </label>
          <button type="button" onClick={() => take({ name: "new.toml", text: SKELETON, version: "", opened: SKELETON })}>New</button>
          <label class="grows">Name
            <input value={draft.name} maxLength={128} aria-invalid={fault !== ""} onInput={(e) => change({ name: e.currentTarget.value, version: "" })} />
          </label>
          <button type="button" disabled={fault !== ""} title={fault || undefined} onClick={() => void save(draft.version)}>Save</button>
          <button type="button" class="start" disabled={why !== undefined} title={why} onClick={() => setStarting(true)}>Start this…</button>
        </div>
        {fault && <p class="bad" role="alert">{fault}</p>}
        {conflict && (
          <div class="conflict" role="alert">
            <p class="warning">! {conflict.text}. Save by another name, or replace it: what is there now is kept as {draft.name}~.</p>
            <HoldButton act={() => void save(conflict.version)}>Replace {draft.name}</HoldButton>
          </div>
        )}
        <Editor text={draft.text} wrong={fresh ? places : []} change={(text) => change({ text })} go={go} />
        <div id="diagnostics" role="status" class="diagnostics">
          {!fresh ? <p>… being checked by the daemon</p>
            : checked?.plan ? <p class="good">✓ {draft.name} is well: {checked.plan.protocol}</p>
            : checked?.why ? <p class="bad">✕ {checked.why}</p>
            : <p class="bad">✕ {places.length} {places.length === 1 ? "error" : "errors"}, as isorig check says {places.length === 1 ? "it" : "them"}</p>}
          {fresh && places.length > 0 && (
            <ol>
              {places.map((d) => (
                <li key={d.text}><button type="button" class="link" onClick={() => setGo({ line: d.line, column: d.column })}>{d.text}</button></li>
              ))}
            </ol>
          )}
        </div>
      </section>
      <section class="panel dry-run" aria-label="Dry run">
        <h2>Dry run: what it would do</h2>
        {checked?.plan ? <div class={fresh ? "" : "stale"}><PlanView plan={checked.plan} goTo={(line) => setGo({ line, column: 1 })} /></div>
          : <p>{checked === null ? "…" : "Nothing is drawn before every error is mended."}</p>}
      </section>
      {leaving && (
        <Dialog title={`${draft.name} is not saved`} close={() => setLeaving(null)}>
          <p>What was changed in it is lost when {leaving.name} takes its place.</p>
          <div class="row">
            <button type="button" onClick={() => setLeaving(null)}>Keep editing</button>
            <HoldButton act={() => { change(leaving); setLeaving(null); }}>Let it go</HoldButton>
          </div>
        </Dialog>
      )}
      {starting && <StartDialog model={model} say={say} given={{ name: draft.name, text: draft.text }} close={() => setStarting(false)} />}
    </main>
  );
}
