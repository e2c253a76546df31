// web/install.mjs where there is no npm: from a registry of its own on loopback, by its lock file, and nothing else.
import assert from "node:assert/strict";
import { execFile, execFileSync } from "node:child_process";
import { createHash } from "node:crypto";
import { copyFileSync, existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, symlinkSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const work = mkdtempSync(join(tmpdir(), "isorig-install-"));
const archives = new Map();

/** An archive as a registry has it, below the path that it has there, and its entry in a lock file. */
function publish(name, version, text, more = {}) {
  const folder = join(work, "made", name);
  mkdirSync(join(folder, "package"), { recursive: true });
  writeFileSync(join(folder, "package", "index.js"), text);
  const archive = execFileSync("tar", ["-czf", "-", "-C", folder, "package"]);
  archives.set(`/${name}/-/${name.split("/").at(-1)}-${version}.tgz`, archive);
  return { version, integrity: `sha512-${createHash("sha512").update(archive).digest("base64")}`, ...more };
}

// Only what the script calls: no npm is found.
const programs = join(work, "bin");
mkdirSync(programs);
symlinkSync(process.execPath, join(programs, "node"));
for (const name of ["tar", "gzip"]) symlinkSync(execFileSync("which", [name], { encoding: "utf8" }).trim(), join(programs, name));

const here = join(work, "web");
mkdirSync(here);
copyFileSync(join(dirname(fileURLToPath(import.meta.url)), "..", "install.mjs"), join(here, "install.mjs"));
const lock = (packages) => writeFileSync(join(here, "package-lock.json"), JSON.stringify({ packages: { "": {}, ...packages } }));
const asked = [];
const server = createServer((request, answer) => {
  asked.push(request.url);
  const archive = archives.get(request.url);
  answer.writeHead(archive ? 200 : 404);
  answer.end(archive);
});
await new Promise((ready) => server.listen(0, "127.0.0.1", ready));
const registry = `http://127.0.0.1:${server.address().port}/`;
const install = (args = [], from = registry) => new Promise((done) =>
  execFile(join(programs, "node"), [join(here, "install.mjs"), ...args],
    { env: { PATH: programs, HOME: work, npm_config_registry: from } }, (error, stdout, stderr) => done({ code: error?.code ?? 0, stderr })));
const text = (path) => readFileSync(join(here, "node_modules", path, "index.js"), "utf8");

try {
  const plain = publish("plain", "1.2.0", "plain");
  const packages = {
    "node_modules/plain": plain,
    "node_modules/@scope/deep": publish("@scope/deep", "3.0.1", "deep"),
    "node_modules/plain/node_modules/inner": publish("inner", "0.1.0", "inner"),
    "node_modules/other-machine": publish("other-machine", "1.0.0", "other", { optional: true, os: ["aix"], cpu: ["ppc64"] }),
    "node_modules/for-tests": publish("for-tests", "1.0.0", "tests", { dev: true }),
  };
  lock(packages);
  assert.deepEqual(await install(), { code: 0, stderr: "" });
  assert.equal(text("plain"), "plain");
  assert.equal(text("@scope/deep"), "deep");
  assert.equal(text("plain/node_modules/inner"), "inner");
  assert.ok(!existsSync(join(here, "node_modules", "other-machine")), "of another machine");
  assert.ok(!existsSync(join(here, "node_modules", "for-tests")), "only for tests");

  const before = asked.length;
  assert.equal((await install()).code, 0);
  assert.equal(asked.length, before, "what is there is not fetched again");
  assert.equal((await install(["--dev"])).code, 0);
  assert.equal(text("for-tests"), "tests");

  lock({ "node_modules/plain": { ...plain, integrity: `sha512-${"A".repeat(86)}==` } });
  const forged = await install();
  assert.equal(forged.code, 1);
  assert.match(forged.stderr, /plain-1\.2\.0\.tgz: not what web\/package-lock\.json names/);
  assert.ok(!existsSync(join(here, "node_modules", "plain")), "nothing of it was unpacked");

  lock({ "node_modules/gone": { ...plain, version: "9.9.9" } });
  const gone = await install();
  assert.equal(gone.code, 1);
  assert.match(gone.stderr, /gone-9\.9\.9\.tgz: 404/);

  const nobody = await install([], "http://127.0.0.1:1/");
  assert.equal(nobody.code, 1);
  assert.match(nobody.stderr, /registry = URL in ~\/\.npmrc/);
} finally {
  server.close();
  rmSync(work, { recursive: true, force: true });
}
