import { useEffect, useRef, useState } from "preact/hooks";
import { HoldButton } from "./hold.tsx";
import { post, type Model, type Reply } from "./model.ts";

/** What a person may do here: who has control, the verbs, the start of a run, the correction of one. */

export type Say = (reply: Reply) => void;

export function Control({ model, say }: { model: Model; say: Say }) {
  const { hello, lease } = model;
  if (!hello?.may_control) {
    return (
      <span class="who" title="In a terminal on the rig's machine: isorig web">
        View only{lease.holder === null ? "" : ` · ${lease.holder} has control`}
      </span>
    );
  }
  const act = (action: string) => post("lease", { action }).then(say);
  const leave = <button type="button" class="leave" title="This browser looks on alone from then; control that it has is given back" onClick={() => post("leave").then(say)}>Leave</button>;
  if (lease.mine) {
    return <span class="who"><b>{hello.name}</b> · control is here <button type="button" onClick={() => act("give-back")}>Give back</button> {leave}</span>;
  }
  if (lease.holder === null) {
    return <span class="who">{hello.name} · nobody has control <button type="button" class="take" onClick={() => act("take")}>Take control</button> {leave}</span>;
  }
  return (
    <span class="who">{hello.name} · <b>{lease.holder}</b> has control{" "}
      <HoldButton act={() => act("take-over")} title="Hold: is that agreed with who has it? It is logged">Take over</HoldButton>{" "}
      {leave}
    </span>
  );
}

export function Verbs({ model, say, onStart, onNote }: { model: Model; say: Say; onStart: () => void; onNote: () => void }) {
  const { status, hello, lease } = model;
  if (!hello?.may_control) return null;
  const verb = (name: string) => () => void post(name).then(say);
  const s = status?.state, mine = lease.mine;
  const first = mine ? undefined : "Take control first";
  return (
    <div class="verbs" role="group" aria-label="Run">
      {s === "ready" && <button type="button" class="start" disabled={!mine} title={first} onClick={onStart}>Start…</button>}
      {s === "armed" && <HoldButton class="start" disabled={!mine} title={first} act={verb("go")}>Go</HoldButton>}
      {s === "paused" && <HoldButton class="start" disabled={!mine} title={first} act={verb("resume")}>Resume</HoldButton>}
      {s === "faulted" && <HoldButton disabled={!mine} title={first} act={verb("reset")}>Reset</HoldButton>}
      {status?.zero_confirmed === false && <HoldButton disabled={!mine} title={first} act={verb("confirm-zero")}>Zero is right</HoldButton>}
      {/* Whatever the page knows of the state: it may be old or missing while the rig moves. */}
      <button type="button" class="pause" title="At once (key p)" onClick={verb("pause")}>❚❚ Pause</button>
      <HoldButton class="abort" title="Hold: the frame stops, the pressure vents" act={verb("abort")}>Abort</HoldButton>
      {(status?.run !== undefined || status?.last_run?.id) && <button type="button" onClick={onNote}>Note…</button>}
    </div>
  );
}

export interface Library {
  protocols: string[];
  /** Those of the page's own folder. */
  saved: string[];
  specimens: string[];
  models: string[];
}

export function Dialog(props: { title: string; close: () => void; children: preact.ComponentChildren }) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    dialog.current?.showModal();
  }, []);
  return (
    <dialog ref={dialog} onClose={props.close} aria-labelledby="dialog-title">
      <h2 id="dialog-title">{props.title}</h2>
      {props.children}
    </dialog>
  );
}

/** Asked for again when `turn` changes. */
export function useLibrary(turn = 0): Library {
  const [library, set] = useState<Library>({ protocols: [], saved: [], specimens: [], models: [] });
  useEffect(() => {
    void fetch("/api/library").then((a) => (a.ok ? a.json() : library)).then((l) => set(l as Library), () => {});
  }, [turn]);
  return library;
}

/** What is known of a run is put right afterwards: the recording stays, and the change leaves a trace. */
export function NoteDialog({ model, close, say, run: given }: { model: Model; close: () => void; say: Say; run?: string }) {
  const library = useLibrary();
  const run = given ?? model.status?.run?.id ?? model.status?.last_run?.id ?? "";
  const [operator, setOperator] = useState("");
  const [specimen, setSpecimen] = useState("");
  const [text, setText] = useState("");
  const [refused, setRefused] = useState("");
  const send = async () => {
    const reply = await post("note", {
      run, ...(operator.trim() ? { operator: operator.trim() } : {}), ...(text.trim() ? { text: text.trim() } : {}),
      ...(specimen ? { specimen_file: specimen } : {}),
    });
    say(reply);
    if (reply.ok) close();
    else setRefused(reply.text);
  };
  return (
    <Dialog title={`Note to ${run}`} close={close}>
      <form onSubmit={(e) => { e.preventDefault(); void send(); }}>
        <p>Leave empty what is right. The recording stays as it was; what is changed here is kept beside it, with your name.</p>
        <label>Operator <input value={operator} maxLength={64} onInput={(e) => setOperator(e.currentTarget.value)} /></label>
        <label>Specimen
          <select value={specimen} onChange={(e) => setSpecimen(e.currentTarget.value)}>
            <option value="">as it is</option>
            {library.specimens.map((name) => <option key={name}>{name}</option>)}
          </select>
        </label>
        <label>Note <textarea rows={3} value={text} onInput={(e) => setText(e.currentTarget.value)} /></label>
        {refused && <pre class="refused" role="alert">{refused}</pre>}
        <div class="row">
          <button type="button" onClick={close}>Cancel</button>
          <button type="submit" disabled={!operator.trim() && !specimen && !text.trim()}>Keep</button>
        </div>
      </form>
    </Dialog>
  );
}
