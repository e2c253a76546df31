import assert from "node:assert/strict";
import { test } from "node:test";
import { Boundary } from "../src/live/boundary.tsx";
import { told, toldOrWrong } from "../src/live/diagnosis_words.ts";

test("what cannot be drawn says so, in its own place", () => {
  const boundary = new Boundary({ name: "Runs", children: "the table" });
  assert.equal(boundary.render(), "the table");
  boundary.state = Boundary.getDerivedStateFromError(new TypeError("x is not a function"));
  assert.match(JSON.stringify(boundary.render()?.valueOf()), /Runs.*cannot be shown.*x is not a function.*Try again/);
});

test("one diagnosis of another shape does not take the others away", () => {
  const d = { id: "1", folder: "a", kind: "diagnosis", made_utc: "", pages: [], experiment: true };
  const word = (key: string) => key;
  const malformed = { ...d, alternatives: [{ effects: "slack", probability: 1 }] } as unknown as Parameters<typeof told>[0];
  assert.throws(() => told(malformed, word));
  const shown = toldOrWrong(malformed, word);
  assert.match(shown.wrong ?? "", /not what this page knows: /);
  assert.deepEqual([shown.folder, shown.experiment, shown.rivals, shown.caveats], ["a", true, [], []]);
});
