import assert from "node:assert/strict";
import { test } from "node:test";
import type { Model, Twin } from "../src/live/model.ts";
import { TwinValue } from "../src/live/twin.tsx";

/** What stands beside the force; null: nothing. */
function shown(twin: Twin): string | null {
  const element = TwinValue({ model: { web: { twin } } as Model });
  return element && [element.props.children].flat().join("");
}

test("the twin's force, with its band if it has one", () => {
  assert.equal(shown({ model: "m.toml", force_N: -1.234, half_N: 0.02 }), "twin \u22121.23 ± 0.02 N");
  assert.equal(shown({ model: "m.toml", force_N: 1, half_N: 0 }), "twin 1.00 N");
});

test("a force or a band that is no number stops nothing", () => {
  assert.equal(shown({ model: "m.toml" }), null);
  assert.equal(shown({ model: "m.toml", force_N: null, half_N: null }), null);
  assert.equal(shown({ model: "m.toml", force_N: 1, half_N: null }), "twin 1.00 N");
});
