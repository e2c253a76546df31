// The live page in Chromium through a whole run on the simulated rig: check, start, pause, resume, done, with a second page
// that may only look on. Real processes, real time; about a minute.
// Usage: node web/test/live-run.mjs BIN_FOLDER SOURCE_FOLDER [FOLDER_FOR_SCREENSHOTS]
import assert from "node:assert/strict";
import { mkdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import puppeteer from "puppeteer-core";
import { Rig, until } from "./rig.mjs";

const [bin, source, shots] = process.argv.slice(2);
const rig = new Rig(bin, source);
let browser;

const text = (page, selector) => page.$eval(selector, (e) => e.textContent);
const state = (page) => text(page, ".state");
async function button(page, name) {
  const handle = await page.evaluateHandle((n) => [...document.querySelectorAll("button")].find((b) => b.textContent.includes(n)), name);
  const element = handle.asElement();
  assert.ok(element, `no button ${name}`);
  return element;
}
async function hold(page, element, ms) {
  await element.scrollIntoView();
  const box = await element.boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down();
  await new Promise((r) => setTimeout(r, ms));
  await page.mouse.up();
}
async function shot(page, name) {
  if (!shots) return;
  mkdirSync(shots, { recursive: true });
  await page.screenshot({ path: join(shots, `${name}.png`) });
}

async function newPage(context, errors, width = 1440, height = 1000) {
  const page = await context.newPage();
  await page.setViewport({ width, height });
  page.on("pageerror", (e) => errors.push(`pageerror: ${e.message}`));
  page.on("console", (m) => ["error", "warn"].includes(m.type()) && errors.push(`console: ${m.text()}`));
  return page;
}

try {
  rig.startDaemon();
  const base = await rig.startWeb();
  await rig.reach("ready");

  browser = await puppeteer.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", headless: true, userDataDir: join(rig.dir, "profile"),
    args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
      "--disable-component-update", "--disable-sync"],
  });
  const errors = [];

  // A page that may look on, and the time until something is painted.
  const viewer = await newPage(await browser.createBrowserContext(), errors, 390, 844);
  await viewer.goto(base, { waitUntil: "load" });
  await viewer.waitForSelector(".frame[data-look=ready]", { timeout: 20_000 });
  const paint = await viewer.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0]?.startTime);
  assert.match(await text(viewer, ".who"), /View only/);
  assert.equal((await viewer.$$(".verbs")).length, 0, "a page without a token has verbs");
  const refused = await viewer.evaluate(async () => (await fetch("/api/abort", { method: "POST", headers: { "Content-Type": "application/json" }, body: "{}" })).status);
  assert.equal(refused, 403);
  errors.length = 0;  // Chromium tells of the 403 on the console

  // The one-time link.
  const context = await browser.createBrowserContext();
  const page = await newPage(context, errors);
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "light" }]);
  const link = rig.call("web", "--name", "Ann");
  await page.goto(link, { waitUntil: "load" });
  assert.equal(new URL(page.url()).pathname, "/");
  await page.waitForSelector(".frame[data-look=ready]");
  assert.ok(!(await page.evaluate(() => document.cookie)), "a script can read the cookie");
  await shot(page, "1-ready");
  const again = await newPage(await browser.createBrowserContext(), []);
  assert.equal((await again.goto(link)).status(), 403, "a link worked twice");
  await again.close();

  // Start: with specimen and operator, checked first.
  assert.ok(await (await button(page, "Start…")).evaluate((b) => b.disabled), "started without control");
  await (await button(page, "Take control")).click();
  await until("control", async () => /control is here/.test(await text(page, ".who")));
  await until("the holder's name elsewhere", async () => /Ann has control/.test(await text(viewer, ".who")));
  await (await button(page, "Start…")).click();
  await page.waitForSelector("dialog[open] option:nth-child(3)");
  const check = await button(page, "Check");
  assert.ok(await check.evaluate((b) => b.disabled), "checked without protocol and specimen");
  const [protocol, specimen] = await page.$$("dialog select");
  await protocol.select("vma-smoke.toml");
  await specimen.select(" own");
  assert.equal(await page.$eval("dialog input:not([type=file])", (e) => e.value), "Ann");
  await check.click();
  await page.waitForSelector("dialog .seen");
  await shot(page, "2-start");
  await hold(page, await button(page, "Start"), 200);  // Start… lies behind the dialog
  assert.ok(await page.$("dialog[open]"), "a short press started the run");
  const start = await page.$("dialog button.start");
  await hold(page, start, 200);
  assert.ok(await page.$("dialog[open]"), "a short press started the run");
  await hold(page, start, 1100);
  await page.waitForFunction(() => document.querySelector(".state")?.textContent.includes("RUNNING"), { timeout: 20_000 });

  // The first ramp moves the crosshead; every sample comes.
  await until("the ramp", async () => /ramp|hold/.test(await text(page, ".timeline .summary")), 40);
  await new Promise((r) => setTimeout(r, 1500));
  await shot(page, "3-running");
  await shot(viewer, "3-running-phone");

  // Pause at once, from the keyboard; a second viewer sees it.
  await page.keyboard.press("p");
  await until("paused", async () => /PAUSED/.test(await state(page)), 10);
  await until("paused there", async () => /PAUSED/.test(await state(viewer)), 10);
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
  await new Promise((r) => setTimeout(r, 500));
  await shot(page, "4-paused-dark");

  // What axe finds, in both colours.
  const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
  for (const scheme of ["dark", "light"]) {
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
    await page.evaluate(axe);
    const found = await page.evaluate(async () => (await window.axe.run(document, { resultTypes: ["violations"] })).violations
      .map((v) => `${v.id}: ${v.nodes.map((n) => n.target.join(" ")).join(", ")}`));
    assert.deepEqual(found, [], `axe, ${scheme}`);
  }

  // Another operator takes over; the first one may still stop the rig, but not let it go on.
  const other = await newPage(await browser.createBrowserContext(), errors);
  await other.goto(rig.call("web", "--name", "Bob"), { waitUntil: "load" });
  await until("who has control", async () => /Ann has control/.test(await text(other, ".who")));
  await hold(other, await button(other, "Take over"), 1100);
  await until("taken over", async () => /Bob has control/.test(await text(page, ".who")), 10);
  assert.match(rig.web.logged(), /control taken over by Bob \(uid \d+\) from Ann/);
  assert.ok(await (await button(page, "Resume")).evaluate((b) => b.disabled));
  const resume = await button(other, "Resume");
  await resume.focus();  // by keyboard alone
  await other.keyboard.down("Enter");
  await new Promise((r) => setTimeout(r, 1100));
  await other.keyboard.up("Enter");
  await until("running again", async () => /RUNNING/.test(await state(page)), 15);

  // A reload has the history again.
  await page.reload({ waitUntil: "load" });
  await page.waitForSelector(".frame[data-look=running]");
  await new Promise((r) => setTimeout(r, 1000));
  await shot(page, "5-reloaded");

  // A marked stretch is enlarged from the raw samples; Escape goes back.
  const over = await (await page.$(".strip .u-over")).boundingBox();
  await page.mouse.move(over.x + over.width * 0.6, over.y + 30);
  await page.mouse.down();
  await page.mouse.move(over.x + over.width * 0.8, over.y + 40, { steps: 5 });
  await page.mouse.up();
  await page.waitForSelector(".windows .back");
  await new Promise((r) => setTimeout(r, 500));
  await shot(page, "5-enlarged");
  await page.keyboard.press("Escape");
  await until("now again", async () => (await page.$(".windows .back")) === null, 5);

  await until("the end", async () => /done/.test(await text(page, ".timeline .summary")), 120);
  const health = await text(page, ".health");
  assert.match(health, /no sample lost/);
  await shot(page, "6-done");
  assert.match(rig.isorig("runs", "--runs", join(rig.dir, "runs")), /done/);
  assert.deepEqual(errors, []);

  const memory = readFileSync(`/proc/${rig.web.pid}/status`, "utf8").match(/VmRSS:\s+(\d+)/)[1];
  console.log(`first paint ${Math.round(paint)} ms; isorig-web ${Math.round(memory / 1024)} MiB; ${health.match(/this page: [^◦]*/)[0].trim()}`);
  rig.web.kill("SIGTERM");
  assert.equal(await rig.web.ended, 0);
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  await browser?.close();
  rig.end();
}
