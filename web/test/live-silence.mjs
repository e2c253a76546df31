// The live page in Chromium when news stay away: of all that tells of now it says how old it is, and that is over with the next news.
// Real processes on the simulated rig, which are stopped as a machine that hangs stops them.
// Usage: node web/test/live-silence.mjs BIN_FOLDER SOURCE_FOLDER [FOLDER_FOR_SCREENSHOTS]
import assert from "node:assert/strict";
import { mkdirSync } from "node:fs";
import { join } from "node:path";
import { withBrowser } from "./browser.mjs";
import { Rig, until } from "./rig.mjs";

const [bin, source, shots] = process.argv.slice(2);
const rig = new Rig(bin, source);

const text = (page, selector) => page.$eval(selector, (e) => e.textContent);
/** Of each part of the page that tells of now: whether it stands there in grey, with its signs, and its age. */
const parts = (page) => page.$$eval(".values > div, .health", (all) => all.map((e) => {
  const grey = getComputedStyle(document.querySelector(".note")).color;
  const words = [...e.querySelectorAll(".big, li, li span")];
  return { name: e.querySelector("h2, h3").textContent, age: e.querySelector(".age")?.textContent ?? "",
    grey: words.filter((w) => getComputedStyle(w).color === grey).length / words.length };
}));

try {
  rig.startDaemon();
  const base = await rig.startWeb();
  await rig.reach("ready");
  await withBrowser(async (browser) => {
    const page = await browser.newPage();
    await page.setViewport({ width: 1440, height: 1000 });
    await page.goto(base, { waitUntil: "load" });
    await page.waitForSelector(".frame[data-look=ready]", { timeout: 20_000 });
    await page.waitForSelector(".health .good");
    for (const part of await parts(page)) assert.deepEqual([part.grey, part.age], [0, ""], part.name);
    for (const silent of [rig.web, rig.daemon]) {
      silent.kill("SIGSTOP");
      await until("no news", async () => /NO NEWS/.test(await text(page, ".state")), 20);
      const old = await parts(page);
      if (shots) {
        mkdirSync(shots, { recursive: true });
        await page.screenshot({ path: join(shots, `silence-${silent === rig.web ? "web" : "daemon"}.png`) });
      }
      assert.deepEqual(old.map((p) => p.name), ["force", "position", "pressure", "Interlocks"]);
      for (const part of old) {
        assert.match(part.age, /^STALE \d/, part.name);
        assert.equal(part.grey, 1, `${part.name} looks like news`);
      }
      silent.kill("SIGCONT");
      await until("news", async () => (await parts(page)).every((p) => p.grey === 0 && p.age === ""), 20);
    }
  });
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  for (const c of rig.children) c.kill("SIGCONT");
  rig.end();
}
