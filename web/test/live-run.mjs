// The live page in Chromium on the simulated rig: a run that ends in a fault, its reset, then a whole run with a twin that parts and
// pauses it, resume, pause, resume, done, its report; with a second page that may only look on. Real processes, real time; one
// and a half minutes.
// Usage: node web/test/live-run.mjs BIN_FOLDER SOURCE_FOLDER [FOLDER_FOR_SCREENSHOTS]
import assert from "node:assert/strict";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { button, checkAccessible, hold, press, pressShortly, withBrowser } from "./browser.mjs";
import { Rig, until } from "./rig.mjs";

const [bin, source, shots] = process.argv.slice(2);
const rig = new Rig(bin, source);

const text = (page, selector) => page.$eval(selector, (e) => e.textContent);
const state = (page) => text(page, ".state");
async function shot(page, name) {
  if (!shots) return;
  mkdirSync(shots, { recursive: true });
  await page.screenshot({ path: join(shots, `${name}.png`) });
}

async function axeClean(page, where) {
  for (const scheme of ["dark", "light"]) {
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
    await checkAccessible(page, `${where}, ${scheme}`);
  }
}

/** Pulls beyond the rig's limit of force. */
const TOO_FAR = `format = "isorig-protocol/1"
name = "too-far"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "ramp", to_mm = 4.5, velocity_mm_s = 5 },
  { do = "hold", duration_s = 5 },
]
`;
/** Three times as stiff as the simulated muscle. */
const WRONG_MODEL = `format = "isorig-model/1"
name = "wrong"
part = [
  { physics = "spring", law = "linear", stiffness_N_mm = 5.0 },
  { physics = "maxwell", law = "linear", stiffness_N_mm = 1.6, time_constant_s = 7.0 },
]
[seen]
position_mm = [-4, 4]
rate_mm_s = 11
travel_mm = 40
pressure_psi = [4.9, 5.1]
duration_s = 100
error_N = 0.05
covariance = [1e-6, 0, 1e-6, 0, 0, 1e-6]
nominal = [{ physics = "spring", law = "linear", stiffness_N_mm = 5.0 }]
`;

/** Checks the run that the dialog names, and holds Start. */
async function checkAndStart(page) {
  await press(page, await button(page, "Check"));
  await page.waitForSelector("dialog .seen");
  await hold(page, await page.$("dialog button.start"));
  await page.waitForFunction(() => document.querySelector(".state")?.textContent.includes("RUNNING"), { timeout: 20_000 });
}

async function newPage(context, errors, width = 1440, height = 1000) {
  const page = await context.newPage();
  await page.setViewport({ width, height });
  page.on("pageerror", (e) => errors.push(`pageerror: ${e.message}`));
  page.on("console", (m) => ["error", "warn"].includes(m.type()) && errors.push(`console: ${m.text()}`));
  return page;
}

async function live(browser, base) {
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
  await page.waitForSelector(".frame[data-look=ready]");
  assert.equal(new URL(page.url()).pathname, "/");
  assert.ok(!(await page.evaluate(() => document.cookie)), "a script can read the cookie");
  await shot(page, "1-ready");
  const again = await newPage(await browser.createBrowserContext(), []);
  await again.goto(link);
  await again.waitForFunction(() => /This link was used already/.test(document.body.textContent), { timeout: 10_000 });
  assert.equal((await again.cookies()).length, 0, "a link worked twice");
  await again.close();

  // Start: with specimen and operator, checked first.
  assert.ok(await (await button(page, "Start…")).evaluate((b) => b.disabled), "started without control");
  await press(page, await button(page, "Take control"));
  await until("control", async () => /control is here/.test(await text(page, ".who")));
  await until("the holder's name elsewhere", async () => /Ann has control/.test(await text(viewer, ".who")));

  // A run of a file of one's own that ends in a fault: seen on both pages, reset by holding.
  writeFileSync(join(rig.dir, "too-far.toml"), TOO_FAR);
  await press(page, await button(page, "Start…"));
  await page.waitForSelector("dialog[open] option:nth-child(3)");
  await (await page.$("dialog input[type=file]")).uploadFile(join(rig.dir, "too-far.toml"));
  await (await page.$$("dialog select"))[1].select(" own");
  await checkAndStart(page);
  await page.waitForSelector(".frame[data-look=fault]", { timeout: 30_000 });
  await until("the fault there", async () => /FAULT/.test(await state(viewer)), 10);
  assert.match(await text(page, ".faults"), /force/);
  assert.match(await text(viewer, ".faults"), /force/);
  assert.equal((await viewer.$$(".verbs")).length, 0);
  await shot(page, "1-fault");
  const reset = await button(page, "Reset");
  await pressShortly(page, reset);
  assert.match(await state(page), /FAULT/, "a short press reset the fault");
  // The rig has to be vented and to stand: until then the daemon says what it waits for.
  await until("the reset", async () => {
    if (!/FAULT/.test(await state(page))) return true;
    // Between the look and the button the state may have changed.
    const again = await button(page, "Reset").catch(() => null);
    if (again) await hold(page, again).catch(() => {});
    await new Promise((r) => setTimeout(r, 700));
    return false;
  }, 40);
  // A stop of the program can be gone on from; this run is given up, by holding.
  await until("paused", async () => /PAUSED/.test(await state(page)), 10);
  await hold(page, await button(page, "Abort"));
  await page.waitForSelector(".frame[data-look=ready]", { timeout: 30_000 });
  assert.equal((await viewer.$$(".faults")).length, 0, "a fault that was reset is shown on");

  // A model beside the rig, by who has control; one that is wrong pauses the run.
  writeFileSync(join(rig.models, "wrong.toml"), WRONG_MODEL);
  await press(page, await button(page, "Twin…"));
  await page.waitForSelector("dialog[open] option:nth-child(2)");
  const [chosen, parting] = await page.$$("dialog select");
  await chosen.select("wrong.toml");
  await parting.select("pause");
  await press(page, await button(page, "Step it"));
  await until("the twin", async () => /wrong\.toml begins when/.test(await text(page, ".twin")), 10);
  assert.match(rig.web.logged(), /twin wrong\.toml chosen by Ann/);

  await press(page, await button(page, "Start…"));
  await page.waitForSelector("dialog[open] option:nth-child(3)");
  const check = await button(page, "Check");
  assert.ok(await check.evaluate((b) => b.disabled), "checked without protocol and specimen");
  const [protocol, specimen] = await page.$$("dialog select");
  await protocol.select("shipped/vma-smoke.toml");
  await specimen.select(" own");
  assert.equal(await page.$eval("dialog input:not([type=file])", (e) => e.value), "Ann");
  await press(page, check);
  await page.waitForSelector("dialog .seen");
  await shot(page, "2-start");
  await pressShortly(page, await button(page, "Start"));  // Start… lies behind the dialog
  assert.ok(await page.$("dialog[open]"), "a short press started the run");
  const start = await page.$("dialog button.start");
  await pressShortly(page, start);
  assert.ok(await page.$("dialog[open]"), "a short press started the run");
  await hold(page, start);
  await page.waitForFunction(() => document.querySelector(".state")?.textContent.includes("RUNNING"), { timeout: 20_000 });

  // The first ramp moves the crosshead; every sample comes.
  await until("the ramp", async () => /ramp|hold/.test(await text(page, ".timeline .summary")), 40);
  await shot(page, "3-running");
  await shot(viewer, "3-running-phone");

  // The first stroke: the model pulls three times as much, and the run stands. A second viewer sees it.
  await until("paused by the twin", async () => /PAUSED/.test(await state(page)), 30);
  await until("the parting", async () => /Parted .* in step \d+/.test(await text(page, ".twin")), 10);
  assert.match(rig.web.logged(), /twin wrong\.toml and the muscle part in step/);
  assert.match(rig.web.logged(), /pause by the twin: /);
  await until("paused there", async () => /PAUSED/.test(await state(viewer)), 10);
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
  await new Promise((r) => setTimeout(r, 500));
  await shot(page, "4-paused-dark");

  await axeClean(page, "live");

  // Another operator takes over; the first one may still stop the rig, but not let it go on.
  const other = await newPage(await browser.createBrowserContext(), errors);
  await other.goto(rig.call("web", "--name", "Bob"), { waitUntil: "load" });
  await other.waitForSelector(".frame");  // the link's own page leads there
  await until("who has control", async () => /Ann has control/.test(await text(other, ".who")));
  await hold(other, await button(other, "Take over"));
  await until("taken over", async () => /Bob has control/.test(await text(page, ".who")), 10);
  assert.match(rig.web.logged(), /control taken over by Bob \(uid \d+\) from Ann/);
  assert.ok(await (await button(page, "Resume")).evaluate((b) => b.disabled));
  // Put away, or it would pause the next session, too.
  await press(other, await button(other, "Twin…"));
  await other.waitForSelector("dialog[open]");
  await press(other, await button(other, "Put away"));
  await until("no twin", async () => /No model is stepped/.test(await text(other, ".twin")), 10);
  await hold(other, await button(other, "Resume"), { key: "Enter" });
  await until("running again", async () => /RUNNING/.test(await state(page)), 15);

  // Pause at once, from the keyboard, by who has no control; let go again by who has.
  await page.keyboard.press("p");
  await until("paused", async () => /PAUSED/.test(await state(page)), 10);
  await hold(other, await button(other, "Resume"));
  await until("running once more", async () => /RUNNING/.test(await state(page)), 15);

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

  // The other pages, by keyboard: Tab to the link, Enter. Clean for axe, on a telephone too.
  for (const name of ["Runs", "Log", "Rig", "Calibration"]) {
    await page.evaluate((n) => [...document.querySelectorAll("nav a")].find((a) => a.textContent === n).focus(), name);
    await page.keyboard.press("Enter");
    await until(`page ${name}`, async () => (await text(page, "nav a[aria-current]")) === name, 5);
    await page.waitForSelector("main.page table tbody tr", { timeout: 20_000 });
    await axeClean(page, name);
    await shot(page, `7-${name.toLowerCase()}`);
  }
  await page.evaluate(() => { location.hash = "rig"; });
  await page.waitForFunction(() => /\d+ good/.test(document.querySelector("main.page")?.textContent ?? ""));
  await page.evaluate(() => { location.hash = "log"; });
  await page.waitForFunction(() => document.querySelector("main.page")?.textContent.includes("the muscle part in step"));
  await viewer.evaluate(() => { location.hash = "runs"; });
  await until("that runs need a session", async () => /Open the link of isorig web to see the runs/.test(await text(viewer, "main.page")), 5);
  assert.ok(await viewer.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "the page is wider than a telephone");
  await shot(viewer, "7-runs-phone");

  // Both runs, with their outcomes; the page of the one that is done, in an origin of its own; its curves.
  await page.evaluate(() => { location.hash = "runs"; });
  const report = await until("the report", async () => {
    const link = await page.$("main.page tbody tr:first-child th a");
    if (link) return link;
    await press(page, await button(page, "Look again"));
    return null;
  }, 30);
  assert.match(await text(page, "main.page tbody tr:first-child"), /✓ done.*Ann.*the muscle part in step/);
  assert.match(await text(page, "main.page tbody tr:nth-child(2)"), /■ aborted/);
  await press(page, await page.$("main.page tbody tr:first-child input"));
  await page.waitForSelector(".overlay svg");
  await shot(page, "8-overlay");
  await page.type("main.page input[type=search]", "aborted too-far");
  await until("the search", async () => (await page.$$("main.page tbody tr")).length === 1, 5);
  const own = await newPage(context, errors);
  const answer = await own.goto(base + (await report.evaluate((a) => a.getAttribute("href"))), { waitUntil: "load" });
  assert.match(answer.headers()["content-security-policy"], /^sandbox allow-scripts/);
  assert.match(answer.headers()["content-security-policy"], /default-src 'none'/);
  assert.equal(answer.headers()["cross-origin-opener-policy"], "unsafe-none");
  await own.waitForSelector("figure svg, figure canvas");
  // Its origin is its own, and it fetches nothing.
  assert.equal(await own.evaluate(() => self.origin), "null");
  assert.equal(await own.evaluate((url) => fetch(url).then(() => "fetched", () => "refused"), `${base}/api/runs`), "refused");
  errors.splice(0, errors.length, ...errors.filter((e) => !/Content Security Policy|violates|api\/runs/.test(e)));  // told on the console
  await own.close();
  assert.match(rig.isorig("runs", "--runs", join(rig.dir, "runs")), /done/);
  assert.deepEqual(errors, []);

  const memory = readFileSync(`/proc/${rig.web.pid}/status`, "utf8").match(/VmRSS:\s+(\d+)/)[1];
  console.log(`first paint ${Math.round(paint)} ms; isorig-web ${Math.round(memory / 1024)} MiB; ${health.match(/this page: [^◦]*/)[0].trim()}`);
  rig.web.kill("SIGTERM");
  assert.equal(await rig.web.ended, 0);
}

try {
  rig.startDaemon();
  const base = await rig.startWeb();
  await rig.reach("ready");
  await withBrowser((browser) => live(browser, base));
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  rig.end();
}
