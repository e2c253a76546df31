// Reports inside isorig-web, in Chromium: from a run to its curves, to its diagnosis and back by clicks; a report that somebody
// has planted reads nothing and does nothing. Real processes and real reports of a short simulated run.
// Usage: node web/test/live-reports.mjs BIN_FOLDER SOURCE_FOLDER [FOLDER_FOR_SCREENSHOTS]
import assert from "node:assert/strict";
import { mkdirSync, readdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { checkAccessible, press, settled, withBrowser } from "./browser.mjs";
import { Rig, until } from "./rig.mjs";

const [bin, source, shots] = process.argv.slice(2);
const rig = new Rig(bin, source);
const SECRET = "the secret of another run";

/** What a script tries that stands in a report: to each the answer, "got …" where it got something. Runs in the page. */
async function attack(target) {
  const within = (promise) => Promise.race([promise, new Promise((done) => setTimeout(() => done("nothing came"), 1500))]);
  const tries = {
    fetch: async () => `got ${(await (await fetch(target, { credentials: "include" })).text()).length} bytes`,
    api: async () => `got ${(await fetch("/api/runs", { credentials: "include" })).status}`,
    post: async () => `got ${(await fetch("/api/pause", { method: "POST", credentials: "include", headers: { "Content-Type": "application/json" }, body: "{}" })).status}`,
    blind: async () => `got ${(await fetch("/api/pause", { method: "POST", mode: "no-cors", body: "{}" })).type}`,
    request: () => new Promise((done) => {
      const x = new XMLHttpRequest();
      x.open("GET", target);
      x.onload = () => done(`got ${x.status}`);
      x.onerror = () => done("refused");
      x.send();
    }),
    socket: () => new Promise((done) => {
      const s = new WebSocket(`ws://${location.host}/live`);
      s.onmessage = () => done("got a message");
      s.onerror = () => done("refused");
    }),
    frame: () => new Promise((done) => {
      const f = document.createElement("iframe");
      f.onload = () => {
        try {
          done(`got ${f.contentDocument.body.innerText}`);
        } catch (e) {
          done(e.name);
        }
      };
      f.src = target;
      document.body.append(f);
    }),
    picture: () => new Promise((done) => {
      const i = new Image();
      i.onload = () => done("got a picture");
      i.onerror = () => done("refused");
      i.src = target;
    }),
    script: () => new Promise((done) => {
      const s = document.createElement("script");
      s.onload = () => done("got a script");
      s.onerror = () => done("refused");
      s.src = "/live.js";
      document.body.append(s);
    }),
    form: async () => {
      const f = document.createElement("form");
      f.method = "POST";
      f.action = "/api/pause";
      document.body.append(f);
      f.submit();
      return "sent, if it was";
    },
    cookie: async () => (document.cookie === "" ? "none" : `got ${document.cookie}`),
    storage: async () => `got ${localStorage.length}`,
    database: async () => `got ${(await indexedDB.databases()).length}`,
    window: async () => (window.open(target) === null ? "refused" : "got a window"),
    opener: async () => (window.opener === null ? "none" : "got an opener"),
    worker: () => new Promise((done) => {
      const w = new Worker(URL.createObjectURL(new Blob(["postMessage(1)"])));
      w.onmessage = () => done("got a worker");
      w.onerror = () => done("refused");
    }),
    service: async () => `got ${await navigator.serviceWorker.register("/live.js")}`,
  };
  const out = {};
  for (const [name, attempt] of Object.entries(tries)) {
    try {
      out[name] = await within(attempt());
    } catch (e) {
      out[name] = e.name;
    }
  }
  return out;
}

const heading = (page) => page.$eval("h1", (e) => e.textContent);
const kind = (page) => page.$eval(".kind", (e) => e.textContent);
/** A click on the link of that name, and the report it leads to. */
async function follow(page, name, expected) {
  const link = await page.evaluateHandle((n) => [...document.querySelectorAll("nav.links a")].find((a) => a.textContent.startsWith(n)), name);
  assert.ok(link.asElement(), `no link ${name}: ${await page.$$eval("nav.links a", (all) => all.map((a) => a.textContent))}`);
  await press(page, link.asElement());
  await until(expected, async () => (await kind(page).catch(() => "")) === expected, 20);  // on the way there is no such element
  await page.waitForSelector("figure svg");
  assert.equal(await page.evaluate(() => self.origin), "null", `${expected} has an origin of its own`);
}
async function shot(page, name) {
  if (!shots) return;
  mkdirSync(shots, { recursive: true });
  await settled(page);
  await page.screenshot({ path: join(shots, `${name}.png`) });
}

try {
  const runs = join(rig.dir, "runs");
  const run = JSON.parse(rig.isorig("run", join(rig.source, "config/protocols/vma-short.toml"), "--rig", join(rig.source, "config/rigs/sim.toml"), "--runs", runs, "--json", "--quiet"));
  rig.isorig("export", run.directory, "--out", join(run.directory, "recordings"));
  const recordings = readdirSync(join(run.directory, "recordings")).map((name) => join(run.directory, "recordings", name));
  rig.isorig("fv", ...recordings, "--out", join(run.directory, "curves of 5 psi"));  // a blank in a name
  const diagnoses = join(rig.dir, "diagnoses");  // beside the runs, where isorigd looks for them
  rig.isorig("diagnose", recordings[0], "--model", "slse1", "--out", join(run.directory, "diagnosis"));
  rig.isorig("diagnose", recordings[0], "--model", "slse1", "--out", join(diagnoses, "beside"));
  rig.isorig("report", run.directory);
  mkdirSync(join(runs, "other"));
  writeFileSync(join(runs, "other", "report.html"), `<title>${SECRET}</title><p>${SECRET}</p>`);
  const target = `/page${join(runs, "other", "report.html")}`;
  mkdirSync(join(run.directory, "planted"));
  writeFileSync(join(run.directory, "planted", "diagnosis.json"), "{}");
  writeFileSync(join(run.directory, "planted", "diagnosis-report.html"),
    `<!DOCTYPE html><title>planted</title><body><a id="out" href="../../other/report.html">on</a><script>
     (${attack})(${JSON.stringify(target)}).then((said) => { document.title = "tried"; window.said = said; });</script>`);
  rig.startDaemon();
  const base = await rig.startWeb();
  await rig.reach("ready");

  await withBrowser(async (browser) => {
    const context = await browser.createBrowserContext();
    const page = await context.newPage();
    page.setDefaultTimeout(30_000);
    await page.setViewport({ width: 1280, height: 900 });
    const own = `${base}/page${join(run.directory, "report.html")}`;

    // Without a session the live page says what is missing, and does not go round in a circle.
    let asked = 0;
    page.on("request", (r) => (asked += new URL(r.url()).pathname.startsWith("/page/") ? 1 : 0));
    await page.goto(own, { waitUntil: "load" });
    await until("that it needs a session", async () => /Open the link of isorig web to see this report/.test(await page.$eval("main.page", (e) => e.textContent).catch(() => "")), 20);
    await new Promise((r) => setTimeout(r, 1000));
    assert.ok(asked <= 2, `asked ${asked} times`);
    assert.equal(await page.evaluate(async (path) => (await fetch(path)).status, target), 403, "what is no navigation is refused");

    // From the list of runs through all neighbours, and back.
    await page.goto(rig.call("web", "--name", "Ann"), { waitUntil: "load" });
    await page.waitForSelector(".frame");  // the link's own page leads there
    await page.evaluate(() => { location.hash = "runs"; });
    const link = await page.waitForSelector("main.page tbody th a");
    const opened = new Promise((done) => browser.on("targetcreated", async (t) => t.type() === "page" && done(await t.page())));
    await press(page, link);
    const report = await opened;
    report.setDefaultTimeout(30_000);
    await report.setViewport({ width: 1280, height: 900 });
    await report.waitForSelector("figure svg");
    assert.equal(await kind(report), "Run");
    const of_run = await heading(report);
    await checkAccessible(report, "a run's report in isorig-web");
    await shot(report, "report-served");
    await follow(report, "Force-velocity analysis (curves of 5 psi)", "Force-velocity analysis");
    await follow(report, "Run", "Run");
    assert.equal(await heading(report), of_run);
    await follow(report, "Diagnosis (diagnosis)", "Diagnosis");
    await shot(report, "diagnosis-served");
    await follow(report, "Force-velocity analysis", "Force-velocity analysis");
    for (const [step, expected] of [["goBack", "Diagnosis"], ["goBack", "Run"], ["goForward", "Diagnosis"], ["reload", "Diagnosis"]]) {
      await report[step]({ waitUntil: "load" });
      await until(`${expected} after ${step}`, async () => (await kind(report).catch(() => "")) === expected, 20);
    }
    // To the lists of the live page, with its session.
    await press(report, await report.$("nav.links a[href='/#diagnosis']"));
    await report.waitForSelector("section.diagnosis");
    // One that lies elsewhere than its run, to the run and no farther: its neighbours are named by relative paths.
    await report.goto(`${base}/page${join(diagnoses, "beside", "diagnosis-report.html")}`, { waitUntil: "load" });
    await report.waitForSelector("figure svg");
    await follow(report, "Run", "Run");
    assert.equal(await heading(report), of_run);
    // What is not there is said in words.
    const gone = await report.goto(own.replace("report.html", "fv-report.html"), { waitUntil: "load" });
    assert.equal(gone.status(), 404);
    assert.match(await report.evaluate(() => document.body.innerText), /^there is no such page among the runs and the diagnoses/);
    assert.equal((await report.goto(`${base}/page/etc/passwd`)).status(), 400);

    // The same attempts succeed on the live page itself, and in a planted report none does.
    const could = await page.evaluate(attack, target);
    for (const name of ["fetch", "api", "post", "request", "socket", "storage"]) assert.match(could[name], /^got/, name);
    await until("that the live page's own call is logged", () => /pause by Ann/.test(rig.web.logged()), 20);
    const before = rig.web.logged().length, audited = rig.isorig("audit", "--all", "--json", "--runs", runs);
    const planted = await context.newPage();
    const came = [];
    planted.on("requestfinished", (r) => came.push(r.url()));
    await page.goto(`${base}/#diagnosis`, { waitUntil: "load" });
    await planted.goto(`${base}/page${join(run.directory, "planted", "diagnosis-report.html")}`, { waitUntil: "load" });
    await planted.waitForFunction(() => document.title === "tried", { timeout: 60_000 });
    const said = await planted.evaluate(() => window.said);
    for (const [name, answer] of Object.entries(said)) assert.doesNotMatch(answer, /^got/, `${name}: ${answer}`);
    assert.equal(planted.url(), `${base}/page${join(run.directory, "planted", "diagnosis-report.html")}`, "the form went nowhere");
    assert.deepEqual(came.filter((url) => url !== planted.url() && !url.startsWith("data:") && !url.startsWith("blob:")), []);
    // It may lead the browser on, as any link does, to what is shown in an origin of its own: it is gone then.
    await planted.evaluate((path) => { location.href = `/#${path}`; }, target);
    await until("the other report", async () => (await planted.title().catch(() => "")) === SECRET, 20);
    assert.deepEqual(await planted.evaluate(() => [self.origin, window.opener, window.name, typeof window.said]), ["null", null, "", "undefined"]);
    // And nowhere else: no call of the server, no other site.
    for (const hash of ["/page//evil.example/report.html", "/page/../api/runs.html", "/enter?token=x", "//evil.example/x.html"]) {
      await planted.goto(`${base}/#${hash}`, { waitUntil: "load" });
      await planted.waitForSelector(".frame[data-look]");
      assert.equal(new URL(planted.url()).origin + new URL(planted.url()).pathname, `${base}/`, hash);
    }
    assert.doesNotMatch(rig.web.logged().slice(before), / by /, "a verb was called");
    assert.equal(rig.isorig("audit", "--all", "--json", "--runs", runs), audited, "a command came to isorigd");
  });
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  rig.end();
}
