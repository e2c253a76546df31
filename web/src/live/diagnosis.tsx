import { useMemo, useState } from "preact/hooks";
import { duration, number } from "../shared/format.ts";
import { Boundary } from "./boundary.tsx";
import { Dialog, type Say } from "./controls.tsx";
import { caveatsOf, experimentOf, parameterText, toldOrWrong, verdictOf, type Diagnosed, type Diagnoses } from "./diagnosis_words.ts";
import { isDirty, keepDraft, loadDraft, type Draft } from "./draft.ts";
import { getJson, useFetched } from "./fetched.ts";
import { HoldButton } from "./hold.tsx";
import type { Model } from "./model.ts";
import { reportAt } from "./report_link.ts";
import { Moment, Zone } from "./moment.tsx";
import { NeedsSession } from "./needs_session.tsx";

/** What was found to be missing from the models, how sure that is, and what to run next. */

export function DiagnosisPage({ model, say }: { model: Model; say: Say }) {
  if (!model.hello?.may_control) return <NeedsSession name="Diagnosis" what="the diagnoses" model={model} />;
  return <List say={say} />;
}

function List({ say }: { say: Say }) {
  const list = useFetched<Diagnoses>("/api/diagnoses");
  const [replaced, setReplaced] = useState<Draft | null>(null);
  const put = (draft: Draft) => {
    keepDraft(draft);
    say({ ok: true, status: 200, text: `${draft.name} is in the editor: look at it, and start it there`, body: {} });
    location.hash = "protocol";
  };
  /** Into the editor, checked there by the daemon; a person starts it. */
  const queue = async (d: Diagnosed) => {
    try {
      const found = await getJson<{ protocol: string }>(`/api/experiment?id=${d.id}`);
      const draft = { ...experimentOf(d, found.protocol), version: "", opened: "" };
      if (isDirty(loadDraft())) setReplaced(draft);
      else put(draft);
    } catch (error) {
      say({ ok: false, status: 0, text: (error as Error).message, body: {} });
    }
  };
  const all = useMemo(() => {
    const v = list.value, word = (key: string) => v?.words[key] ?? key;
    return v === null ? null : { ...v, diagnoses: v.diagnoses.map((d) => toldOrWrong(d, word)) };
  }, [list.value]);
  return (
    <main class="page diagnoses">
      <section class="panel" aria-label="Diagnosis">
        <h2>Diagnoses and investigations</h2>
        <div class="bar">
          <p class="note">Those that lie {all ? `in ${all.places.join(" and ")}` : "beside the runs"}, newest first: isorig diagnose … --out, isorig investigate … --out.</p>
          <button type="button" onClick={list.again} disabled={list.busy}>Look again</button>
        </div>
        {list.wrong && <p class="bad" role="alert">{list.wrong}</p>}
        {all && all.diagnoses.length === 0 && <p>There is none yet. A diagnosis of a run: isorig export RUN --out DIR, then isorig diagnose DIR/* --model slse1 --out {all.places[all.places.length - 1]}/NAME.</p>}
        {all && all.all > all.diagnoses.length && <p class="note">The newest {all.diagnoses.length} of {all.all}.</p>}
        {all?.cut && <p class="warning">! There are too many folders to look through all of them.</p>}
      </section>
      {all?.diagnoses.map((d) => <Boundary key={d.id} name={d.folder}><One d={d} words={all.words} queue={() => void queue(d)} /></Boundary>)}
      {replaced && (
        <Dialog title="The editor has a protocol that is not saved" close={() => setReplaced(null)}>
          <p>What was changed in it is lost when {replaced.name} takes its place.</p>
          <div class="row">
            <button type="button" onClick={() => { setReplaced(null); location.hash = "protocol"; }}>Go and save it</button>
            <HoldButton act={() => { setReplaced(null); put(replaced); }}>Let it go</HoldButton>
          </div>
        </Dialog>
      )}
    </main>
  );
}

function One({ d, words, queue }: { d: Diagnosed; words: Record<string, string>; queue: () => void }) {
  const verdict = verdictOf(d);
  const word = (key: string) => words[key] ?? key;
  const next = d.next_experiment;
  return (
    <section class="panel diagnosis" aria-label={d.folder}>
      <h2>{d.folder} <small>{d.kind}, <Moment utc={d.made_utc} /><Zone /></small></h2>
      {d.wrong ? <p class="bad">✕ {d.wrong}</p> : (
        <>
          <p><b class={verdict.mood}>{verdict.sign} {verdict.words}</b>{d.text ? `: ${d.text}` : ""}</p>
          {(d.missing ?? []).length > 0 && (
            <div class="table-frame" tabIndex={0} role="region" aria-label={`What is missing, ${d.folder}`}>
              <table>
                <thead><tr><th scope="col">what is missing</th><th scope="col" class="number">probability</th><th scope="col">its numbers (95 %)</th><th scope="col">what speaks against it</th></tr></thead>
                <tbody>
                  {d.missing?.map((m) => (
                    <tr key={m.effect}>
                      <th scope="row">{word(m.effect)}</th>
                      <td class="number">{number(m.probability, 2)}</td>
                      <td>{Object.entries(m.parameters ?? {}).map(([name, p]) => <div key={name}>{parameterText(name, p)}</div>)}</td>
                      <td>{caveatsOf(m, word).map((c) => <div key={c} class="warning">! {c}</div>)}</td>
                    </tr>
                  ))}
                </tbody>
              </table>
            </div>
          )}
          {d.rivals.length > 0 && <p>Other explanations: {d.rivals.map((r) => `${r.words} (p = ${number(r.probability, 2)})`).join(", ")}.</p>}
          {d.caveats.length > 0 && <ul class="caveats" aria-label="Caveats">{d.caveats.map((c) => <li key={c}>{c}</li>)}</ul>}
          {next && (
            <p>To settle it: <b>{next.text}</b>, {duration(next.duration_s)}{next.separates?.length ? `; tells apart ${next.separates.map(word).join(", ")}` : ""}
              {next.reaches_it === false ? <span class="warning"> ! It comes nearest of all, and may not be enough.</span> : ""}</p>
          )}
        </>
      )}
      <div class="bar">
        {d.pages.map((p) => <a key={p.path} href={reportAt(p.path)} target="_blank" rel="noopener">{p.title}: the whole page</a>)}
        {d.experiment && <button type="button" onClick={queue}>Queue this experiment</button>}
      </div>
    </section>
  );
}
