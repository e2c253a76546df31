// The pages on which one works, in Chromium on the simulated rig: a protocol with an error is mended, saved and started; a
// diagnosis is opened and its experiment queued; a run that was interrupted goes on. Real processes; about two minutes.
// Usage: node web/test/live-pages.mjs BIN_FOLDER SOURCE_FOLDER [FOLDER_FOR_SCREENSHOTS]
import assert from "node:assert/strict";
import { existsSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { button, checkAccessible, hold, press, settled, withBrowser } from "./browser.mjs";
import { Rig, until } from "./rig.mjs";

const [bin, source, shots] = process.argv.slice(2);
const rig = new Rig(bin, source);

const PROTOCOL = `format = "isorig-protocol/1"
name = "of the page"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "ramp", to_mm = 0.5, velocity_mm_s = 5 },
  { do = "hold", duration_s = 1 },
]
`;
const ERROR = PROTOCOL.replace("to_mm = 0.5", "to_mn = 0.5").replace("pressure_psi = 5,", "pressure_psi = 900,");

/** Two repetitions, so that one can be done and one left: each long enough that the second is under way when the first is seen. */
const TWO = `format = "isorig-protocol/1"
name = "two"
steps = [ { do = "repeat", unit = "session", for = { repetition = [1, 2] }, steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "hold", duration_s = 15 },
] } ]
`;

const DIAGNOSIS = {
  format: "isorig-diagnosis/1", verdict: "missing_physics", cannot_judge: null,
  missing: [{ effect: "coulomb_friction", probability: 0.72, size_N: 0.013, law: "dahl", parameters: { force_N: { value: 0.013, ci95: [0.011, 0.0152] } }, shape: { x: [], y: [] } }],
  alternatives: [{ effects: ["crosshead_backlash"], probability: 0.24 }],
  discernible: [{ effect: "coulomb_friction", law: "dahl", seen_from_N: 0.004, nearest: "crosshead_backlash", told_from_N: 0.03 }],
  next_experiment: { name: "settle-friction", text: "triangles of 2 mm at 10 mm/s, 2 times", protocol: "next_experiment.toml", duration_s: 28.1, reaches_it: true, separates: ["coulomb_friction", "crosshead_backlash"] },
  inseparable: [{ text: "A lag and a dead time cannot be told apart by this rig." }],
  data_faults: [{ kind: "gap" }], warnings: ["recordings at several pressures"], notes: [],
};

const shown = (page, name) => page.evaluate((n) => { location.hash = n; }, name);
const text = (page, selector) => page.$eval(selector, (e) => e.textContent);
/** Types over all that stands in the editor. */
async function write(page, what) {
  await page.focus(".editor textarea");
  await page.keyboard.down("Control");
  await page.keyboard.press("a");
  await page.keyboard.up("Control");
  await page.evaluate((t) => document.execCommand("insertText", false, t), what);
}
/** In the page, from its beginning: where on the line the button of this name stood in any frame, in pixels. */
function recordPlaces(name) {
  globalThis.places = [];
  const look = () => {
    const at = [...document.querySelectorAll("button")].find((b) => b.textContent === name)?.getBoundingClientRect().x;
    if (at !== undefined && at !== globalThis.places.at(-1)) globalThis.places.push(at);
    requestAnimationFrame(look);
  };
  look();
}
/** Seen on a desk in both themes, and on a telephone. */
async function look(page, name) {
  for (const scheme of ["light", "dark"]) {
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
    await new Promise((r) => setTimeout(r, 400));  // a canvas is painted with the next news
    await settled(page);
    await checkAccessible(page, `${name}, ${scheme}`);
    await shot(page, `${name}-${scheme}`);
  }
  await page.setViewport({ width: 390, height: 844 });
  await settled(page);
  assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${name} is wider than a telephone`);
  await checkAccessible(page, `${name}, telephone`);
  await shot(page, `${name}-phone`);
  await page.setViewport({ width: 1440, height: 1000 });
  await page.evaluate(() => scrollTo(0, 0));
  await settled(page);
}
async function shot(page, name) {
  if (!shots) return;
  mkdirSync(shots, { recursive: true });
  await page.evaluate(() => scrollTo(0, 0));
  await page.screenshot({ path: join(shots, `${name}.png`), fullPage: true });
}

try {
  rig.startDaemon();
  const base = await rig.startWeb();
  await rig.reach("ready");
  await withBrowser(async (browser) => {
    const errors = [];
    const context = await browser.createBrowserContext();
    const page = await context.newPage();
    page.setDefaultTimeout(60_000);
    await page.setViewport({ width: 1440, height: 1000 });
    page.on("pageerror", (e) => errors.push(`pageerror: ${e.message}`));
    page.on("console", (m) => ["error", "warn"].includes(m.type()) && errors.push(`console: ${m.text()} ${m.location().url ?? ""}`));

    // Without a session nothing of it is there.
    await page.goto(`${base}/#protocol`, { waitUntil: "load" });
    await until("that it needs a session", async () => /Open the link of isorig web/.test(await text(page, "main.page")));
    for (const path of ["protocol?from=shipped&name=vma-smoke.toml", "experiment?id=0123456789abcdef", "diagnoses"]) {
      assert.equal(await page.evaluate(async (p) => (await fetch(`/api/${p}`)).status, path), 403, path);
    }
    for (const call of ["check", "save"]) {
      assert.equal(await page.evaluate(async (c) => (await fetch(`/api/${c}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: "{}" })).status, call), 403, call);
    }
    errors.length = 0;  // Chromium tells of the 403 on the console

    await page.goto(rig.call("web", "--name", "Ann"), { waitUntil: "load" });
    await page.waitForSelector(".frame[data-look=ready]");
    await press(page, await button(page, "Take control"));

    // A protocol with errors: the daemon's own words, with their places.
    await shown(page, "protocol");
    await page.waitForSelector(".editor textarea");
    await until("the skeleton is well", async () => /new\.toml is well/.test(await text(page, "#diagnostics")));
    const name = await page.$("input[aria-invalid]");
    await name.click({ count: 3 });
    await name.type("page.toml");
    await write(page, ERROR);
    await until("the errors", async () => /errors, as isorig check says them/.test(await text(page, "#diagnostics")));
    writeFileSync(join(rig.dir, "page.toml"), ERROR);
    const said = await page.$$eval("#diagnostics li", (all) => all.map((e) => e.textContent));
    assert.ok(said.length >= 2, said.join("\n"));
    assert.ok(said.some((s) => s.includes("did you mean `to_mm`?")), said.join("\n"));
    assert.deepEqual(said, rig.refusal("check", join(rig.dir, "page.toml"), "--rig", join(rig.dir, "rig.toml"))
      .map((line) => line.replace(`${rig.dir}/`, "")), "isorig check says the same");
    assert.ok(await (await button(page, "Start this")).evaluate((b) => b.disabled), "a wrong protocol can be started");
    // A click on a message leads to its place.
    const places = await page.$$("#diagnostics li button");
    await press(page, places[said.findIndex((s) => s.includes("to_mn"))]);
    await settled(page);
    assert.match(await page.evaluate(() => {
      const e = document.querySelector(".editor textarea");
      return document.activeElement === e ? e.value.slice(e.selectionStart, e.selectionEnd) : "the editor has no focus";
    }), /^to_mn|^\{ do = "ramp"/);
    await look(page, "protocol-wrong");
    // A letter that is typed is a letter: `p` elsewhere pauses.
    await page.keyboard.press("End");
    await page.keyboard.press("p");

    // Mended: drawn, saved.
    await write(page, PROTOCOL);
    await until("that it is well", async () => /page\.toml is well: of the page/.test(await text(page, "#diagnostics")));
    await until("the plan", async () => (await page.$$(".plan svg.chart")).length === 2);
    assert.match(await text(page, ".plan .seen"), /expected;.*at worst.*1 pressurize, 1 ramp, 1 hold.*up to 5 psi.*within those of sim/);
    assert.equal((await page.$$(".plan .steps tbody tr")).length, 3);
    await look(page, "protocol");
    await press(page, await button(page, "Save"));
    await until("that it is saved", () => existsSync(join(rig.saved, "page.toml")));
    assert.equal(readFileSync(join(rig.saved, "page.toml"), "utf8"), PROTOCOL);
    // What was saved after the letter is logged: a pause would be, too.
    await until("that the saving is logged", () => /page\.toml saved in/.test(rig.web.logged()));
    assert.doesNotMatch(rig.web.logged(), /pause by/);

    // A reload loses nothing; what somebody else has changed is not replaced in silence.
    const theirs = PROTOCOL + "# by somebody else\n";
    writeFileSync(join(rig.saved, "page.toml"), theirs);
    await write(page, PROTOCOL + "# mine\n");
    await page.waitForFunction(() => JSON.parse(localStorage.getItem("protocol-draft") ?? "{}").text?.endsWith("# mine\n"));
    await page.evaluateOnNewDocument(recordPlaces, "Save");
    await page.reload({ waitUntil: "load" });
    await page.waitForSelector(".editor textarea");
    await page.waitForSelector(".bar select option:nth-child(2), .bar select optgroup");
    await settled(page);
    const stood = await page.evaluate(() => globalThis.places);
    assert.equal(stood.length, 1, `Save moved sideways while the page came up, to ${stood}`);
    assert.equal(await page.$eval(".editor textarea", (e) => e.value), PROTOCOL + "# mine\n");
    assert.match(await text(page, "main.protocol h2"), /not saved/);
    await press(page, await button(page, "Save"));
    await until("the conflict", async () => /was changed by somebody else/.test((await page.$(".conflict")) ? await text(page, ".conflict") : ""));
    assert.equal(readFileSync(join(rig.saved, "page.toml"), "utf8"), theirs);
    errors.splice(0, errors.length, ...errors.filter((e) => !/status of (404|409|400)/.test(e)));  // told on the console
    await hold(page, await button(page, "Replace page.toml"));
    await until("that it is replaced", () => readFileSync(join(rig.saved, "page.toml"), "utf8").includes("# mine"));
    assert.equal(readFileSync(join(rig.saved, "page.toml~"), "utf8"), theirs);
    assert.match(rig.web.logged(), /page\.toml saved in .*, by Ann \(uid \d+\)/);

    // Started from here, by the dialog that starts any; and it is in the list of all.
    await until("that it is well again", async () => /is well/.test(await text(page, "#diagnostics")));
    await press(page, await button(page, "Start this"));
    await page.waitForSelector("dialog[open]");
    await page.select("dialog select", " own");
    await press(page, await button(page, "Check", "dialog"));
    await page.waitForSelector("dialog .seen");
    await hold(page, await page.$("dialog button.start"));
    await page.waitForFunction(() => document.querySelector(".state")?.textContent.includes("RUNNING"), { timeout: 60_000 });
    await until("its end", async () => /done/.test(JSON.stringify(JSON.parse(rig.call("status", "--json")).last_run ?? {})));
    await rig.reach("ready");

    // A diagnosis beside the run: its verdict, its numbers, what speaks against them; its own page; its experiment.
    const run = JSON.parse(rig.isorig("runs", "--json", "--runs", join(rig.dir, "runs")))[0].id;
    const folder = join(rig.dir, "runs", run, "diagnosis");
    mkdirSync(folder);
    writeFileSync(join(folder, "diagnosis.json"), JSON.stringify(DIAGNOSIS));
    writeFileSync(join(folder, "diagnosis-report.html"), "<!DOCTYPE html><title>d</title><script>document.title = 'argues ' + self.origin;</script>");
    writeFileSync(join(folder, "next_experiment.toml"), PROTOCOL.replace("of the page", "settle-friction"));
    await shown(page, "diagnosis");
    await until("the diagnosis", async () => /settle it/.test(await text(page, "main.page")));
    const diagnosis = await text(page, "section.diagnosis");
    for (const words of [/physics is missing/, /dry friction/, /0\.72/, /force 0\.0130? \[0\.011[^\]]*\]\sN/, /not settled: less than 0\.9/, /told from play in the crosshead from 0\.03 N on/,
      /Other explanations: play in the crosshead \(p = 0\.24\)/, /recordings at several pressures/, /A lag and a dead time/, /1 fault in the data/, /triangles of 2 mm at 10 mm\/s/]) {
      assert.match(diagnosis, words);
    }
    await look(page, "diagnosis");
    const own = await context.newPage();
    const answer = await own.goto(base + (await page.$eval("section.diagnosis a", (a) => a.getAttribute("href"))), { waitUntil: "load" });
    assert.match(answer.headers()["content-security-policy"], /^sandbox allow-scripts/);
    assert.equal(await own.title(), "argues null", "the page of a diagnosis has an origin of its own");
    await own.close();
    await press(page, await button(page, "Queue this experiment"));
    await page.waitForSelector(".editor textarea");
    assert.equal(await page.evaluate(() => location.hash), "#protocol");
    await until("the experiment", async () => /settle-friction\.toml is well: settle-friction/.test(await text(page, "#diagnostics")));
    assert.equal(JSON.parse(rig.call("status", "--json")).state, "ready", "an experiment that is queued was started");
    // It is not lost to the next one in silence.
    await shown(page, "diagnosis");
    await page.waitForSelector("section.diagnosis");
    await press(page, await button(page, "Queue this experiment"));
    await page.waitForSelector("dialog[open]");
    assert.match(await text(page, "dialog"), /not saved/);
    await press(page, await button(page, "Go and save it"));

    // A run that was interrupted goes on from here: asked for specimen and operator as a start is.
    await page.waitForSelector(".editor textarea");
    writeFileSync(join(rig.dir, "two.toml"), TWO);
    rig.call("start", join(rig.dir, "two.toml"), "--operator", "Ann");
    await rig.reach("running");
    // Done is a repetition whose data are on the disk.
    await until("the first repetition", () => JSON.parse(rig.isorig("runs", "--json", "--runs", join(rig.dir, "runs")))[0].sessions_done === 1, 120);
    rig.daemon.kill("SIGKILL");
    await rig.daemon.ended;
    rig.startDaemon();
    await rig.reach("ready");
    await shown(page, "runs");
    await until("the interrupted run", async () => /interrupted/.test(await text(page, "main.page")));
    await until("that the rig is ready", async () => !(await (await button(page, "Go on…")).evaluate((b) => b.disabled)));
    await press(page, await button(page, "Go on…"));
    await page.waitForSelector("dialog[open]");
    assert.ok(await (await button(page, "Check", "dialog")).evaluate((b) => b.disabled), "went on without a specimen");
    await page.select("dialog select", " own");
    await press(page, await button(page, "Check", "dialog"));
    await page.waitForSelector("dialog .seen");
    assert.match(await text(page, "dialog .seen"), /from repetition 2 of 2/);
    await look(page, "go-on");
    await hold(page, await page.$("dialog button.start"));
    await until("its end", () => JSON.parse(rig.isorig("runs", "--json", "--runs", join(rig.dir, "runs")))[0].state === "done", 120);
    const whole = JSON.parse(rig.isorig("runs", "--json", "--runs", join(rig.dir, "runs")))[0];
    assert.deepEqual([whole.sessions_done, whole.attempts], [2, 2]);
    errors.splice(0, errors.length, ...errors.filter((e) => !/status of (400|404|409|502)|WebSocket/.test(e)));
    assert.deepEqual(errors, []);
  });
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  rig.end();
}
