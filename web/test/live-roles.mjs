// isorig-web before a daemon with roles: a session may see no more than its user may at the daemon's socket, although isorig-web
// itself may see all. Real processes; as root alone, which can be somebody else.
// Usage: node web/test/live-roles.mjs BIN_FOLDER SOURCE_FOLDER
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { chmodSync } from "node:fs";
import { join } from "node:path";
import { enter, Rig, until } from "./rig.mjs";

if (process.getuid() !== 0) {
  console.log("skipped: it takes root to ask for a link as another user");
  process.exit(0);
}

const [bin, source] = process.argv.slice(2);
const rig = new Rig(bin, source, { api: 'see = "games"' });  // a group that every Debian has
const [NOBODY, GAMES] = [65534, 60];

/** The cookie of a session of the user nobody, in the group of the socket and in these. */
async function session(...groups) {
  const words = ["--reuid", NOBODY, "--regid", 0, ...(groups.length ? ["--groups", groups.join(",")] : ["--clear-groups"])].map(String);
  const link = execFileSync("setpriv", [...words, join(rig.bin, "isorig"), "web", "--socket", rig.socket], { encoding: "utf8" }).trim();
  const answer = await enter(link);
  assert.equal(answer.status, 303);
  return answer.headers.get("set-cookie").split(";")[0];
}

try {
  chmodSync(rig.dir, 0o755);
  await rig.startWeb();
  rig.startDaemon();
  await rig.reach("ready");
  const member = await session(GAMES), stranger = await session();
  const look = (cookie, path) => fetch(rig.base + path, { headers: { Cookie: cookie } });
  const check = (cookie) => fetch(`${rig.base}/api/check`, { method: "POST", body: JSON.stringify({ protocol: "" }),
    headers: { Cookie: cookie, Origin: rig.base, "Content-Type": "application/json" } });

  for (const path of ["/api/runs", "/api/calibrations", "/api/diagnoses", "/api/selftest"]) {
    assert.equal((await look(member, path)).status, 200, path);
    // The answer is there, and fresh: it is not for everybody.
    const refused = await look(stranger, path);
    assert.equal(refused.status, 403, path);
    assert.match((await refused.json()).text, /uid 65534 may not see this rig; who may: members of the group games/);
  }
  for (const path of ["/report/20261127-none", "/page/none/report.html", "/api/experiment?id=0123456789abcdef"]) {
    assert.equal((await look(stranger, path)).status, 403, path);
    assert.notEqual((await look(member, path)).status, 403, path);
  }
  assert.equal((await check(stranger)).status, 403);
  assert.equal((await check(member)).status, 400);
  // To stop is never refused for a right.
  const stop = await fetch(`${rig.base}/api/abort`, { method: "POST", body: "{}", headers: { Cookie: stranger, Origin: rig.base, "Content-Type": "application/json" } });
  assert.notEqual(stop.status, 403);
  await until("its line", () => /abort by nobody \(uid 65534\)/.test(rig.web.logged()), 5);
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  rig.end();
}
