import assert from "node:assert/strict";
import { test } from "node:test";
import { Control, Verbs } from "../src/live/controls.tsx";
import { Model } from "../src/live/model.ts";
import { Moment } from "../src/live/moment.tsx";
import { worstFirst, type Line } from "../src/live/rig.tsx";
import { Judged, Reading } from "../src/live/readings.tsx";
import { ageText, localDay, localTime, look, readingAge_s, zone } from "../src/live/words.ts";

test("a reading older than a second says its age, a device that never sent says so", () => {
  assert.equal(ageText(0.02), "");
  assert.equal(ageText(1), "");
  assert.equal(ageText(1.26), "STALE 1.3 s");
  assert.equal(ageText(59.6), "STALE 60 s");
  assert.equal(ageText(-1), "never read");
});

test("a reading ages with the status that told of it", () => {
  assert.equal(readingAge_s(0.1, 5000), 5.1);
  assert.equal(readingAge_s(-1, 5000), -1);
});

test("times are those of the page's zone, in winter as in summer, and of the day that it is there", () => {
  process.env["TZ"] = "America/New_York";
  assert.equal(zone(), "America/New_York");
  assert.equal(localTime(new Date("2026-11-23T01:02:51Z")), "2026-11-22 20:02:51");
  assert.equal(localTime(new Date("2026-07-01T01:02:51.045Z"), 3), "2026-06-30 21:02:51.045");
  assert.equal(localDay(new Date("2026-11-23T01:02:51Z")), "2026-11-22");
  assert.equal(localTime(new Date("")), "–");
  const shown = Moment({ utc: "2026-11-23T01:02:51Z" });
  assert.deepEqual(shown.props, { dateTime: "2026-11-23T01:02:51.000Z", title: "2026-11-23 01:02:51 UTC", children: "2026-11-22 20:02:51" });
});

test("a reading that is not of now is greyed with its age in words; one that never came has no number", () => {
  const seen = (age_s: number) => JSON.stringify(Reading({ name: "force", unit: "N", value: "1.20", age_s, children: null }).props);
  assert.match(seen(0.1), /"class":"".*"1\.20"/);
  assert.doesNotMatch(seen(0.1), /age/);
  assert.match(seen(3.2), /"class":"stale".*"1\.20".*"class":"age","children":"STALE 3\.2 s"/);
  assert.match(seen(-1), /"class":"stale".*"–".*"never read"/);
  assert.doesNotMatch(seen(-1), /1\.20/);
});

test("a verdict has its sign's kind and the terminal's words", () => {
  assert.match(JSON.stringify(Judged({ name: "loop", said: { tone: "warn", text: "worst wake-up 1.2 ms: fair" } }).props), /"kind":"warn".*worst wake-up 1\.2 ms: fair/);
  assert.match(JSON.stringify(Judged({ name: "loop", said: undefined }).props), /"kind":"unknown".*no verdict/);
});

test("of a self-test what is to be looked at comes first", () => {
  const line = (check: string, verdict: Line["verdict"]) => ({ check, verdict, found: "", to_do: "" });
  const lines = [line("a", "ok"), line("b", "warn"), line("c", "skipped"), line("d", "ok"), line("e", "fail"), line("f", "warn")];
  assert.deepEqual(worstFirst(lines).map((l) => l.check), ["e", "b", "f", "c", "a", "d"]);
  assert.equal(lines[0]?.check, "a", "what came is left as it is");
});

test("no daemon is said where nothing listens, and nowhere else", () => {
  const word = (none: Parameters<typeof look>[4], age_ms = 0) => look(null, null, true, age_ms, none).word;
  assert.equal(word("not yet", 60_000), "NO STATUS YET");
  assert.equal(word("gone"), "NO DAEMON");
  assert.equal(word("silent"), "NO ANSWER");
  assert.equal(word("refused"), "REFUSED");
  assert.equal(word("gone", 5000), "NO NEWS", "it may be there again by now");
});

test("whoever has a session can leave it, whoever has control", () => {
  const model = new Model();
  const control = () => JSON.stringify(Control({ model, say: () => {} }).props);
  assert.doesNotMatch(control(), /Leave/);
  model.text(JSON.stringify({ kind: "hello", rig: "r", epoch_unix_us: 0, fine_ns: 20e6, fine_kept_ns: 600e9, coarse_ns: 5e9, may_control: true, name: "Ann" }));
  for (const lease of [{ holder: "Ann", mine: true }, { holder: null, mine: false }, { holder: "Bob", mine: false }]) {
    model.text(JSON.stringify({ kind: "lease", ...lease }));
    assert.match(control(), /Leave/, JSON.stringify(lease));
  }
});

test("a session can pause and abort, whatever the page knows of the rig", () => {
  const model = new Model();
  const verbs = () => JSON.stringify(Verbs({ model, say: () => {}, onStart: () => {}, onNote: () => {} }));
  assert.doesNotMatch(verbs(), /Pause/, "it is view only");
  model.text(JSON.stringify({ kind: "hello", rig: "r", epoch_unix_us: 0, fine_ns: 20e6, fine_kept_ns: 600e9, coarse_ns: 5e9, may_control: true, name: "Ann" }));
  assert.match(verbs(), /Pause.*Abort/);
  for (const status of [null, { pid: 1, state: "ready" }, { pid: 1, state: "paused" }, { pid: 1, state: "of another release" }]) {
    model.text(JSON.stringify({ kind: "status", web: { sent_ms: 0 }, status, none: "silent" }));
    assert.match(verbs(), /Pause.*Abort/, JSON.stringify(status));
  }
});
