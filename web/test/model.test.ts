import assert from "node:assert/strict";
import { test } from "node:test";
import { Model } from "../src/live/model.ts";
import { SentClock } from "../src/live/sent_clock.ts";
import { look } from "../src/live/words.ts";

const status = (sent_ms: number, pid = 7) => JSON.stringify({ kind: "status", web: { sent_ms }, status: { pid, state: "running" } });
const word = (model: Model, now_ms: number) => look(model.status, null, true, now_ms - model.status_ms, model.none).word;

test("a status that has waited on a slow link is as old as it is, not as new as its arrival", () => {
  const model = new Model();
  model.text(status(500_000), 1000);
  assert.equal(word(model, 1100), "RUNNING");
  model.text(status(500_200), 1200);
  assert.equal(word(model, 1300), "RUNNING");
  // 30 s later comes what was sent 10 s ago.
  model.text(status(520_200), 31_200);
  assert.ok(Math.abs(31_200 - model.status_ms - 10_000) < 5, `${model.status_ms}`);
  assert.equal(word(model, 31_200), "NO NEWS");
  model.text(status(530_300), 31_300);
  assert.equal(word(model, 31_300), "RUNNING");
});

test("a quicker status shows that those before had waited; another connection may be to another process", () => {
  const model = new Model();
  model.text(status(1000), 9000);
  model.text(status(5000), 9100);
  assert.equal(9100 - model.status_ms, 0);
  model.connecting();
  model.text(status(10), 9200);
  assert.equal(9200 - model.status_ms, 0);
});

test("clocks that part by 100 ppm make no status old, in a week", () => {
  for (const rate of [1 - 1e-4, 1 + 1e-4]) {
    const clock = new SentClock();
    for (let now = 0; now < 7 * 86_400_000; now += 60_000) assert.ok(now - clock.sentAt_ms(now * rate, now) < 100, `${now} ms at ${rate}`);
  }
});

test("events of a daemon that has gone are not those of the one that took its place", () => {
  const model = new Model();
  const events = (text: string) => JSON.stringify({ kind: "events", events: [{ mono_ns: 5, count: 1, severity: "info", code: "a", text }] });
  model.text(status(0, 7), 0);
  model.text(events("of the first"), 1);
  model.text(status(200, 8), 200);  // the one that said that there is none was replaced on its way
  assert.deepEqual(model.events, []);
});
