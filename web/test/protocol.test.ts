import assert from "node:assert/strict";
import { test } from "node:test";
import { courseOf, panelsOf, stepsOf, timeUnit, type CheckedPlan } from "../src/live/checked_plan.ts";
import { caveatsOf, experimentOf, parameterText, told, verdictOf } from "../src/live/diagnosis_words.ts";
import { isDirty, keepDraft, loadDraft, nameFault, offsetOf } from "../src/live/draft.ts";
import { mayGoOn } from "../src/live/run_list.ts";

/** Steps one after the other: kind, seconds, worst, position before and after, amplitude, pressure, slope of the pressure. */
function planOf(rows: [string, number, number, number, number, number, number, number][]): CheckedPlan {
  let at = 0;
  const start_s = rows.map((r) => (at += r[1]) - r[1]);
  const column = (i: number) => rows.map((r) => r[i] as number);
  return {
    rig: "r", protocol: "p", description: "", nominal_s: at, worst_s: column(2).reduce((a, b) => a + b, 0), full_rate_s: 0, average_interval_s: 0.1,
    travel_mm: 0, peak_speed_mm_s: 0, position_min_mm: 0, position_max_mm: 0, pressure_max_psi: 0, sessions: ["one"], warnings: [],
    steps: {
      do: rows.map((r) => r[0]), session: rows.map(() => 0), start_s, nominal_s: column(1), worst_s: column(2), position_before_mm: column(3),
      position_after_mm: column(4), amplitude_mm: column(5), pressure_psi: column(6), rate_psi_s: column(7), line: rows.map((_, i) => i + 1), text: [],
    },
  };
}

const SHORT = planOf([
  ["pressurize", 4, 20, 0, 0, 0, 6, 2],  // 3 s of slope, 1 s to settle
  ["ramp", 2, 2, 0, 1, 0, 6, 0],
  ["wave", 4, 4, 1, 1, 0.5, 6, 0],
]);

test("the course of a short protocol is exact: slopes, corners, and what a wave spans", () => {
  const c = courseOf(SHORT, 0, 10);
  assert.ok(c.exact);
  assert.deepEqual(c.x, [0, 3, 4, 4, 6, 6, 10]);
  assert.deepEqual(c.pressure_low, [0, 6, 6, 6, 6, 6, 6]);
  assert.deepEqual(c.low, [0, 0, 0, 0, 1, 0.5, 0.5]);
  assert.deepEqual(c.high, [0, 0, 0, 0, 1, 1.5, 1.5]);
});

test("of many steps none is left out: the stretch has its extremes", () => {
  const rows = Array.from({ length: 20_000 }, (_, i) => ["hold", 1, 1, 0, 0, i === 12_345 ? 3 : 0, i < 10_000 ? 5 : 10, 0] as [string, number, number, number, number, number, number, number]);
  const c = courseOf(planOf(rows), 0, 20_000);
  assert.ok(!c.exact && c.x.length <= 900);
  assert.equal(Math.max(...c.high), 3);
  assert.equal(Math.min(...c.low), -3);
  assert.deepEqual([Math.min(...c.pressure_low), Math.max(...c.pressure_high)], [5, 10]);
  // Enlarged they are exact again.
  assert.ok(courseOf(planOf(rows), 12_000, 12_500).exact);
});

test("each step at its longest follows the one before at its longest", () => {
  assert.deepEqual(stepsOf(SHORT, true).map((s) => s.start_s), [0, 20, 22]);
  assert.deepEqual(stepsOf(SHORT, false).map((s) => s.start_s), [0, 4, 6]);
  assert.equal(timeUnit(SHORT.nominal_s).name, "s");
  assert.equal(timeUnit(80_000).name, "h");
  const panels = panelsOf(SHORT, 0, 10, timeUnit(10));
  assert.deepEqual(panels.map((p) => p.y.unit), ["mm", "psi"]);
  assert.ok(panels[0]?.series.some((s) => s.mark === "band"), "a wave is a band");
});

test("a place in the text is found by line and column in characters", () => {
  const text = "a = 1\nb = \"µm 𝟙\" # x\nlast";
  assert.deepEqual(offsetOf(text, 1, 5), [4, 5]);
  assert.equal(text.slice(...offsetOf(text, 2, 12)), "# x");
  assert.equal(text.slice(...offsetOf(text, 3, 1)), "last");
  assert.deepEqual(offsetOf(text, 99, 99), [text.length, text.length]);
});

test("a draft is kept whole, and what is no draft is left", () => {
  const storage = () => {
    const kept = new Map<string, string>();
    return { kept, getItem: (k: string) => kept.get(k) ?? null, setItem: (k: string, v: string) => void kept.set(k, v) };
  };
  const tab = storage(), browser = storage(), both = [tab, browser];
  const first = loadDraft(both);
  assert.ok(!isDirty(first));
  keepDraft({ ...first, text: "x = 1", name: "mine.toml" }, both);
  assert.ok(isDirty(loadDraft(both)));
  assert.equal(loadDraft(both).name, "mine.toml");
  // Another tab keeps its own; a new one begins with what was written last.
  const other = storage();
  keepDraft({ ...first, name: "other.toml" }, [other, browser]);
  assert.equal(loadDraft(both).name, "mine.toml");
  assert.equal(loadDraft([storage(), browser]).name, "other.toml");
  for (const s of both) s.kept.set("protocol-draft", "{\"name\": 1}");
  assert.equal(loadDraft(both).name, "new.toml");
  const full = { setItem: () => { throw new Error("full"); } };
  keepDraft({ ...first, name: "late.toml" }, [full, browser]);
  assert.equal(loadDraft([browser]).name, "late.toml");
  for (const name of ["a.toml", "vma-1.2_x.toml"]) assert.equal(nameFault(name), "", name);
  for (const name of ["", "a", ".toml", ".a.toml", "a/b.toml", "a b.toml", `${"a".repeat(130)}.toml`]) assert.notEqual(nameFault(name), "", name);
});

const FOUND = {
  id: "1", folder: "f", kind: "diagnosis" as const, made_utc: "", pages: [], experiment: true, verdict: "missing_physics",
  alternatives: [{ effects: ["a", "b"], probability: 0.3 }, { effects: [], probability: 0.1 }, { effects: ["c"], probability: 0.001 }],
  warnings: ["w"], inseparable: [{ text: "i" }], data_faults: 2, notes: ["n"],
  not_modelled: { names: ["a"], why: "it predicts worse" }, cannot_judge: null,
};

test("a diagnosis is told with what speaks against it", () => {
  const word = (key: string) => ({ a: "A", b: "B", nominal: "nothing missing" })[key] ?? key;
  const d = told(FOUND, word);
  assert.deepEqual(d.rivals.map((r) => r.words), ["A and B", "nothing missing"]);
  assert.deepEqual(d.caveats, ["w", "not in the model: A: it predicts worse", "i", "2 faults in the data; the page lists them", "n"]);
  const able = { seen_from_N: 0.02, nearest: "a", told_from_N: 0.5 };
  assert.deepEqual(caveatsOf({ effect: "x", probability: 0.95, size_N: 0.6, discernible: able }, word), []);
  assert.equal(caveatsOf({ effect: "x", probability: 0.5, size_N: 0.01, discernible: able }, word).length, 3);
  assert.match(caveatsOf({ effect: "x", probability: 1, size_N: 1, discernible: { ...able, told_from_N: null } }, word)[0] ?? "", /cannot tell it from A/);
  assert.equal(verdictOf({ ...FOUND, verdict: "consistent" }).mood, "good");
  assert.match(verdictOf({ ...FOUND, outcome: "rounds" }).words, /not settled in its rounds; physics is missing/);
  assert.equal(experimentOf({ ...FOUND, next_experiment: { name: "settle: a/b", text: "", duration_s: 1 } }, "t").name, "settle-a-b.toml");
  assert.equal(nameFault(experimentOf(FOUND, "t").name), "");
});

test("what is left of a run that has ended otherwise may go on", () => {
  assert.ok(mayGoOn({ state: "interrupted", sessions: 5, sessions_done: 2 }));
  assert.ok(mayGoOn({ state: "aborted", sessions: 5, sessions_done: 0 }));
  for (const state of ["done", "running", "refused"]) assert.ok(!mayGoOn({ state, sessions: 5, sessions_done: 2 }), state);
  assert.ok(!mayGoOn({ state: "failed", sessions: 5, sessions_done: 5 }));
});

test("a number of an effect has its unit behind its interval, a ratio has none", () => {
  assert.equal(parameterText("force_N_psi", { value: 4.2, ci95: [4.0, 4.4], unit: "N/psi" }), "force_N_psi 4.2 [4, 4.4]\u202fN/psi");
  assert.equal(parameterText("force_N_psi", { value: 4.2, ci95: [4.0, 4.4], unit: "N/psi", words: "force" }), "force 4.2 [4, 4.4]\u202fN/psi");
  assert.equal(parameterText("share", { value: 0.5, ci95: [0.4, 0.6] }), "share 0.5 [0.4, 0.6]");
});
