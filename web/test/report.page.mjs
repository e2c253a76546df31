// The reports' template in a browser, with a document that has everything: node web/test/report.page.mjs TEMPLATE
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { checkAccessible, checkPage, open, settled, withBrowser } from "./browser.mjs";

const template = readFileSync(process.argv[2], "utf8");
const folder = mkdtempSync(join(tmpdir(), "isorig-report-"));

const n = 300;
const x = Array.from({ length: n }, (_, i) => i / 10);
const low = x.map((t) => Math.sin(t) - 0.2), high = x.map((t) => Math.sin(t) + 0.2), mean = x.map(Math.sin);
mean[100] = null;
const long = "a very long word for a table: " + "Rückstellkraft".repeat(6);
const data = {
  format: "isorig-report-data/1", kind: "Test", title: "Everything & <nothing>", subtitle: "below the title",
  lead: { word: "half", text: "Half of it.", mood: "warning" },
  made: { command: "isorig fv 'a b'", version: "isorig 1", at_utc: "2026-01-02 03:04 UTC", inputs: [{ name: "Recording", what: "r".repeat(300) }] },
  links: [{ text: "Run", href: "../report.html" }, { text: "model.toml", href: "model.toml" }],
  blocks: [
    { type: "heading", level: 2, text: "Section" }, { type: "paragraph", text: "1 < 2 </script>" },
    { type: "note", text: "bad", mood: "bad" }, { type: "note", text: "good", mood: "good" },
    { type: "equation", text: "F = Fc z, dz/dx = (1 − z sign(dx)) / δ" }, { type: "list", items: ["one", "one"] },
    { type: "facts", items: [{ name: "Losses", value: "none", mood: "good", note: "samples" }, { name: "Losses", value: "twice" }] },
    { type: "table", caption: "caption", columns: [{ name: "" }, { name: "value", numeric: true }, { name: "text" }, ...Array.from({ length: 7 }, (_, i) => ({ name: `column ${i}`, numeric: true }))],
      rows: [["a", "1.5", long, ...Array(7).fill("123456.7 [1234.5, 2345.6]")], ["b"]] },
    { type: "figure", figure: { name: "linked", caption: "two panels", columns: 1, linked: true, panels: [0, 1].map((k) => ({
      x: { name: "time (s)" }, y: { name: "force (N)" }, aspect: 0.25, verticals: [{ at: 12, label: "here" }], shaded: [{ from: 3, to: 5 }],
      series: [{ mark: "band", color: k, label: "measured", x, y: low, y2: high }, { mark: "line", color: k, label: "measured", x, y: mean }] })) } },
    { type: "grid", caption: "every recording", columns: ["5 psi", "10 psi"], key: [{ text: "A", title: "dry friction", color: 0 }, { text: "·", title: "nothing missing" }],
      rows: [{ name: "Actuator1", cells: [[{ text: "A", title: "Actuator1, 5 psi: dry friction 0.98", color: 0, href: "../a/diagnosis-report.html" }], [{ text: "·", title: "Actuator1, 10 psi: nothing missing", href: "../b/diagnosis-report.html" }]] }] },
    { type: "table", caption: "narrow: " + "words that explain what stands in it, ".repeat(4), columns: [{ name: "" }, { name: "N", numeric: true }], rows: [["a", "1"]] },
    { type: "heading", level: 2, text: "Second" },
    { type: "figure", figure: { name: "others", caption: "marks", columns: 2, panels: [
      { title: "points", x: { name: "x", log: true }, y: { name: "y" }, series: [{ mark: "points", color: 0, label: "p", x: [1, 10, 100], y: [1, 2, 3], error: [0.1, 0.2, null] }] },
      { title: "bars", x: { name: "", categories: ["one", "two"] }, y: { name: "N" }, series: [{ mark: "bars", color: 1, label: "b", x: [0, 1], y: [3, 4] }] }] } },
    { type: "more", summary: "folded", blocks: [{ type: "code", name: "rig.toml", text: "key = \"" + "v".repeat(200) + "\"\n# two" }] },
  ],
};
const written = (name, value) => {
  const file = join(folder, name);
  writeFileSync(file, template.replace("@TITLE@", "t").replace("@DATA@", () => (typeof value === "string" ? value : JSON.stringify(value).replace(/</g, "\\u003c"))));
  return file;
};

try {
  await withBrowser(async (browser) => {
    const file = written("whole.html", data);
    const figures = await checkPage(browser, file);
    assert.deepEqual(figures.map((f) => [f.name, f.panels]), [["linked", 2], ["others", 2]]);
    assert.equal(figures[0].bands, 2, "a band for each panel");
    assert.equal(figures[0].points, 0, "a long signal is no row of dots");
    assert.equal(figures[1].points, 3);

    const page = await open(browser, file);
    const text = await page.evaluate(() => document.body.innerText);
    for (const part of ["Everything & <nothing>", "1 < 2 </script>", "Half of it.", "isorig fv 'a b'", "2026-01-02 03:04 UTC", "Figure 2."]) {
      assert.ok(text.includes(part), part);
    }
    assert.deepEqual(await page.$$eval("nav.links a", (all) => all.map((a) => a.getAttribute("href"))), ["../report.html", "model.toml"]);
    assert.deepEqual(await page.$$eval("table.grid a.mark", (all) => all.map((a) => [a.textContent, a.getAttribute("href"), a.getAttribute("aria-label")])),
      [["A", "../a/diagnosis-report.html", "Actuator1, 5 psi: dry friction 0.98"], ["·", "../b/diagnosis-report.html", "Actuator1, 10 psi: nothing missing"]]);
    assert.equal(await page.$$eval("th.number", (all) => all.filter((e) => e.textContent === "value").length), 1);
    assert.equal(await page.$$eval("#linked .legend li", (all) => all.length), 1, "one name, one entry");

    // A caption takes the page's width, whatever its table takes; and the table keeps its own.
    for (const width of [1280, 390]) {
      await page.setViewport({ width, height: 900 });
      await settled(page);
      const [lines, columns, beyond] = await page.$$eval(".table-frame", (all) => all.filter((f) => /^narrow/.test(f.textContent)).map((f) => {
        const table = f.querySelector("table"), c = f.querySelector("caption") ?? document.getElementById(table.getAttribute("aria-labelledby"));
        return [c.getBoundingClientRect().height / parseFloat(getComputedStyle(c).lineHeight), table.tBodies[0].getBoundingClientRect().width,
          document.documentElement.scrollWidth - innerWidth];
      })[0]);
      assert.ok(lines < (width > 600 ? 4 : 7), `the caption has ${lines} lines at ${width}`);
      assert.ok(columns < 100, `two short columns take ${columns} pixels`);
      assert.ok(beyond <= 0, `wider than the page by ${beyond}`);
    }
    await page.setViewport({ width: 1280, height: 900 });
    await settled(page);

    // Zoom by dragging in one panel: both show the same stretch; a double click shows all again.
    const ticks = () => page.$$eval("#linked svg.chart", (all) => all.map((svg) =>
      [...svg.querySelectorAll("text[text-anchor=middle]")].map((t) => t.textContent).join(" ")));
    const before = await ticks();
    const chart = await page.$("#linked svg.chart");
    await chart.scrollIntoView();
    const box = await chart.boundingBox();
    await page.mouse.move(box.x + box.width * 0.3, box.y + box.height / 2);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width * 0.5, box.y + box.height / 2, { steps: 5 });
    await page.mouse.up();
    await settled(page);
    const zoomed = await ticks();
    assert.notDeepEqual(zoomed, before);
    await chart.click({ count: 2 });
    await settled(page);
    assert.deepEqual(await ticks(), before);
    await chart.evaluate((svg) => svg.focus());
    await page.keyboard.press("+");
    await settled(page);
    assert.notDeepEqual(await ticks(), before, "the keyboard zooms too");

    // Files: what is saved is what is shown.
    await page.evaluate(() => {
      globalThis.saved = [];
      const make = URL.createObjectURL;
      URL.createObjectURL = (blob) => (globalThis.saved.push(blob), make(blob));
      HTMLAnchorElement.prototype.click = function () { globalThis.names = [...(globalThis.names ?? []), this.download]; };
    });
    await page.$eval("#linked details", (d) => (d.open = true));
    for (const button of await page.$$("#linked .files button")) await button.click();
    await page.waitForFunction(() => globalThis.names?.length === 3, { timeout: 10000 });
    assert.deepEqual((await page.evaluate(() => globalThis.names)).sort(), ["linked.csv", "linked.png", "linked.svg"]);
    const blobs = await page.evaluate(() => Promise.all(globalThis.saved.map(async (b) => [b.type, b.size, (await b.text()).slice(0, 1e6)])));
    const of = (type) => blobs.find((b) => b[0] === type);
    assert.equal(of("text/csv")[2].trim().split("\n").length, 1 + 4 * n);
    assert.match(of("image/svg+xml")[2], /^<svg xmlns[^>]*>.*<path/s);
    assert.ok(!of("image/svg+xml")[2].includes("var(--"), "colours are written out");
    assert.ok(of("image/png")[1] > 5000 && of("image/png")[2].slice(1, 4) === "PNG");
    await page.close();

    // From isorig-web: its neighbours, and the way back to the lists, which are not printed.
    const server = createServer((_, answer) => answer.writeHead(200, { "content-type": "text/html; charset=utf-8" }).end(readFileSync(file)));
    await new Promise((ready) => server.listen(0, "127.0.0.1", ready));
    const served = await browser.newPage();
    await served.goto(`http://127.0.0.1:${server.address().port}/page/runs/r/fv/fv-report.html`);
    await served.waitForSelector("h1");
    assert.deepEqual(await served.$$eval(".links a", (all) => all.map((a) => [a.textContent, new URL(a.href).pathname, new URL(a.href).hash])),
      [["Run", "/page/runs/r/report.html", ""], ["All runs", "/", "#runs"], ["All diagnoses", "/", "#diagnosis"]]);
    assert.match(await served.$eval("p.links", (e) => e.textContent), /on the disk: model\.toml\./);
    await checkAccessible(served, "served");
    await served.close();
    server.close();

    for (const [name, value, words] of [["broken.html", "{", "cannot be read"], ["other.html", { format: "x", blocks: [] }, "isorig-report-data/1"]]) {
      const broken = await browser.newPage();
      await broken.goto("file://" + written(name, value));
      assert.match(await broken.$eval("#report", (e) => e.textContent), new RegExp(words));
      await broken.close();
    }
  });
} finally {
  rmSync(folder, { recursive: true, force: true });
}
