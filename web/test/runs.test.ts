import assert from "node:assert/strict";
import { test } from "node:test";
import { CurveStore, curvesIn, matches, overlaid, recordedText } from "../src/live/run_list.ts";
import type { Run } from "../src/live/runs.tsx";

const run: Run = {
  id: "20261123-010251-vma-smoke-Control2", started_utc: "2026-11-23T01:02:51Z", state: "aborted", fault: "e-stop", specimen: "Control2",
  rig: "sim", protocol: "vma-smoke.toml", operator: "Ann", attempts: 1, sessions: 2, sessions_done: 1, recorded_s: 754, report: true, page: "/runs/r/report.html",
  notes: [{ text: "the grip was loose", by: "Bob" }],
};

test("a run is found by every word, wherever it stands", () => {
  assert.ok(matches(run, ""));
  assert.ok(matches(run, "ann CONTROL2"));
  assert.ok(matches(run, "loose bob e-stop"));
  assert.ok(!matches(run, "ann control3"));
});

test("a run's duration is that of its data, and a run without data has none", () => {
  assert.equal(recordedText(run.recorded_s), "12\u202fmin 34\u202fs");
  assert.equal(recordedText(0), "–");
});

const panel = (y: number) => ({
  x: { name: "v" }, y: { name: "F/F0", range: [0, 1] as [number, number] },
  series: [{ mark: "points" as const, color: 5, label: "5 psi", x: [0], y: [y] }, { mark: "line" as const, color: 6, label: "10 psi", x: [0], y: [y] }],
});

test("curves over each other: a colour and a name for each run, and a scale that holds all", () => {
  const all = overlaid([{ id: "a", panel: panel(1) }, { id: "b", panel: null }, { id: "c", panel: panel(2) }]);
  assert.deepEqual(all?.series.map((s) => [s.label, s.color, s.y[0]]), [["a", 0, 1], ["a", 0, 1], ["c", 2, 2], ["c", 2, 2]]);
  assert.equal(all?.y.range, undefined);
  assert.equal(overlaid([{ id: "b", panel: null }]), null);
});

test("the curves in a page are those of its data", () => {
  const data = JSON.stringify({ blocks: [{ text: "x" }, { figure: { name: "force_velocity_curves", panels: [panel(3)] } }] });
  assert.equal(curvesIn(`<html><script type="application/json" id="data">${data}</script><script>1</script>`)?.series[0]?.y[0], 3);
  assert.equal(curvesIn("<html></html>"), null);
});

test("a run's page is fetched once, one after the other, and again after a failure", async () => {
  const asked: string[] = [];
  let under_way = 0, most = 0, fails = true;
  const store = new CurveStore(async (id) => {
    asked.push(id);
    most = Math.max(most, ++under_way);
    await new Promise((done) => setTimeout(done, 1));
    --under_way;
    if (id === "b" && fails) throw new Error("gone");
    return "";
  });
  const all = await Promise.allSettled(["a", "b", "c", "a"].map((id) => store.get(id)));
  assert.deepEqual(all.map((r) => r.status), ["fulfilled", "rejected", "fulfilled", "fulfilled"]);
  fails = false;
  assert.deepEqual(await store.get("b"), { id: "b", panel: null });
  await store.get("b");
  assert.deepEqual(asked, ["a", "b", "c", "b"]);
  assert.equal(most, 1);
});
