import assert from "node:assert/strict";
import { test } from "node:test";
import { Model } from "../src/live/model.ts";
import { COARSE, FINE, STREAMS } from "../src/live/stretches.ts";
import { zoomed } from "../src/live/zoom.ts";

const FINE_NS = 20e6, COARSE_NS = 5e9, HOURS = 3;

/** Three hours of the frame: the day in stretches of 5 s, the last ten minutes in those of 20 ms. */
function seen(): Model {
  const model = new Model();
  model.text(JSON.stringify({ kind: "hello", rig: "r", epoch_unix_us: 1e12, fine_ns: FINE_NS, fine_kept_ns: 600e9, coarse_ns: COARSE_NS, may_control: true, name: "Ann" }));
  const put = (tier: number, width_ns: number, first: number, count: number) => {
    const column = () => new Float32Array(count).fill(tier === COARSE ? 5 : 1);
    const block = { stream: STREAMS.frame, tier, width_ns, index: Float64Array.from({ length: count }, (_, i) => first + i), columns: Array.from({ length: 6 }, column) };
    (tier === COARSE ? model.coarse : model.fine)[STREAMS.frame]?.put(block);
  };
  const end_ns = HOURS * 3600e9;
  put(COARSE, COARSE_NS, 0, end_ns / COARSE_NS);
  put(FINE, FINE_NS, (end_ns - 600e9) / FINE_NS, 600e9 / FINE_NS);
  return model;
}
const EPOCH_S = 1e6;
const at = (hours: number) => EPOCH_S + hours * 3600;
const never = async () => assert.fail("the server was asked");

test("what is older than ten minutes is enlarged from the stretches of the day, longer than an hour too", async () => {
  for (const [from, to] of [[1, 1.1], [0.5, 2.5], [2.8, 3]] as const) {
    const w = await zoomed(seen(), at(from), at(to), 600, never as never);
    assert.ok(typeof w !== "string", String(w));
    assert.equal(w.width_ns, COARSE_NS);
    const shown = w.rings[STREAMS.frame]?.reduce(1, w.grid);
    assert.ok(shown && shown.mean.filter((v) => v === 5).length >= (from === 1 ? 72 : 100), "the plot is empty");
    assert.ok(w.grid.count <= 601);
  }
});

test("of a stretch of which nothing is kept it is said", async () => {
  const model = seen();
  model.coarse.forEach((ring) => ring.clear());
  assert.match(String(await zoomed(model, at(1), at(1.1), 600, never as never)), /^Nothing is kept of that stretch/);
  const empty = (async () => new Response(new ArrayBuffer(0))) as typeof fetch;
  assert.match(String(await zoomed(seen(), at(2.95), at(2.96), 600, empty)), /^Nothing is kept/);
});

test("the last ten minutes are asked for, and a refusal is said in the server's words", async () => {
  let asked = "";
  const refuses = (async (url: string) => {
    asked = url;
    return new Response(JSON.stringify({ ok: false, text: "`from` and `to` in ns" }), { status: 400 });
  }) as unknown as typeof fetch;
  assert.equal(await zoomed(seen(), at(2.9), at(2.95), 600, refuses), "The stretch cannot be enlarged: `from` and `to` in ns.");
  assert.equal(asked, `/api/zoom?from=${2.9 * 3600e9}&to=${2.95 * 3600e9}&stretches=600`);
  const gone = (async () => new Response("<html>", { status: 502 })) as typeof fetch;
  assert.equal(await zoomed(seen(), at(2.9), at(2.95), 600, gone), "The stretch cannot be enlarged: isorig-web answered 502.");
  const cut = (async () => { throw new Error("Failed to fetch"); }) as typeof fetch;
  assert.match(String(await zoomed(seen(), at(2.9), at(2.95), 600, cut)), /did not answer \(Failed to fetch\)/);
});
