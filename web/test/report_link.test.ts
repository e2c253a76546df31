import assert from "node:assert/strict";
import { test } from "node:test";
import { leadsOn, reportAt, reportIn } from "../src/live/report_link.ts";

test("the address of a report says where it lies", () => {
  assert.equal(reportAt("/var/lib/isorig/runs/r-1/report.html"), "/page/var/lib/isorig/runs/r-1/report.html");
  assert.equal(reportAt("/a b/#1 (ä)/fv-report.html"), "/page/a%20b/%231%20%28%C3%A4%29/fv-report.html");
  assert.equal(reportIn("#" + reportAt("/a b/#1 (ä)/fv-report.html")), "/page/a%20b/%231%20%28%C3%A4%29/fv-report.html");
});

test("a link leads to a report of this server, and nowhere else", () => {
  for (const hash of ["", "#", "#runs", "#//evil.example/report.html", "#/page//evil.example/report.html", "#/page/../api/pause.html",
    "#/page/a/../../enter.html", "#/page/a/./b.html", "#/enter?token=x.html", "#/page/a?b=.html", "#/page/a\\b.html",
    "#javascript:alert(1)//.html", "#/page/a#b.html", "#/page/a b.html", "#/page/a", "#/page/a.html\n"]) {
    assert.equal(reportIn(hash), null, hash);
  }
});

test("runs may lie below a hidden folder: the daemon judges which report may be opened", () => {
  const path = "/home/ann/.local/share/isorig/runs/r/report.html";
  assert.equal(reportIn("#" + reportAt(path)), "/page" + path);
});

test("who has no session is led on once, not in a circle", () => {
  const kept = new Map<string, string>();
  const memory = { getItem: (k: string) => kept.get(k) ?? null, setItem: (k: string, v: string) => void kept.set(k, v), removeItem: (k: string) => void kept.delete(k) };
  assert.equal(leadsOn("/page/a.html", memory, 1000), true);
  assert.equal(leadsOn("/page/a.html", memory, 1100), false);
  assert.equal(leadsOn("/page/a.html", memory, 1200), true, "the next click is another one");
  assert.equal(leadsOn("/page/b.html", memory, 1300), true);
  assert.equal(leadsOn("/page/b.html", memory, 60_000), true, "back again after a while");
});
