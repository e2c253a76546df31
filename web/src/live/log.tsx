import { useState } from "preact/hooks";
import { EVENTS_KEPT, type Event, type Model } from "./model.ts";
import { Moment, Zone } from "./moment.tsx";

/** What happened, newest first: the daemon's events and the twin's. */

const LEVELS = [
  { name: "everything", has: () => true },
  { name: "without steps", has: (e: Event) => e.code !== "step" },
  { name: "warnings and stops", has: (e: Event) => e.severity !== "info" },
  { name: "stops", has: (e: Event) => e.severity !== "info" && e.severity !== "warning" },
];

export function LogPage({ model }: { model: Model }) {
  const [level, setLevel] = useState(0);
  const [search, setSearch] = useState("");
  const has = (LEVELS[level] as (typeof LEVELS)[number]).has;
  const found = model.events.filter((e) => has(e) && `${e.code} ${e.text} ${e.severity}`.toLowerCase().includes(search.toLowerCase())).reverse();
  return (
    <main class="page">
      <section class="panel" aria-label="Log">
        <h2>Log</h2>
        <div class="bar">
          <label class="search">Search <input type="search" value={search} onInput={(e) => setSearch(e.currentTarget.value)} /></label>
          <label>Show <select value={String(level)} onChange={(e) => setLevel(Number(e.currentTarget.value))}>
            {LEVELS.map((l, i) => <option key={l.name} value={String(i)}>{l.name}</option>)}
          </select></label>
        </div>
        <p class="note" role="status">{found.length} of {model.events.length} events; the newest {EVENTS_KEPT} are kept here. Who did what is in its journal: journalctl -u isorigd -u isorig-web.</p>
        <div class="table-frame" tabIndex={0} role="region" aria-label="List of events">
          <table>
            <thead><tr><th scope="col">time<Zone /></th><th scope="col">severity</th><th scope="col">code</th><th scope="col">what</th></tr></thead>
            <tbody>
              {found.map((e) => (
                <tr key={`${e.mono_ns} ${e.code}`} class={e.severity === "info" ? "" : e.severity === "warning" ? "warning" : "bad"}>
                  <td><Moment utc={new Date(1000 * model.unix_s(e.mono_ns))} digits={3} /></td>
                  <td>{e.severity === "info" ? "" : e.severity === "warning" ? "! " : "✕ "}{e.severity}</td>
                  <td>{e.code}</td>
                  <td>{e.text}{e.count > 1 ? ` (${e.count} times)` : ""}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      </section>
    </main>
  );
}
