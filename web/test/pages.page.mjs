// Real pages of every kind, as the program writes them, in a browser: node web/test/pages.page.mjs ISORIG SOURCE [KEEP]
// With KEEP, an empty folder, everything stays there, with pictures and PDFs of each page.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { checkPage, open, papers, checkPrint, withBrowser } from "./browser.mjs";

const [isorig, source, keep] = process.argv.slice(2);
const folder = keep ?? mkdtempSync(join(tmpdir(), "isorig-pages-"));
const rig = join(source, "config/rigs/sim.toml");
const call = (...words) => execFileSync(isorig, words, { encoding: "utf8", stdio: ["ignore", "pipe", "inherit"] });

/** Text of the page, its sections, and what its figures draw. */
async function look(browser, file) {
  const figures = await checkPage(browser, file);
  const page = await open(browser, file);
  const text = await page.evaluate(() => document.body.innerText);
  const sections = await page.$$eval("h2", (all) => all.map((h) => h.textContent));
  const links = await page.$$eval("nav.links a", (all) => all.map((a) => a.getAttribute("href")));
  if (keep) {
    await page.setViewport({ width: 1280, height: 900 });
    const height = await page.evaluate(() => document.documentElement.scrollHeight);
    for (let y = 0, k = 0; y < height; y += 1400, ++k) {
      await page.screenshot({ path: file.replace(/\.html$/, `-${k}.png`), captureBeyondViewport: true,
        clip: { x: 0, y, width: 1280, height: Math.min(1400, height - y) } });
    }
    for (const paper of Object.keys(papers)) {
      writeFileSync(file.replace(/\.html$/, `-${paper}.pdf`), (await checkPrint(browser, file, paper)).pdf);
    }
  }
  await page.close();
  return { text, sections, links, figure: (name) => figures.find((f) => f.name.startsWith(name)), figures };
}

/** A spring beside a Maxwell arm, stepped exactly, with white noise: 1.8 N/mm, 1.2 N/mm and 4 s, 0.02 N and 0.4 um. */
function writeStandardLinearSolid(to) {
  let state = 12345;
  const uniform = () => ((state = (Math.imul(state, 1664525) + 1013904223) >>> 0) + 0.5) / 4294967296;
  const gauss = () => Math.sqrt(-2 * Math.log(uniform())) * Math.cos(2 * Math.PI * uniform());
  const legs = [[0, 15], [3, 1], [-3, 1], [0, 1], [0, 15]];  // [to mm, mm/s], or [same, s] for a hold
  for (const speed of [0.5, 2, 5, 10]) for (const side of [2, -2]) legs.push([side, speed], [side, 15], [0, 0.5], [0, 15]);
  const rows = ["t_s,position_mm,force_N"], dt = 0.005, k1 = 1.8, k2 = 1.2, tau = 4;
  let x = 0, arm = 0, t = 0;
  const decay = Math.exp(-dt / tau);
  for (const [target, value] of legs) {
    const hold = Math.abs(target - x) < 1e-9;
    const steps = Math.round((hold ? value : Math.abs(target - x) / value) / dt);
    const v = hold ? 0 : (target - x) / (steps * dt);
    for (let i = 0; i < steps; ++i) {
      arm = arm * decay + k2 * v * tau * (1 - decay);
      x += v * dt;
      t += dt;
      rows.push(`${t.toFixed(4)},${(x + 4e-4 * gauss()).toFixed(6)},${(k1 * x + arm + 0.02 * gauss()).toFixed(5)}`);
    }
    if (!hold) x = target;
  }
  mkdirSync(to);
  writeFileSync(join(to, "frame.csv"), rows.join("\n") + "\n");
  writeFileSync(join(to, "recording.toml"), 'format = "isorig-recording/1"\nspecimen = "solid"\nrest_length_mm = 94.3\nunits = "s, mm, N, psi"\n');
}

function expectSections(page, wanted) {
  assert.deepEqual(wanted.filter((w) => !page.sections.includes(w)), [], `sections are ${page.sections.join(", ")}`);
  assert.match(page.text, /How this page was made/);
  assert.match(page.text, /isorig \d+\.\d+/, "the version");
}

try {
  const run = JSON.parse(call("run", join(source, "config/protocols/vma-short.toml"), "--rig", rig, "--runs",
    join(folder, "runs"), "--json", "--quiet"));
  assert.equal(run.report, join(run.directory, "report.html"));
  assert.deepEqual(readdirSync(run.directory).filter((f) => f.startsWith(".report")), [], "what it exported is gone");
  call("export", run.directory, "--out", join(folder, "recordings"));
  const recordings = readdirSync(join(folder, "recordings")).map((r) => join(folder, "recordings", r));
  // All of them into one folder: none may write over another's files.
  const out = join(folder, "out");
  call("fv", ...recordings, "--out", out);
  const mine = readdirSync(out);
  call("diagnose", recordings[0], "--model", "slse1", "--out", out);
  call("campaign", ...recordings, "--out", out, "--simulated", "Rig and specimen are simulated.");
  for (const name of mine) assert.ok(existsSync(join(out, name)), name);
  assert.ok(!existsSync(join(out, "report.html")));
  const before = readFileSync(join(out, "fv-report.html"));
  assert.throws(() => execFileSync(isorig, ["report", run.directory, "--out", join(out, "fv-report.html")], { stdio: "ignore" }),
    (e) => e.status > 0, "a run's page under another command's name");
  assert.ok(before.equals(readFileSync(join(out, "fv-report.html"))));
  // Made again after a diagnosis lies in the run's folder, its page knows of it.
  call("diagnose", recordings[0], "--model", "slse1", "--out", join(run.directory, "diagnosis"));
  call("report", run.directory, "--out", join(run.directory, "remade.html"));
  assert.match(readFileSync(join(run.directory, "remade.html"), "utf8"), /"href":"diagnosis\/diagnosis-report\.html"/);
  assert.match(readFileSync(join(run.directory, "diagnosis/diagnosis-report.html"), "utf8"), /"href":"\.\.\/report\.html"/);

  // A specimen that is what the model says, by a simulation of its own: the page that reassures.
  writeStandardLinearSolid(join(folder, "solid"));
  call("diagnose", join(folder, "solid"), "--model", "slse1", "--out", join(folder, "again"));

  await withBrowser(async (browser) => {
    const ofRun = await look(browser, run.report);
    expectSections(ofRun, ["Force-velocity curves", "Course of the run", "Ramps", "How well it was measured", "Calibration",
      "Inputs and versions", "What this page does not show"]);
    assert.match(ofRun.text, /nothing was lost/);
    assert.ok(ofRun.text.includes("vma-short.toml"), "the command");
    assert.match(ofRun.text, /simulated, in virtual time/);
    assert.equal(ofRun.figure("history").panels, 3);
    assert.ok(ofRun.figure("history").bands >= 3, "force, position and pressure are bands");
    assert.equal(ofRun.figure("history").points, 0);
    assert.ok(ofRun.figure("force_velocity_curves").points > 4);
    assert.ok(ofRun.figure("force_velocity_curves").lines > 0, "with fits");
    assert.ok(ofRun.figure("ramps_overlaid").lines > 4);
    for (const href of ofRun.links) assert.ok(existsSync(join(run.directory, href)), href);

    const ofFv = await look(browser, join(out, "fv-report.html"));
    assert.equal(ofFv.figures[0].name, "force_velocity_curves", "all pressures together come first");
    assert.match(ofFv.text, /R² 0?\.?\d|R² > /);
    assert.ok(ofFv.text.includes(recordings[0]), "its inputs");
    for (const href of ofFv.links) assert.ok(existsSync(join(out, href)), href);

    const of = await look(browser, join(out, "diagnosis-report.html"));
    assert.equal(of.figures[0].name, "parting", "first where they part");
    expectSections(of, ["What was left out of the fit, predicted", "Rivals", "What these recordings cannot tell", "Data"]);
    // Of signals none is drawn as dots; a number with its interval is one.
    assert.equal(of.figures.filter((f) => f.name !== "moved").reduce((n, f) => n + f.points, 0), 0, "no rows of dots");
    assert.ok(of.figure("moved").points >= 2);
    assert.ok(of.figure("residual-0").bands >= 2, "the noise is a band");
    assert.match(of.text, /noise, ± 2 σ/);
    for (const name of ["left-out-worst", "left-out-median"]) {
      const motion = of.figures.find((f) => f.name === name);
      assert.equal(motion?.panels, 2, name);
      assert.ok(motion.bands >= 2 && motion.lines >= 4 && motion.points === 0, `${name}: the band, and measured over predicted`);
    }
    assert.match(of.text, /The worst of \d+ (moves|strokes|stretches of time), [\d.]+ to [\d.]+ s/);
    assert.match(of.text, /nominal model errs by [\d.]+ N rms/);
    assert.ok(of.figure("rivals_left").bars > 1);
    // In one folder: each page that was there before it is a neighbour.
    assert.ok(of.links.includes("fv-report.html"), of.links.join(" "));
    assert.doesNotMatch(of.text.slice(0, of.text.indexOf("How this page was made")), /coulomb_friction (and|,|\()/);
    for (const href of of.links) assert.ok(existsSync(join(out, href)), href);

    const again = await look(browser, join(folder, "again/diagnosis-report.html"));
    expectSections(again, ["What was looked for, and not found", "What is left", "What these recordings cannot tell"]);
    assert.match(again.text, /NOTHING IS MISSING|nothing is missing/);
    assert.ok(!again.sections.includes("What was left out"));

    const campaign = await look(browser, join(out, "campaign-report.html"));
    for (const href of ["fv-report.html", "diagnosis-report.html"]) assert.ok(campaign.links.includes(href), href);
    assert.match(campaign.text, /Rig and specimen are simulated/);
    assert.ok(campaign.figure("parameter_sweeps").panels > 3);
  });
} finally {
  if (!keep) rmSync(folder, { recursive: true, force: true });
}
