// Fetches what web/package-lock.json names into web/node_modules, once: silent and quick when it is there already.
// Usage: node web/install.mjs [--dev]    --dev: with what the tests need
import { spawnSync } from "node:child_process";
import { createHash } from "node:crypto";
import { existsSync, mkdirSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
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

if (!have()) {
  take();
  try {
    if (!have()) {
      const npm = spawnSync("npm", ["ci", "--ignore-scripts", "--no-audit", "--no-fund", ...(dev ? [] : ["--omit=dev"])],
        { cwd: here, encoding: "utf8" });
      if (npm.status !== 0) {
        console.error(npm.stdout ?? "", npm.stderr ?? npm.error?.message ?? "");
        console.error("web: npm ci failed; it needs the npm registry once, or a mirror of it (npm config set registry URL)");
        process.exitCode = 1;
      } else {
        writeFileSync(stamp, `${wanted} ${dev ? "dev" : "run"}\n`);
      }
    }
  } finally {
    rmSync(lock, { recursive: true, force: true });
  }
}
