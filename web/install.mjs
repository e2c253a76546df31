// Fetches what web/package-lock.json names into web/node_modules, once: silent and quick when it is there already.
// Usage: node web/install.mjs [--dev]    --dev: with what the tests need
// By npm where there is one. Debian's npm brings 450 packages, and what the pages are bundled from are 15 archives: without npm they
// are fetched here, each checked against the lock file's SHA-512.
import { spawnSync } from "node:child_process";
import { createHash } from "node:crypto";
import { existsSync, mkdirSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
import { homedir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const dev = process.argv.includes("--dev");
const stamp = join(here, "node_modules", ".isorig-installed");
const lock = join(here, ".installing");
const wanted = createHash("sha256").update(readFileSync(join(here, "package-lock.json"))).digest("hex");

function have() {
  if (!existsSync(stamp)) return false;
  const [hash, kind] = readFileSync(stamp, "utf8").trim().split(" ");
  return hash === wanted && (kind === "dev" || !dev);
}

/** Several build folders share node_modules: one at a time. A lock older than ten minutes is of somebody who was ended. */
function take() {
  for (let waited = 0; waited < 600; ++waited) {
    try {
      mkdirSync(lock);
      return;
    } catch (error) {
      if (error.code !== "EEXIST") throw error;
      if (Date.now() - statSync(lock, { throwIfNoEntry: false })?.mtimeMs > 600_000) rmSync(lock, { recursive: true, force: true });
      else Atomics.wait(new Int32Array(new SharedArrayBuffer(4)), 0, 0, 1000);
    }
  }
  throw new Error(`${lock} is still there after ten minutes; remove it if nothing installs`);
}

/** Where npm would ask: its variable, the user's .npmrc, or the public one. */
function registry() {
  const npmrc = join(homedir(), ".npmrc");
  const stated = existsSync(npmrc) && /^registry\s*=\s*(\S+)/m.exec(readFileSync(npmrc, "utf8"))?.[1];
  return (process.env.npm_config_registry || stated || "https://registry.npmjs.org").replace(/\/+$/, "");
}

const fits = (wanted, own) => !wanted || (wanted.includes(own) && !wanted.includes(`!${own}`));

async function fetchOne(path, one) {
  const name = path.slice(path.lastIndexOf("node_modules/") + "node_modules/".length);
  const url = `${registry()}/${name}/-/${name.slice(name.lastIndexOf("/") + 1)}-${one.version}.tgz`;
  let answer;
  try {
    answer = await fetch(url);
  } catch (error) {
    throw new Error(`${url}: ${error.cause?.message ?? error.message}; name another registry by registry = URL in ~/.npmrc`);
  }
  if (!answer.ok) throw new Error(`${url}: ${answer.status} ${answer.statusText}`);
  const archive = Buffer.from(await answer.arrayBuffer());
  const sum = `sha512-${createHash("sha512").update(archive).digest("base64")}`;
  if (!one.integrity.split(" ").includes(sum)) throw new Error(`${url}: not what web/package-lock.json names (${sum})`);
  const folder = join(here, path);
  mkdirSync(folder, { recursive: true });
  const tar = spawnSync("tar", ["-xzf", "-", "--strip-components=1", "--no-same-owner", "-C", folder], { input: archive, encoding: "utf8" });
  if (tar.status !== 0) throw new Error(`${url}: ${tar.stderr || tar.error?.message}`);
}

/** "" when all are there, else why not. */
async function fetchByLock() {
  const { packages } = JSON.parse(readFileSync(join(here, "package-lock.json"), "utf8"));
  const chosen = Object.entries(packages).filter(([path, one]) =>
    path && (dev || !one.dev) && fits(one.os, process.platform) && fits(one.cpu, process.arch));
  rmSync(join(here, "node_modules"), { recursive: true, force: true });
  const left = chosen.values();
  const atOnce = 8;
  try {
    await Promise.all(Array.from({ length: atOnce }, async () => {
      for (const [path, one] of left) await fetchOne(path, one);
    }));
    return "";
  } catch (error) {
    return `web: ${error.message}`;
  }
}

/** As fetchByLock, by npm; null where there is none. */
function installByNpm() {
  const npm = spawnSync("npm", ["ci", "--ignore-scripts", "--no-audit", "--no-fund", ...(dev ? [] : ["--omit=dev"])],
    { cwd: here, encoding: "utf8" });
  if (npm.error?.code === "ENOENT") return null;
  return npm.status === 0 ? "" : `${npm.stdout ?? ""}${npm.stderr ?? npm.error?.message ?? ""}\nweb: npm ci failed; it needs the npm registry once, or a mirror of it (npm config set registry URL)`;
}

if (!have()) {
  take();
  try {
    if (!have()) {
      const wrong = installByNpm() ?? (await fetchByLock());
      if (wrong) {
        console.error(wrong);
        process.exitCode = 1;
      } else {
        writeFileSync(stamp, `${wanted} ${dev ? "dev" : "run"}\n`);
      }
    }
  } finally {
    rmSync(lock, { recursive: true, force: true });
  }
}
