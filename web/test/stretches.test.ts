import assert from "node:assert/strict";
import { test } from "node:test";
import { blocks, grid, StretchRing } from "../src/live/stretches.ts";

/** As isorig-web writes it (webserver/rules/history.cpp, block()). */
function written(stream: number, tier: number, origin: number, width: number, offsets: number[], columns: number[][]): ArrayBuffer {
  const buffer = new ArrayBuffer(24 + 4 * offsets.length * (1 + columns.length));
  const view = new DataView(buffer);
  view.setUint8(0, stream);
  view.setUint8(1, tier);
  view.setUint16(2, columns.length, true);
  view.setUint32(4, offsets.length, true);
  view.setFloat64(8, origin, true);
  view.setFloat64(16, width, true);
  [...offsets].forEach((o, i) => view.setUint32(24 + 4 * i, o, true));
  columns.forEach((c, k) => c.forEach((v, i) => view.setFloat32(24 + 4 * (offsets.length * (1 + k) + i), v, true)));
  return buffer;
}

test("a block comes back as it was written, and a cut one is refused", () => {
  const buffer = written(1, 0, 1e12, 20e6, [0, 1, 5], [[1, 2, 3], [4, 5, 6], [2, 3, 4]]);
  const [block] = blocks(buffer);
  assert.deepEqual([...(block?.index ?? [])], [1e12, 1e12 + 1, 1e12 + 5]);
  assert.deepEqual(block?.columns.map((c) => [...c]), [[1, 2, 3], [4, 5, 6], [2, 3, 4]]);
  assert.throws(() => blocks(buffer.slice(0, buffer.byteLength - 4)));
  assert.throws(() => blocks(buffer.slice(0, 10)));
});

test("an outlier of one sample is in the band whatever the zoom, and a gap stays a gap", () => {
  const ring = new StretchRing(1000, 1);
  const n = 600, low = Array.from({ length: n }, () => 1), high = low.map((_, i) => (i === 333 ? 50 : 2));
  const offsets = low.map((_, i) => (i < 500 ? i : i + 100));
  for (const block of blocks(written(0, 0, 7000, 20e6, offsets, [low, high, low.map(() => 1.5)]))) ring.put(block);
  for (const pixels of [7, 50, 333, 700]) {
    const g = grid(7000 * 20e6, 7700 * 20e6, 20e6, pixels);
    assert.ok(g.count <= pixels + 1, `${g.count} stretches on ${pixels} pixels`);
    const r = ring.reduce(0, g);
    assert.equal(Math.max(...r.high.map((v) => v ?? 0)), 50);
    assert.equal(Math.min(...r.low.map((v) => v ?? 9)), 1);
  }
  const fine = ring.reduce(0, grid(7000 * 20e6, 7700 * 20e6, 20e6, 700));
  assert.deepEqual(fine.mean.slice(498, 502), [1.5, 1.5, null, null]);
  assert.equal(fine.mean[600], 1.5);
});

test("the grid does not move with the window", () => {
  const a = grid(100 * 20e6, 1100 * 20e6, 20e6, 300), b = grid(101 * 20e6, 1101 * 20e6, 20e6, 300);
  assert.equal(a.join, b.join);
  assert.ok(b.first - a.first <= 1);
});

test("a ring keeps the newest, and what is older than it holds is not put in", () => {
  const ring = new StretchRing(10, 1);
  const put = (from: number, count: number) => {
    const values = Array.from({ length: count }, (_, i) => from + i);
    for (const block of blocks(written(0, 0, from, 1, values.map((_, i) => i), [values, values, values]))) ring.put(block);
  };
  put(100, 15);
  put(90, 5);  // history that comes after the live samples
  assert.equal(ring.newest, 114);
  assert.equal(ring.at(104), -1);
  assert.ok(ring.at(105) >= 0);
  put(95, 3);
  assert.equal(ring.at(105) >= 0, true);
});
