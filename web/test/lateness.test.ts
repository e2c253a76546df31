import assert from "node:assert/strict";
import { test } from "node:test";
import { binText, LATE_BIN, lateBy, latenessText } from "../src/live/lateness.tsx";

const bins = (counts: Record<number, number>) => Array.from({ length: 18 }, (_, k) => counts[k] ?? 0);

test("bins end at powers of two of a microsecond, said in thousands of them", () => {
  assert.equal(binText(bins({}), 0), "below 1 µs");
  assert.equal(binText(bins({}), 9), "below 512 µs");
  assert.equal(binText(bins({}), 10), "below 1.02 ms");
  assert.equal(binText(bins({}), 16), "below 65.5 ms");
  assert.equal(binText(bins({}), 17), "over 65.5 ms");
  assert.equal(binText(bins({}), LATE_BIN), "below 2.05 ms", "from 1.02 ms on");
});

test("what is counted is the latest tick of each hundredth of a second, not every tick", () => {
  assert.equal(lateBy(bins({ 5: 99, 12: 1 }), 0.99), "below 32 µs");
  assert.equal(latenessText(bins({ 5: 99, 12: 1 })), "latest tick of each 10 ms, over 10 min: in 99 % below 32 µs late, in all below 4.1 ms");
});
