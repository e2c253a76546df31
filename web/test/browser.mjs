// Debian's Chromium, headless, for the tests of pages.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync, mkdtempSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { pathToFileURL } from "node:url";
import puppeteer from "puppeteer-core";

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

/** Paper less the margins of @page, in CSS pixels. */
export const papers = { A4: { width: 210, format: "A4" }, Letter: { width: 215.9, format: "Letter" } };
const printable = (paper) => Math.floor(((papers[paper].width - 28) / 25.4) * 96);

/** Calls `use` with a browser of its own folder, and ends it. */
export async function withBrowser(use) {
  const folder = mkdtempSync(join(tmpdir(), "isorig-chromium-"));
  const browser = await puppeteer.launch({
    executablePath: execFileSync("which", ["chromium"], { encoding: "utf8" }).trim(), browser: "chrome", headless: true, userDataDir: folder,
    args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
      "--disable-component-update", "--disable-sync"],
  });
  try {
    await use(browser);
  } finally {
    await browser.close();
    rmSync(folder, { recursive: true, force: true, maxRetries: 5 });
  }
}

/** A page that has drawn itself without an error and without asking for anything but itself. */
export async function open(browser, file, { width = 1280, height = 900, dark = false } = {}) {
  const page = await browser.newPage();
  const complaints = [], requests = [];
  page.on("console", (m) => ["error", "warn"].includes(m.type()) && complaints.push(m.text()));
  page.on("pageerror", (e) => complaints.push(String(e)));
  page.on("request", (r) => requests.push(r.url()));
  await page.setViewport({ width, height });
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: dark ? "dark" : "light" }]);
  const url = pathToFileURL(file).href;
  await page.goto(url, { waitUntil: "load" });
  await page.waitForSelector("h1", { timeout: 20000 });
  await settled(page);
  assert.deepEqual(complaints, [], `${file}: complaints on the console`);
  assert.deepEqual(requests.filter((r) => r !== url && !r.startsWith("data:") && !r.startsWith("blob:")), [],
    `${file} asks for more than itself`);
  return page;
}

/** The button whose label holds `name`, as soon as there is one. */
export async function button(page, name, within = "body") {
  const find = (n, w) => [...document.querySelectorAll(`${w} button`)].find((b) => b.textContent.includes(n));
  return (await page.waitForFunction(find, { timeout: 20_000 }, name, within)).asElement();
}

/** Its middle, once it may be pressed and stands still: what comes in above it moves it down. */
async function aim(page, element) {
  await element.scrollIntoView();
  const at = await page.waitForFunction((e) => {
    const { x, y, width, height } = e.getClientRects()[0];  // of a name on two lines the first
    const still = e.lastSeen?.x === x && e.lastSeen?.y === y;
    e.lastSeen = { x, y };
    return still && !e.disabled && { x: x + width / 2, y: y + height / 2 };
  }, { timeout: 10_000, polling: "raf" }, element);
  const { x, y } = await at.jsonValue();
  await page.mouse.move(x, y);
}

/** Presses a button as a hand does. A page that is still loading may move it between the look and the click; the click then lands
 * beside it and is done again. Three misses are the page's fault. */
export async function press(page, element) {
  const watched = await element.evaluateHandle((e) => {
    const click = { hit: false };
    e.addEventListener("click", () => (click.hit = true), { once: true });
    return click;
  });
  for (let miss = 0; miss < 3; ++miss) {
    await aim(page, element);
    await page.mouse.down();
    await page.mouse.up();
    // What was pressed may have led to another document, which knows nothing of this one.
    if (await watched.evaluate((w) => w.hit).catch(() => true)) return;
  }
  throw new Error(`"${await element.evaluate((e) => e.textContent)}" moved away from three clicks`);
}

/** Presses a button that has to be held, and lets go too early. */
export async function pressShortly(page, element) {
  await aim(page, element);
  await page.mouse.down();
  await new Promise((r) => setTimeout(r, 200));
  await page.mouse.up();
}

/** Holds a button until it has acted, by the mouse or by the keyboard alone. Looked at and not timed: on a busy machine the page's
 * own timer is late, too. Once it has acted it is gone or no longer filled. */
export async function hold(page, element, { key } = {}) {
  await aim(page, element);
  if (key) await element.focus();
  await page.evaluate((e) => {
    let began = false;
    globalThis.acted = new Promise((done, failed) => {
      const observer = new MutationObserver(() => {
        began ||= e.classList.contains("held");
        if (e.isConnected && (!began || e.classList.contains("held"))) return;
        observer.disconnect();
        // What the button says when it was let go too early, as by moving away under the pointer.
        if (e.isConnected && e.textContent.includes("hold longer")) failed(new Error("the button was let go before it acted"));
        else done();
      });
      observer.observe(document.body, { subtree: true, childList: true, attributes: true, attributeFilter: ["class"] });
      setTimeout(() => failed(new Error(`"${e.textContent}" ${began ? "was held for 20 s and did not act" : "was pressed and was not held"}`)), 20_000);
    });
    globalThis.acted.catch(() => {});  // told below
  }, element);
  await (key ? page.keyboard.down(key) : page.mouse.down());
  await page.evaluate(() => globalThis.acted);
  await (key ? page.keyboard.up(key) : page.mouse.up());
}

/** Two frames later: sizes were measured and drawn to. */
export function settled(page) {
  return page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}

/** Elements that stand out of the page to the right, and boxes whose content is cut or scrolls, by their outerHTML. */
export function tooWide(page, { scrollers }) {
  return page.evaluate((mayScroll) => {
    const out = [];
    if (document.documentElement.scrollWidth > document.documentElement.clientWidth + 1) {
      out.push(`the page: ${document.documentElement.scrollWidth} of ${document.documentElement.clientWidth}`);
    }
    if (mayScroll) return out;
    for (const e of document.querySelectorAll("#report *")) {
      if (e.closest("svg") || e.getClientRects().length === 0) continue;
      const style = getComputedStyle(e);
      if (style.display === "inline") continue;
      if (e.scrollWidth > e.clientWidth + 1 && e.clientWidth > 0) out.push(e.outerHTML.slice(0, 160));
      if (["auto", "scroll"].includes(style.overflowX)) out.push(`scrolls: ${e.outerHTML.slice(0, 160)}`);
    }
    return out;
  }, scrollers);
}

/** On paper nothing is cut, nothing scrolls, what is folded away stays away, and there is at least one page. */
export async function checkPrint(browser, file, paper) {
  const page = await open(browser, file, { width: printable(paper) });
  await page.emulateMediaType("print");
  await settled(page);
  assert.deepEqual(await tooWide(page, { scrollers: false }), [], `${file} on ${paper}`);
  assert.equal(await page.$$eval(".screen-only", (all) => all.filter((e) => e.getClientRects().length > 0).length), 0);
  const pdf = Buffer.from(await page.pdf({ format: papers[paper].format, preferCSSPageSize: false }));
  const text = pdf.toString("latin1");
  const pages = (text.match(/\/Type\s*\/Page\b/g) ?? []).length;
  assert.ok(pages >= 1, `${file}: a PDF without a page`);
  await page.close();
  return { pdf, pages };
}

/** axe-core's findings, none is right. */
export async function checkAccessible(page, file) {
  await page.evaluate(axe);
  const found = await page.evaluate(async () =>
    (await globalThis.axe.run(document, { resultTypes: ["violations"] })).violations.map((v) =>
      `${v.id}: ${v.help}: ${v.nodes.slice(0, 3).map((n) => n.html.slice(0, 160) + " " + (n.any[0]?.message ?? "")).join(" | ")}`));
  assert.deepEqual(found, [], `${file}: axe-core`);
}

/** What is drawn: for each figure its number of panels, and of marks of each kind; every path is of numbers. */
export async function drawn(page) {
  const figures = await page.$$eval("figure", (all) => all.map((figure) => {
    const marks = [...figure.querySelectorAll("svg.chart g[clip-path] path, svg.chart g[clip-path] circle, svg.chart g[clip-path] rect")];
    return {
      name: figure.id,
      panels: figure.querySelectorAll("svg.chart").length,
      bands: marks.filter((m) => m.tagName === "path" && m.getAttribute("fill") !== "none").length,
      lines: marks.filter((m) => m.tagName === "path" && m.getAttribute("fill") === "none").length,
      bars: marks.filter((m) => m.tagName === "rect" && !m.getAttribute("class")).length,
      points: marks.filter((m) => m.tagName === "circle").length,
      wrong: marks.filter((m) => /NaN|Infinity|undefined/.test(m.outerHTML)).map((m) => m.outerHTML.slice(0, 120)),
    };
  }));
  for (const f of figures) {
    assert.deepEqual(f.wrong, [], `figure ${f.name}`);
    assert.ok(f.panels > 0, `figure ${f.name} has no panel`);
    assert.ok(f.bands + f.lines + f.points + f.bars > 0, `figure ${f.name} shows nothing`);
  }
  return figures;
}

/** All that is asked of any page: drawn, whole on a desk, a phone and paper, accessible in both themes. */
export async function checkPage(browser, file) {
  const page = await open(browser, file);
  const figures = await drawn(page);
  assert.deepEqual(await tooWide(page, { scrollers: true }), [], `${file} at 1280`);
  await checkAccessible(page, file);
  await page.close();
  const night = await open(browser, file, { dark: true });
  await checkAccessible(night, file);
  await night.close();
  const phone = await open(browser, file, { width: 390, height: 844 });
  assert.deepEqual(await tooWide(phone, { scrollers: true }), [], `${file} at 390`);
  await phone.close();
  for (const paper of Object.keys(papers)) await checkPrint(browser, file, paper);
  return figures;
}
