import type { Figure, Panel, Series } from "../shared/figure.ts";
import { duration } from "../shared/format.ts";
import type { Run } from "./runs.tsx";
import { localTime } from "./words.ts";

/** Every word stands somewhere in what is known of the run; capitals do not matter. */
export function matches(run: Run, search: string): boolean {
  const text = [run.id, run.started_utc, localTime(new Date(run.started_utc)), run.state, run.fault, run.specimen, run.rig, run.protocol, run.operator,
    ...run.notes.flatMap((n) => [n.text, n.by, n.operator, n.specimen])].join(" ").toLowerCase();
  return search.toLowerCase().split(/\s+/).every((word) => text.includes(word));
}

/** How long data were recorded; "–" of a run that has none. */
export function recordedText(recorded_s: number): string {
  return recorded_s > 0 ? duration(recorded_s) : "–";
}

/** Something is left of it: repetitions that are not done, of a run that has ended otherwise. */
export function mayGoOn(run: Pick<Run, "state" | "sessions" | "sessions_done">): boolean {
  return ["interrupted", "failed", "aborted"].includes(run.state) && run.sessions_done < run.sessions;
}

export interface Curves {
  id: string;
  /** null: the run's page has none. */
  panel: Panel | null;
}

/** The curves of runs by their names: each run's page is fetched once, until this page is loaded again, and one after the
 *  other, since the server has room for one. What failed is asked for again. */
export class CurveStore {
  private readonly known = new Map<string, Curves>();
  private last: Promise<unknown> = Promise.resolve();
  constructor(private readonly fetchPage: (id: string) => Promise<string>) {}

  get(id: string): Promise<Curves> {
    const next = this.last.then(async () => {
      const found = this.known.get(id) ?? { id, panel: curvesIn(await this.fetchPage(id)) };
      this.known.set(id, found);
      return found;
    });
    this.last = next.catch(() => undefined);
    return next;
  }
}

/** All curves in one panel: a run has one colour, and its name once in the key. null: there is none. */
export function overlaid(curves: Curves[]): Panel | null {
  const first = curves.find((c) => c.panel !== null)?.panel;
  if (!first) return null;
  const series: Series[] = curves.flatMap((c, i) => (c.panel?.series ?? []).map((s) => ({ ...s, color: i, label: c.id })));
  const { range: _x, ...x } = first.x, { range: _y, ...y } = first.y;
  return { x, y, series };
}

/** The force-velocity curves in the text of a run's own page, whose data are JSON in an element of their own. It is not made
 *  a document of: its style would have to be allowed here. */
export function curvesIn(page: string): Panel | null {
  const data = /<script type="application\/json" id="data">([^]*?)<\/script>/.exec(page)?.[1];
  if (data === undefined) return null;
  const blocks = (JSON.parse(data) as { blocks?: { figure?: Figure }[] }).blocks ?? [];
  return blocks.map((b) => b.figure).find((f) => f?.name === "force_velocity_curves")?.panels[0] ?? null;
}
