// What the live page draws, and how evenly: headless Chromium beside a daemon that samples the simulated rig at 1 kHz and
// moves it. Holds what was in the page's memory when it drew against what was sent. Prints, and does not judge, the times
// between frames, the longest task of the main thread and its share of the time: they depend on what else the machine does.
// Usage: node web/test/live-frames.mjs BIN_FOLDER SOURCE_FOLDER [SECONDS=10] [WINDOW=2, the second of the buttons]
import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import { join } from "node:path";
import { withBrowser } from "./browser.mjs";
import { Rig, until } from "./rig.mjs";

const [bin, source, lasts = "10", window = "2"] = process.argv.slice(2);
const rig = new Rig(bin, source);
const FINE_NS = 20e6, HEAD = 24;
/** When to give up, not how fast it has to be. */
const PATIENCE_S = 120, PATIENCE = { timeout: PATIENCE_S * 1000 };

/** A triangle for longer than anybody looks. */
const MOVES = `format = "isorig-protocol/1"
name = "moves"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "wave", shape = "triangle", amplitude_mm = 1, frequency_hz = 0.5, cycles = 1000 },
]
`;

/** Blocks of one message, of one stream and tier: index of each stretch with its columns (docs/web.md). */
function stretches(bytes, stream, tier) {
  const out = new Map();
  for (let at = 0; at < bytes.length;) {
    const columns = bytes.readUInt16LE(at + 2), count = bytes.readUInt32LE(at + 4), first = bytes.readDoubleLE(at + 8);
    const width = bytes.readDoubleLE(at + 16);
    if (bytes[at] === stream && bytes[at + 1] === tier) {
      for (let i = 0; i < count; ++i) {
        out.set(first + bytes.readUInt32LE(at + HEAD + 4 * i), Array.from({ length: columns }, (_, c) => bytes.readFloatLE(at + HEAD + 4 * (count * (1 + c) + i))));
      }
    }
    at += HEAD + 4 * count * (1 + columns);
    out.width = width;
  }
  return out;
}
const quantile = (sorted, q) => sorted[Math.min(sorted.length - 1, Math.floor(q * sorted.length))];

try {
  rig.startDaemon();
  const base = await rig.startWeb();
  await rig.reach("ready");
  writeFileSync(join(rig.dir, "moves.toml"), MOVES);
  await withBrowser(async (browser) => {
    const page = await browser.newPage();
    await page.setViewport({ width: 1440, height: 1000 });
    const sent = new Map();
    const session = await page.createCDPSession();
    await session.send("Network.enable");
    session.on("Network.webSocketFrameReceived", ({ response }) => {
      if (response.opcode !== 2) return;
      for (const [index, columns] of stretches(Buffer.from(response.payloadData, "base64"), 0, 0)) sent.set(index, columns);
    });
    await page.goto(base, { waitUntil: "load" });
    await page.waitForSelector(".frame[data-look=ready]", PATIENCE);
    rig.call("start", join(rig.dir, "moves.toml"));
    await page.waitForFunction(() => document.querySelector(".timeline .summary")?.textContent.includes("triangle"), PATIENCE);
    await page.keyboard.press(window);
    await page.waitForFunction(() => Number.isFinite(Number(document.querySelector(".strips").dataset.drawnUntil)), PATIENCE);

    const before = await page.metrics();
    await page.evaluate(() => {
      const strips = document.querySelector(".strips"), at = () => ({ drawn: Number(strips.dataset.drawn), until: Number(strips.dataset.drawnUntil) });
      const tasks = [], frames = [], first = at();
      new PerformanceObserver((list) => tasks.push(...list.getEntries().map((e) => e.duration))).observe({ entryTypes: ["longtask"] });
      let last = 0;
      const frame = (t) => {
        if (last > 0) frames.push(t - last);
        last = t;
        requestAnimationFrame(frame);
      };
      requestAnimationFrame(frame);
      globalThis.told = () => ({ frames, tasks, first, end: at() });
    });
    await new Promise((r) => setTimeout(r, Number(lasts) * 1000));
    const told = await page.evaluate(() => globalThis.told());
    const after = await page.metrics();
    await until("what was sent last", () => sent.has(told.end.until), PATIENCE_S);

    // What was sent was in the page's memory when it drew: every stretch, and each sample lies between the lowest and the
    // highest of its stretch.
    const drawn = told.end.drawn - told.first.drawn;
    const meant = [...sent.keys()].filter((i) => i > told.first.until && i <= told.end.until);
    let samples = 0, outside = 0;
    for (let from = (told.first.until + 1) * FINE_NS, end = (told.end.until + 1) * FINE_NS; from < end; from += 3e9) {
      const answer = await fetch(`${base}/api/zoom?from=${from}&to=${Math.min(end, from + 3e9)}&stretches=3000`);
      const raw = stretches(Buffer.from(await answer.arrayBuffer()), 0, 2);
      for (const [index, columns] of raw) {
        const stretch = sent.get(Math.floor((index * raw.width) / FINE_NS)), ns = index * raw.width;
        if (ns < from || ns >= Math.min(end, from + 3e9)) continue;
        ++samples;
        for (const c of [0, 3]) if (!stretch || columns[c] < stretch[c] || columns[c + 1] > stretch[c + 1]) ++outside;
      }
    }
    const seconds = ((told.end.until - told.first.until) * FINE_NS) / 1e9;
    const frames = told.frames.sort((a, b) => a - b);
    const busy = (after.TaskDuration - before.TaskDuration) / (after.Timestamp - before.Timestamp);
    const ms = (v) => `${v.toFixed(1)} ms`;
    console.log(`${seconds.toFixed(1)} s, ${samples} samples sent (${(samples / seconds).toFixed(0)} a second), ${meant.length} stretches of 20 ms sent, ${drawn} drawn, ${outside} samples outside of what was drawn`);
    console.log(`frames: ${frames.length} (${(frames.length / (frames.reduce((a, b) => a + b, 0) / 1000)).toFixed(1)} a second), median ${ms(quantile(frames, 0.5))}, 95 % ${ms(quantile(frames, 0.95))}, ` +
      `99 % ${ms(quantile(frames, 0.99))}, longest ${ms(frames.at(-1))}; over 50 ms: ${frames.filter((f) => f > 50).length}`);
    console.log(`main thread: busy ${(100 * busy).toFixed(0)} % of the time (scripts ${(100 * (after.ScriptDuration - before.ScriptDuration) / (after.Timestamp - before.Timestamp)).toFixed(0)} %), ` +
      `${told.tasks.length} tasks over 50 ms, longest ${told.tasks.length ? ms(Math.max(...told.tasks)) : "below 50 ms"}; JS heap ${(after.JSHeapUsedSize / 2 ** 20).toFixed(0)} MiB`);

    assert.ok(meant.length > 0 && samples > 0, "nothing was sent");
    assert.equal(drawn, meant.length, "stretches that were sent and not drawn");
    assert.equal(outside, 0, "samples outside of what was drawn");
    // Force over length is there without a twin, too.
    assert.equal((await page.$$(".twin h2")).length, 0);
    await page.waitForFunction(() => {
      const c = document.querySelector(".loop canvas"), bits = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
      let blue = 0;
      for (let i = 0; i < bits.length; i += 4) blue += bits[i + 2] > bits[i] + 60 && bits[i + 3] > 100 ? 1 : 0;
      return blue > 300;
    }, { ...PATIENCE, polling: 500 });
  });
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  rig.end();
}
