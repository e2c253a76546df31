import assert from "node:assert/strict";
import { test } from "node:test";
import { labelBaselines } from "../src/live/limit_labels.ts";

test("the words of a limit stand above its line, below it where there is no room", () => {
  assert.deepEqual(labelBaselines([100, 200], 0, 12), [96, 196]);
  assert.deepEqual(labelBaselines([10, 200], 0, 12), [22, 196]);
});

test("no words stand on others, however close their lines", () => {
  for (const lines of [[100, 107], [107, 100], [3, 5], [100, 100], [50, 60, 70], [0, 1, 2]]) {
    const at = labelBaselines(lines, 0, 12);
    for (const y of at) assert.ok(y >= 12, `${lines}: ${at}: out of the plot`);
    const sorted = [...at].sort((a, b) => a - b);
    sorted.slice(1).forEach((y, i) => assert.ok(y - (sorted[i] as number) >= 12, `${lines}: ${at}`));
    const order = (all: number[]) => all.map((_, i) => i).sort((a, b) => (all[a] as number) - (all[b] as number) || a - b);
    assert.deepEqual(order(at), order(lines), "in the order of their lines");
  }
});
