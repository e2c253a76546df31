/** What the daemon tells of the diagnoses there are (docs/api.md, GET /v1/diagnoses), and how it is said. */
import { interval, number } from "../shared/format.ts";

export interface Parameter {
  value: number;
  ci95: [number, number];
  unit?: string;
  words?: string;
}

export interface Missing {
  effect: string;
  probability: number;
  size_N?: number;
  /** `unit` and the name in `words` as the effect's sheet has them, put there by isorig-web; no unit for a ratio. */
  parameters?: Record<string, Parameter>;
  discernible?: { seen_from_N: number | null; nearest: string | null; told_from_N: number | null };
}

interface Told {
  id: string;
  folder: string;
  kind: "diagnosis" | "investigation";
  made_utc: string;
  pages: { title: string; path: string }[];
  experiment: boolean;
  wrong?: string;
  /** Of an investigation. */
  outcome?: string;
  text?: string;
  explanations?: { effects: string; probability: number }[];
  verdict?: string;
  cannot_judge?: { why: string; record: string } | null;
  missing?: Missing[];
  alternatives?: { effects: string[]; probability: number }[];
  inseparable?: { text: string }[];
  not_modelled?: { names: string[]; why: string } | null;
  described?: { function_of: string };
  data_faults?: number;
  warnings?: string[];
  notes?: string[];
  next_experiment?: { name: string; text: string; duration_s: number; reaches_it?: boolean; separates?: string[] } | null;
}

export interface Diagnosed extends Told {
  rivals: { words: string; probability: number }[];
  caveats: string[];
}

export interface Diagnoses {
  diagnoses: Diagnosed[];
  all: number;
  cut: boolean;
  places: string[];
  words: Record<string, string>;
}

const VERDICTS: Record<string, { words: string; sign: string; mood: string }> = {
  consistent: { words: "nothing is missing that would show", sign: "✓", mood: "good" },
  missing_physics: { words: "physics is missing", sign: "!", mood: "warning" },
  unknown_physics: { words: "something is missing that no known effect explains", sign: "!", mood: "warning" },
  cannot_judge: { words: "these recordings cannot judge the model", sign: "?", mood: "warning" },
};
const OUTCOMES: Record<string, string> = {
  running: "under way", settled: "settled", consistent: "settled: nothing is missing", unknown_physics: "ended with unknown physics",
  inseparable: "ended: nothing tells the rest apart", rounds: "ended: not settled in its rounds", budget: "ended: not settled in its time", cannot_judge: "ended: cannot be judged",
};

export function verdictOf(d: Told): { words: string; sign: string; mood: string } {
  const v = VERDICTS[d.verdict ?? ""] ?? { words: d.verdict ?? "no verdict yet", sign: "?", mood: "warning" };
  return d.outcome === undefined ? v : { ...v, words: `${OUTCOMES[d.outcome] ?? d.outcome}; ${v.words}` };
}

/** "force 0.013 [0.011, 0.015] N/psi"; by the name that the files have where no sheet has another. */
export function parameterText(name: string, p: Parameter): string {
  return `${p.words ?? name} ${interval(p.value, p.ci95[0], p.ci95[1])}${p.unit ? `\u202f${p.unit}` : ""}`;
}

/** What stands beside the number of one effect. */
export function caveatsOf(m: Missing, word: (key: string) => string): string[] {
  const out: string[] = [];
  const able = m.discernible;
  if (m.probability < 0.9) out.push("not settled: less than 0.9");
  if (!able) return out;
  if (able.seen_from_N !== null && m.size_N !== undefined && m.size_N < able.seen_from_N) {
    out.push(`${number(m.size_N, 2)} N is less than the ${number(able.seen_from_N, 2)} N from which these recordings show it`);
  }
  if (able.nearest !== null && able.told_from_N === null) out.push(`these recordings cannot tell it from ${word(able.nearest)}`);
  else if (able.nearest !== null && m.size_N !== undefined && (able.told_from_N as number) > m.size_N) {
    out.push(`told from ${word(able.nearest)} from ${number(able.told_from_N, 2)} N on; this is ${number(m.size_N, 2)} N`);
  }
  return out;
}

/** What is said of the whole diagnosis, its warnings first. */
export function told(d: Told, word: (key: string) => string): Diagnosed {
  const faults = d.data_faults ?? 0;
  const rivals = d.kind === "investigation"
    ? (d.explanations ?? []).slice(1).map((e) => ({ words: word(e.effects), probability: e.probability }))
    : (d.alternatives ?? []).map((a) => ({ words: a.effects.map(word).join(" and ") || word("nominal"), probability: a.probability }));
  return {
    ...d, rivals: rivals.filter((r) => r.probability >= 0.02),
    caveats: [
      ...(d.warnings ?? []),
      ...(d.cannot_judge ? [`${d.cannot_judge.why}; to judge it, record ${d.cannot_judge.record}`] : []),
      ...(d.not_modelled ? [`not in the model: ${d.not_modelled.names.map(word).join(", ")}: ${d.not_modelled.why}`] : []),
      ...(d.described ? [`described as a function of ${d.described.function_of}, not explained`] : []),
      ...(d.inseparable ?? []).map((i) => i.text),
      ...(faults > 0 ? [faults === 1 ? "1 fault in the data; the page names it" : `${faults} faults in the data; the page lists them`] : []),
      ...(d.notes ?? []),
    ],
  };
}

/** Of a daemon of another release, one of whose files this page does not know. */
export function toldOrWrong(d: Told, word: (key: string) => string): Diagnosed {
  try {
    return told(d, word);
  } catch (error) {
    const { id, folder, kind, made_utc, pages, experiment } = d;
    return { id, folder, kind, made_utc, pages, experiment, rivals: [], caveats: [], wrong: `it is not what this page knows: ${(error as Error).message}` };
  }
}

/** The draft of what a diagnosis proposes: named after the experiment, in letters that a file may have. */
export function experimentOf(d: Told, text: string): { name: string; text: string } {
  const stem = (d.next_experiment?.name ?? "next-experiment").replace(/[^A-Za-z0-9_-]+/g, "-").replace(/^-+|-+$/g, "").slice(0, 100);
  return { name: `${stem || "next-experiment"}.toml`, text };
}
