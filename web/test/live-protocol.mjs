// isorig-web byte by byte, on real sockets with a real daemon on the simulated rig: who is let in, what a page gets, what
// happens to one that takes nothing, and to one that takes it slowly. Three minutes.
// Usage: node web/test/live-protocol.mjs BIN_FOLDER SOURCE_FOLDER
import assert from "node:assert/strict";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { request } from "node:http";
import { connect } from "node:net";
import { join } from "node:path";
import { Rig, until } from "./rig.mjs";

const [bin, source] = process.argv.slice(2);
const rig = new Rig(bin, source);

/** Status, headers and body of one request. */
function ask(method, path, { headers = {}, body = "" } = {}) {
  return new Promise((done, failed) => {
    const q = request({ host: "127.0.0.1", port: rig.port, method, path, agent: false,
      headers: { Host: `localhost:${rig.port}`, ...(body ? { "Content-Length": Buffer.byteLength(body) } : {}), ...headers } }, (answer) => {
      const parts = [];
      answer.on("data", (d) => parts.push(d));
      answer.on("end", () => done({ status: answer.statusCode, headers: answer.headers, body: Buffer.concat(parts) }));
    });
    q.on("error", failed);
    q.end(body);
  });
}

/** A link of so many bytes a second: what comes is left in the kernel until its time has come. */
function slowDown(socket, bytes_per_s) {
  socket.on("data", (d) => {
    socket.pause();
    setTimeout(() => socket.resume(), (1000 * d.length) / bytes_per_s);
  });
}

/** Bytes of an answer that is read slowly, and how long it took. */
function askSlowly(path, cookie, bytes_per_s) {
  return new Promise((done, failed) => {
    const began = Date.now(), socket = connect(rig.port, "127.0.0.1");
    let bytes = 0;
    slowDown(socket, bytes_per_s);
    socket.on("data", (d) => (bytes += d.length));
    socket.on("error", failed);
    socket.on("close", () => done({ bytes, took_s: (Date.now() - began) / 1000 }));
    socket.write(`GET ${path} HTTP/1.1\r\nHost: localhost:${rig.port}\r\nConnection: close\r\nCookie: ${cookie}\r\n\r\n`);
  });
}

/** A page's WebSocket; reads unless `stalled`. Frames of a server are not masked (RFC 6455, 5.1). */
class Page {
  constructor({ cookie = "", origin = rig.base, host = `localhost:${rig.port}`, stalled = false, bytes_per_s = 0 } = {}) {
    this.texts = [];
    this.blocks = [];
    this.bytes = Buffer.alloc(0);
    this.socket = connect(rig.port, "127.0.0.1");
    this.socket.on("error", () => {});
    this.closed = new Promise((done) => this.socket.on("close", () => done(true)));
    this.answered = new Promise((done) => (this.answer = done));
    this.socket.write(`GET /live HTTP/1.1\r\nHost: ${host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n` +
      `Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nOrigin: ${origin}\r\n${cookie ? `Cookie: ${cookie}\r\n` : ""}\r\n`);
    if (stalled) this.socket.pause();
    else this.socket.on("data", (d) => this.take(d));
    if (bytes_per_s > 0) slowDown(this.socket, bytes_per_s);
  }

  take(data) {
    this.bytes = Buffer.concat([this.bytes, data]);
    if (this.status === undefined) {
      const end = this.bytes.indexOf("\r\n\r\n");
      if (end < 0) return;
      this.status = Number(this.bytes.subarray(9, 12).toString());
      this.bytes = this.bytes.subarray(end + 4);
      this.answer(this.status);
    }
    if (this.status !== 101) return;
    for (;;) {
      if (this.bytes.length < 2) return;
      let length = this.bytes[1] & 127, at = 2;
      if (length === 126) [length, at] = [this.bytes.length < 4 ? Infinity : this.bytes.readUInt16BE(2), 4];
      else if (length === 127) [length, at] = [this.bytes.length < 10 ? Infinity : Number(this.bytes.readBigUInt64BE(2)), 10];
      if (this.bytes.length < at + length) return;
      const body = this.bytes.subarray(at, at + length), code = this.bytes[0] & 15, last = this.bytes[0] >= 128;
      this.bytes = this.bytes.subarray(at + length);
      if (code <= 2) {  // a long message comes in pieces
        if (code !== 0) this.pieces = { code, all: [] };
        this.pieces.all.push(Buffer.from(body));
        if (!last) continue;
        const whole = Buffer.concat(this.pieces.all);
        if (this.pieces.code === 1) this.texts.push(JSON.parse(whole.toString()));
        else this.blocks.push(whole);
      }
      else if (code === 9) this.socket.write(Buffer.concat([Buffer.from([0x8a, 0x80 | length, 0, 0, 0, 0]), body]));
    }
  }

  last(kind) {
    return this.texts.filter((t) => t.kind === kind).at(-1);
  }
  /** Numbers of the fine stretches of a stream, as they came. */
  stretches(stream) {
    return this.blocks.filter((b) => b[0] === stream && b[1] === 0).flatMap((b) =>
      Array.from({ length: b.readUInt32LE(4) }, (_, i) => b.readDoubleLE(8) + b.readUInt32LE(24 + 4 * i)));
  }
  end() {
    this.socket.destroy();
  }
}

const own = () => ({ Origin: rig.base, "Content-Type": "application/json" });
const post = (call, body, headers = own()) => ask("POST", `/api/${call}`, { headers, body: JSON.stringify(body) });
const said = (answer) => JSON.parse(answer.body.toString()).text;

/** As the form of the page that the link leads to. */
const enter = (link, headers = {}) => ask("POST", link.pathname, { body: link.search.slice(1),
  headers: { Origin: rig.base, "Content-Type": "application/x-www-form-urlencoded", ...headers } });
async function session(name) {
  const answer = await enter(new URL(rig.call("web", "--name", name)));
  assert.equal(answer.status, 303);
  return answer.headers["set-cookie"][0];
}

try {
  // Without a daemon the page is there, and says so.
  await rig.startWeb();
  const early = new Page();
  await until("why there is nothing", () => /isorigd does not run/.test(early.last("status")?.why ?? ""), 10);
  assert.equal(early.last("status").none, "gone");
  rig.startDaemon();
  await until("the daemon", () => early.last("status")?.status?.state === "ready", 60);
  await until("its samples", () => early.last("hello").rig === "sim", 10);
  early.end();

  // The page and what it is wrapped in.
  const page = await ask("GET", "/");
  assert.equal(page.status, 200);
  assert.match(page.headers["content-security-policy"], /default-src 'none'.*frame-ancestors 'none'/);
  assert.equal(page.headers["x-content-type-options"], "nosniff");
  assert.equal((await ask("HEAD", "/")).status, 200);
  assert.equal((await ask("GET", "/../etc/passwd")).status, 404);
  assert.equal((await ask("PUT", "/")).status, 405);
  // What makes the daemon work, and what is on disk, needs a session.
  for (const path of ["/api/runs", "/api/calibrations", "/api/selftest", "/report/20261123-none"]) {
    const refused = await ask("GET", path);
    assert.equal(refused.status, 403, path);
    assert.match(said(refused), /open the link of `isorig web` to see the runs/);
  }
  assert.equal((await ask("GET", "/", { headers: { Host: "evil.example" } })).status, 421, "a name that DNS may lead here");
  assert.equal((await ask("GET", "/", { headers: { Host: "localhost:9999" } })).status, 200, "the near end of ssh -L");
  assert.equal((await ask("GET", "/", { headers: { "X-Long": "x".repeat(9000) } })).status, 431);
  // An answer before the request is at its end is read all the same, whatever the kernel's buffers hold.
  for (const MiB of [1, 12]) {
    const long = await post("start", { protocol: "x".repeat(MiB << 20) });
    assert.equal(long.status, 413, `${MiB} MiB`);
    assert.match(said(long), /longer than 1 MiB/);
  }

  // Nobody without a session does anything; a page of somebody else does not even with one.
  for (const call of ["pause", "abort", "start", "resume", "lease", "note", "leave", "preview", "twin"]) assert.equal((await post(call, {})).status, 403, call);
  assert.equal((await ask("GET", "/api/library")).status, 403);
  for (const origin of ["http://evil.example", "null", `http://localhost:${rig.port + 1}`]) {
    const other = new Page({ origin });
    assert.equal(await other.answered, 403, origin);
  }
  assert.equal(await new Page({ host: "evil.example", origin: "http://evil.example" }).answered, 421);

  // A link: once, and its cookie is not for scripts nor for other sites.
  // A second link in the same browser ends the session before it, whose page comes back as one of the new session.
  const before = (await session("Ann before")).split(";")[0];
  const paged_before = new Page({ cookie: before });
  await until("its page", () => paged_before.last("hello")?.name === "Ann before", 10);
  assert.equal((await post("lease", { action: "take" }, { ...own(), Cookie: before })).status, 200);
  const second = new URL(rig.call("web", "--name", "Ann after"));
  const after = (await enter(second, { Cookie: before })).headers["set-cookie"][0].split(";")[0];
  assert.ok(await paged_before.closed);
  assert.equal((await post("pause", {}, { ...own(), Cookie: before })).status, 403);
  await until("control that was given back", async () => (await post("lease", { action: "take" }, { ...own(), Cookie: after })).status === 200, 5);
  const left = await post("leave", {}, { ...own(), Cookie: after });
  assert.match(left.headers["set-cookie"][0], /Max-Age=0/);
  assert.equal((await post("pause", {}, { ...own(), Cookie: after })).status, 403);

  const link = new URL(rig.call("web", "--name", "Ann"));
  // Looking at a link does not use it up, nor does a page of another site, or of another port of this host, led to or by a form of its own.
  for (const method of ["HEAD", "GET", "GET"]) {
    const offered = await ask(method, link.pathname + link.search, { headers: { "Sec-Fetch-Site": "none" } });
    assert.equal(offered.status, 200);
    assert.equal(offered.headers["set-cookie"], undefined);
    assert.match(offered.headers["content-security-policy"], /script-src 'self';.*form-action 'self'/);
    assert.equal(offered.headers["referrer-policy"], "strict-origin");
  }
  assert.match((await ask("GET", "/")).headers["content-security-policy"], /form-action 'none'/);
  assert.equal((await ask("GET", "/enter?token=%22%3E%3Cscript%3E")).status, 400);
  for (const origin of ["http://evil.example", "null", `http://localhost:${rig.port + 1}`]) {
    const forged = await enter(link, { Origin: origin });
    assert.equal(forged.status, 403);
    assert.equal(forged.headers["set-cookie"], undefined);
  }
  for (const site of ["cross-site", "same-site"]) {
    const led = await ask("GET", link.pathname + link.search, { headers: { "Sec-Fetch-Site": site } });
    assert.equal(led.status, 403);
    assert.match(led.body.toString(), /into the address bar/);
    assert.equal(led.headers["set-cookie"], undefined);
  }
  const entered = await enter(link);
  assert.equal(entered.status, 303);
  assert.match(entered.headers["set-cookie"][0], /^isorig-\d+=[0-9a-f]{64}; Path=\/; HttpOnly; SameSite=Strict$/);
  assert.equal((await enter(link)).status, 403);
  assert.equal((await enter(new URL("/enter?token=" + "0".repeat(64), link))).status, 403);
  const ann = entered.headers["set-cookie"][0].split(";")[0];
  assert.match(rig.call("web", "--name", "x", "--port", "9000"), /^http:\/\/localhost:9000\/enter/);
  const mine = () => ({ ...own(), Cookie: ann });
  const look = (path) => ask("GET", path, { headers: { Cookie: ann } });

  // Connections that ask nothing, of anybody on this machine, keep no pause waiting: there is room for 128.
  const idle = Array.from({ length: 300 }, () => connect(rig.port, "127.0.0.1"));
  let heard = "", connected = 0;
  for (const socket of idle) socket.on("connect", () => ++connected).on("data", (d) => (heard += d)).on("error", () => {});
  await until("all of them", () => connected === idle.length, 20);
  for (const call of ["pause", "abort"]) assert.notEqual((await post(call, {}, mine())).status, 403, call);
  await until("those who waited longest, sent away", () => idle.filter((s) => s.readableEnded || s.destroyed).length > 170, 20);
  assert.match(heard, /503 Service Unavailable[^]*there are too many connections/);
  for (const socket of idle) socket.destroy();
  await rig.reach("ready");

  // Many who ask at once are one question for the daemon, and all get its answer.
  for (const answer of await Promise.all(Array.from({ length: 60 }, () => look("/api/runs")))) {
    assert.equal(answer.status, 200);
    assert.deepEqual(JSON.parse(answer.body.toString()), { all: 0, runs: [] });
  }
  assert.ok("force" in JSON.parse((await look("/api/calibrations")).body.toString()).in_force);
  assert.equal((await look("/report/..%2f..%2fetc%2fpasswd")).status, 400);
  const none = await look("/report/20261123-none");
  assert.equal(none.status, 404);
  assert.match(said(none), /there is no run "20261123-none"/);
  // One page in memory at a time.
  const crowd = (await Promise.all(Array.from({ length: 20 }, () => look("/report/20261123-none"))));
  assert.ok(crowd.some((a) => a.status === 404) && crowd.some((a) => a.status === 503), crowd.map((a) => a.status).join(" "));
  // One experiment looked for at a time.
  const looked = await Promise.all(Array.from({ length: 20 }, () => look("/api/experiment?id=0123456789abcdef")));
  assert.ok(looked.some((a) => a.status === 404) && looked.some((a) => a.status === 503), looked.map((a) => a.status).join(" "));
  for (const a of [...crowd, ...looked]) assert.equal(a.headers["retry-after"], a.status === 503 ? "1" : undefined);
  assert.equal((await look("/report/20261123-none")).status, 404);
  assert.equal((await post("pause", {}, { ...mine(), Origin: "http://evil.example" })).status, 403);
  assert.equal((await post("pause", {}, { Cookie: ann, "Content-Type": "application/json" })).status, 403, "without an origin");
  assert.equal((await post("pause", {}, { ...mine(), "Content-Type": "text/plain" })).status, 415);
  assert.equal((await ask("POST", "/api/lease", { headers: mine(), body: "[1]" })).status, 400);
  assert.equal((await post("nonsense", {}, mine())).status, 404);

  // Control: one at a time, by name.
  assert.equal((await post("start", { operator: "Ann", protocol_file: "vma-smoke.toml", specimen_file: "" }, mine())).status, 409);
  assert.equal((await post("twin", { model_file: "none.toml" }, mine())).status, 409, "a twin without control");
  assert.equal((await post("lease", { action: "take" }, mine())).status, 200);
  const bob = (await session("Bob")).split(";")[0];
  const his = () => ({ ...own(), Cookie: bob });
  const refused = await post("lease", { action: "take" }, his());
  assert.equal(refused.status, 409);
  assert.match(said(refused), /Ann has control/);

  // A start needs an operator, a specimen and a protocol of the library.
  for (const [body, why] of [
    [{ protocol_file: "vma-smoke.toml", specimen_file: "" }, /operator/],
    [{ operator: "Ann", protocol_file: "vma-smoke.toml" }, /specimen/],
    [{ operator: "Ann", protocol_file: "vma-smoke.toml", specimen_file: 5 }, /specimen/],
    [{ operator: "Ann", protocol_file: "../rigs/sim.toml", specimen_file: "" }, /no protocol/],
    [{ operator: "Ann", protocol_file: "vma-smoke.toml", specimen_file: "../protocols/vma-smoke.toml" }, /no specimen/],
    [{ operator: "Ann", protocol: "nonsense", specimen_file: "" }, /protocol.toml:1/],
  ]) {
    const answer = await post("start", body, mine());
    assert.equal(answer.status, 400, JSON.stringify(body));
    assert.match(said(answer), why);
  }
  // A twin needs a model of the library, or one that can be read.
  for (const [body, why] of [
    [{ model_file: "none.toml" }, /no model none.toml in the library/],
    [{ model_file: "../rig.toml" }, /no model/],
    [{ model: "nonsense", model_name: "mine.toml" }, /mine.toml:1/],
    [{ model_file: "none.toml", on_parting: "explode" }, /mark, pause or abort/],
  ]) {
    const answer = await post("twin", body, mine());
    assert.equal(answer.status, 400, JSON.stringify(body));
    assert.match(said(answer), why);
  }
  const spring = 'format = "isorig-model/1"\nname = "s"\n[[part]]\nphysics = "spring"\nstiffness_N_mm = 1.0\n';
  const chosen = await post("twin", { model: spring, model_name: "mine.toml" }, mine());
  assert.equal(chosen.status, 200);
  assert.match(said(chosen), /mine.toml is stepped beside the rig; it does not say what it has seen/);
  assert.match(said(await post("twin", {}, mine())), /no model is stepped/);

  const preview = await post("preview", { operator: "Bob", protocol_file: "vma-smoke.toml", specimen_file: "control1.toml" }, his());
  assert.equal(preview.status, 200);
  assert.equal(JSON.parse(preview.body.toString()).specimen, "Control1");

  // A saved protocol that somebody replaces between the check and the start does not start; nor does one that takes
  // another specimen file.
  const smoke = readFileSync(join(source, "config/protocols/vma-smoke.toml"), "utf8");
  mkdirSync(rig.saved, { recursive: true });
  writeFileSync(join(rig.saved, "swap.toml"), smoke);
  const swap = { operator: "Ann", protocol_from: "saved", protocol_file: "swap.toml", specimen_file: "control1.toml" };
  const checked = JSON.parse((await post("preview", swap, mine())).body.toString());
  for (const key of ["protocol_version", "specimen_version"]) assert.match(checked[key], /^[0-9a-f]{16}$/, key);
  writeFileSync(join(rig.saved, "swap.toml"), smoke + "# another\n");
  const { protocol_version, specimen_version } = checked;
  const swapped = await post("start", { ...swap, protocol_version, specimen_version }, mine());
  assert.equal(swapped.status, 409);
  assert.match(said(swapped), /^swap\.toml was changed since it was checked: check it again$/);
  writeFileSync(join(rig.saved, "swap.toml"), smoke);
  const mounted = await post("start", { ...swap, protocol_version, specimen_version: "0".repeat(16) }, mine());
  assert.equal(mounted.status, 409);
  assert.match(said(mounted), /^control1\.toml was changed since it was checked/);
  // The very text that was checked is taken, where nothing else stands against it.
  assert.equal((await post("preview", { ...swap, protocol_version, specimen_version }, mine())).status, 200);

  // A page that only looks on gets every stretch, with what came before it; one that takes nothing is cut off.
  const stalled = new Page({ stalled: true });
  const began = Date.now();
  const looking = new Page({ cookie: ann });
  assert.equal(await looking.answered, 101);
  assert.equal((await post("start", { operator: "Ann", protocol_file: "vma-smoke.toml", specimen_file: "" }, mine())).status, 200);
  await until("the plan", () => looking.last("plan")?.plan?.steps?.length === 24, 15);
  await until("running", () => looking.last("status")?.status?.state === "running", 15);

  // Who has no control may stop the rig, and not let it go on.
  assert.equal((await post("pause", {}, his())).status, 200);
  assert.equal((await post("resume", {}, his())).status, 409);
  assert.equal((await post("lease", { action: "take-over" }, his())).status, 200);
  await until("the holder", () => looking.last("lease")?.holder === "Bob" && looking.last("lease").mine === false, 5);
  assert.equal((await post("resume", {}, mine())).status, 409);
  await until("a crosshead that stands", async () => {
    const answer = await post("resume", {}, his());
    if (answer.status !== 200) assert.match(said(answer), /has not been seen to stand yet; try again in a moment/);
    return answer.status === 200;
  }, 10);
  assert.match(rig.web.logged(), /control taken over by Bob \(uid \d+\) from Ann[^]*resume by Bob/);
  assert.equal((await post("note", { run: looking.last("plan").plan.run, text: "the clamp slipped" }, mine())).status, 200);

  await until("the stalled page's end", () => looking.last("status")?.web?.viewers === 1, 60);
  const cut_s = (Date.now() - began) / 1000;
  assert.ok(cut_s > 9, `cut off after ${cut_s} s`);
  stalled.socket.resume();
  await stalled.closed;

  for (const [stream, name] of [[0, "frame"], [1, "pressure"], [2, "control"]]) {
    const numbers = looking.stretches(stream).sort((a, b) => a - b);
    assert.equal(new Set(numbers).size, numbers.length, `${name}: a stretch came twice`);
    // The machine may stand still: what is missing has to be what the daemon did not have.
    const missing = numbers.at(-1) - numbers[0] + 1 - numbers.length;
    assert.ok(numbers.length > 500 && missing <= numbers.length * 0.02, `${name}: ${missing} of ${numbers.length} stretches are missing`);
  }
  const web = looking.last("status").web;
  assert.equal(web.lost_on_the_way, 0);
  assert.equal(looking.last("left-out"), undefined);

  // Raw samples of two seconds, 2 ms each.
  const now = looking.last("status").status.mono_ns;
  const zoom = (await ask("GET", `/api/zoom?from=${now - 3e9}&to=${now - 1e9}&stretches=1000`)).body;
  assert.equal(zoom[1], 2);
  assert.ok(zoom.readUInt32LE(4) > 900, `${zoom.readUInt32LE(4)} stretches`);
  for (const query of ["", "from=0&to=1", "from=5&to=1&stretches=9", "from=0&to=99999999999999&stretches=9", "from=0&to=9&stretches=99999"])
    assert.equal((await ask("GET", `/api/zoom?${query}`)).status, 400, query);

  const memory = Number(readFileSync(`/proc/${rig.web.pid}/status`, "utf8").match(/VmRSS:\s+(\d+)/)[1]) / 1024;
  assert.ok(memory < 64, `isorig-web takes ${memory} MiB`);

  // Slow links: who takes little, but goes on taking, gets all of a run's page of 20 MiB and of a plan of 48,000 steps. Each takes longer
  // than the 10 s for which nothing may be taken, whatever the kernel's buffers hold (4 MiB to send, 6 MiB to receive at most).
  const first = looking.last("plan").plan.run;
  assert.equal((await post("abort", {}, mine())).status, 200);
  await rig.reach("ready");
  const many = `format = "isorig-protocol/1"
name = "many"
steps = [ { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "repeat", times = 16000, steps = [
    { do = "ramp", to_mm = 0.5, velocity_mm_s = 5 }, { do = "ramp", to_mm = 0, velocity_mm_s = 5 }, { do = "hold", duration_s = 0.5 } ] } ]
`;
  assert.equal((await post("start", { operator: "Bob", protocol: many, specimen_file: "" }, his())).status, 200);
  await until("the long plan", () => looking.last("plan")?.plan?.steps?.length > 48000, 60);
  const size = 20 << 20;
  writeFileSync(join(rig.dir, "runs", first, "report.html"), "x".repeat(size));
  const slow = new Page({ bytes_per_s: 120e3 });
  const slow_began = Date.now();
  const paged = askSlowly(`/report/${first}`, ann, 1e6);
  await until("the plan on a slow link", () => slow.last("plan")?.plan?.steps?.length > 48000, 90);
  const plan_s = (Date.now() - slow_began) / 1000;
  const { bytes, took_s } = await paged;
  assert.ok(bytes > size, `${bytes} of ${size} bytes came`);
  assert.ok(plan_s > 20 && took_s > 15, `too quick to show anything: ${plan_s} s, ${took_s} s`);
  slow.end();

  // The daemon dies: the page lives, and says so.
  assert.equal((await post("abort", {}, mine())).status, 200);
  const his_page = new Page({ cookie: bob });
  await until("Bob's page", () => his_page.last("lease")?.mine, 10);
  rig.daemon.kill("SIGKILL");
  await until("why there is nothing", () => /isorigd does not run/.test(looking.last("status")?.why ?? ""), 10);
  assert.equal((await post("abort", {}, mine())).status, 502);
  // Who had control and has closed his page does not get it from the next daemon, where he would keep others from theirs.
  his_page.end();
  await until("the end of Bob's page", () => looking.last("status").web.viewers === 1, 10);
  rig.startDaemon();
  await until("the next daemon", () => looking.last("status")?.status, 60);
  assert.equal((await post("lease", { action: "take" }, mine())).status, 200);
  assert.equal((await post("leave", {}, mine())).status, 200);
  assert.equal((await post("abort", {}, mine())).status, 403);
  looking.end();

  console.log(`a stalled page was cut off after ${cut_s.toFixed(0)} s; ${looking.stretches(0).length} stretches of the frame; ${memory.toFixed(0)} MiB; ` +
    `slowly: a plan in ${plan_s.toFixed(0)} s, ${bytes >> 20} MiB of a page in ${took_s.toFixed(0)} s`);
  rig.web.kill("SIGTERM");
  assert.equal(await rig.web.ended, 0);
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  rig.end();
}
