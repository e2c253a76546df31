import { strict as assert } from "node:assert";
import { test } from "node:test";
import { envelope, nearest } from "../src/shared/envelope.ts";

test("an outlier of one sample reaches the edge of the band", () => {
  const x = Array.from({ length: 10000 }, (_, i) => i), y = x.map(() => 0);
  y[7777] = 5;
  const e = envelope(x, y, 100);
  assert.equal(e.x.length, 100);
  assert.equal(Math.max(...e.high), 5);
  assert.equal(Math.min(...e.low), 0);
  assert.ok(Math.abs(Math.max(...e.mean) - 0.05) < 1e-12);
});

test("every sample lies inside of its stretch's band", () => {
  const x = Array.from({ length: 997 }, (_, i) => i * 0.1), y = x.map((t) => Math.sin(t) + 0.01 * t);
  const e = envelope(x, y, 50), width = (x[996] as number) / 50;
  for (let i = 0; i < x.length; ++i) {
    const k = Math.min(49, Math.floor((x[i] as number) / width));
    assert.ok((y[i] as number) >= (e.low[k] as number) && (y[i] as number) <= (e.high[k] as number));
  }
});

test("gaps stay gaps", () => {
  const e = envelope([0, 1, 2, 3, 90, 91], [1, null, 2, NaN, 3, 4], 10);
  assert.deepEqual(e.low, [1, 3]);
  assert.deepEqual(e.high, [2, 4]);
  assert.deepEqual(envelope([], [], 10).x, []);
});

test("one moment and the end of the range belong somewhere", () => {
  assert.deepEqual(envelope([5], [7], 10).mean, [7]);
  const e = envelope([0, 1, 2], [1, 2, 3], 2, [0, 2]);
  assert.deepEqual(e.high, [1, 3]);
});

test("nearest of increasing values", () => {
  assert.equal(nearest([], 1), -1);
  assert.equal(nearest([0, 1, 10], 4), 1);
  assert.equal(nearest([0, 1, 10], 9), 2);
  assert.equal(nearest([3], 100), 0);
});
