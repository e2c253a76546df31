import { strict as assert } from "node:assert";
import { test } from "node:test";
import { wrapped } from "../src/shared/chart.tsx";
import { extent, type Panel } from "../src/shared/figure.ts";
import { parseDocument } from "../src/report/document.ts";
import { valuesCsv } from "../src/report/save.ts";

const panel = (over: Partial<Panel>): Panel => ({ x: { name: "time" }, y: { name: "force" }, series: [], ...over });

test("bands and error bars count for the extent", () => {
  const p = panel({ series: [{ mark: "band", color: 0, x: [0, 1], y: [0, 0], y2: [10, 3] }, { mark: "points", color: 1, x: [1], y: [-1], error: [1] }] });
  const [low, high] = extent(p, "y");
  assert.ok(low <= -2 && high >= 10);
  assert.deepEqual(extent(p, "x"), [-0.03, 1.03], "points need room beside the frame");
  assert.deepEqual(extent({ ...p, series: p.series.slice(0, 1) }, "x"), [0, 1], "bands fill it");
});

test("a flat signal, an empty one and a fixed range have an extent", () => {
  const flat = extent(panel({ series: [{ mark: "line", color: 0, x: [0, 1], y: [5, 5] }] }), "y");
  assert.ok(flat[0] < 5 && flat[1] > 5);
  assert.deepEqual(extent(panel({}), "y"), [0, 1]);
  assert.deepEqual(extent(panel({ y: { name: "F", range: [-1, 2] } }), "y"), [-1, 2]);
});

test("what is not positive has no place on a logarithmic axis", () => {
  const p = panel({ y: { name: "F", log: true }, series: [{ mark: "line", color: 0, x: [0, 1, 2], y: [0, 0.1, 10] }] });
  assert.deepEqual(extent(p, "y"), [0.1, 10]);
});

test("zooming in takes the ordinate along", () => {
  const p = panel({ series: [{ mark: "line", color: 0, x: [0, 1, 2], y: [0, 1, 100] }] });
  assert.ok(extent(p, "y", [0, 1])[1] < 2);
});

test("data of another format are refused by name", () => {
  assert.throws(() => parseDocument("{"), /cannot be read/);
  assert.throws(() => parseDocument('{"format":"else"}'), /isorig-report-data\/1/);
  assert.throws(() => parseDocument("null"), /isorig-report-data\/1/);
});

test("a figure's numbers as CSV, gaps empty, quotes doubled", () => {
  const csv = valuesCsv({ name: "f", caption: "", columns: 1, panels: [panel({ title: 'a "b"', series: [{ mark: "line", color: 0, label: "s", x: [0, 1], y: [2, null] }] })] });
  assert.equal(csv, 'panel,series,x,y,y2,error,error_below\n"a ""b""","s",0,2,,,\n"a ""b""","s",1,,,,\n');
});

test("names of categories break between words", () => {
  assert.deepEqual(wrapped("softening by the largest stretch", 12), ["softening by", "the largest", "stretch"]);
  assert.deepEqual(wrapped("viscoelasticity", 5), ["viscoelasticity"]);
});
