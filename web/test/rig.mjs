// What the tests of the live page share: real processes on the simulated rig, in a folder of their own.
import { execFileSync, spawn, spawnSync } from "node:child_process";
import { mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";

/** Looks ten times a second; the limit only says when to give up. */
export async function until(what, look, seconds = 60) {
  const end = Date.now() + seconds * 1000;
  for (;;) {
    const value = await look();
    if (value) return value;
    if (Date.now() > end) throw new Error(`waited ${seconds} s for ${what}`);
    await new Promise((r) => setTimeout(r, 100));
  }
}

/** The answer to the form of the page that a link of `isorig web` leads to. */
export const enter = (link, headers = {}) => fetch(new URL("/enter", link), { method: "POST", redirect: "manual", body: new URL(link).search.slice(1),
  headers: { Origin: new URL(link).origin, "Content-Type": "application/x-www-form-urlencoded", ...headers } });

export class Rig {
  /** `api`: lines for the table [api] of the rig's file. */
  constructor(bin, source, { api = "" } = {}) {
    this.api = api;
    this.bin = resolve(bin);
    this.source = resolve(source);
    this.dir = mkdtempSync(join(tmpdir(), "isorig-live-"));
    this.socket = join(this.dir, "isorigd.sock");
    this.children = [];
    this.models = join(this.dir, "models");
    this.saved = join(this.dir, "saved");
    mkdirSync(this.models);
  }

  child(program, words) {
    const child = spawn(join(this.bin, program), words, { stdio: ["ignore", "pipe", "pipe"] });
    let text = "";
    for (const stream of [child.stdout, child.stderr]) stream.on("data", (d) => (text += d));
    child.logged = () => text;
    child.ended = new Promise((done) => child.on("exit", (code) => done(code)));
    this.children.push(child);
    return child;
  }

  /** The shipped virtual rig for a machine that may stand still for some tenths of a second: the page is tested here. */
  file() {
    const seconds = "2.0";
    const text = readFileSync(join(this.source, "config/rigs/sim.toml"), "utf8")
      .replaceAll('"../', `"${this.source}/config/`)
      .replace("frame_age_max_s = 0.25\npressure_age_max_s = 0.25",
        ["frame_age", "pressure_age", "interlock_age", "late_tick", "segment_ack"].map((key) => `${key}_max_s = ${seconds}`).join("\n"))
      .replace("force_max_N = 120.0", "force_max_N = 16.0")  // what a stroke of 1 mm does not reach, and one of 4 mm does
      .replace("heartbeat_timeout_s = 0.5", `heartbeat_timeout_s = ${seconds}`)
      .replace("watchdog_s = 0.5", `watchdog_s = ${seconds}`)
      .replace("ring_samples = 256", "ring_samples = 2048")
      .replace("[sim.pressure]\n", "[sim.pressure]\nring_samples = 2048\n");
    const path = join(this.dir, "rig.toml");
    writeFileSync(path, this.api ? `${text}\n[api]\n${this.api}\n` : text);
    return path;
  }

  startDaemon() {
    this.daemon = this.child("isorigd", ["--no-realtime", "--rig", this.file(), "--runs", join(this.dir, "runs"), "--socket", this.socket]);
  }

  /** The page's server, on any free port; its address. */
  async startWeb() {
    this.web = this.child("isorig-web", ["--socket", this.socket, "--port", "0", "--protocols", join(this.source, "config/protocols"),
      "--specimens", join(this.source, "config/specimens"), "--models", this.models,
      "--saved-protocols", this.saved]);
    this.base = await until("isorig-web", () => this.web.logged().match(/http:\/\/localhost:\d+/)?.[0], 20);
    this.port = Number(new URL(this.base).port);
    return this.base;
  }

  isorig(...words) {
    return execFileSync(join(this.bin, "isorig"), words, { encoding: "utf8" }).trim();
  }
  /** What a call that is refused says, line by line. */
  refusal(...words) {
    const said = spawnSync(join(this.bin, "isorig"), words, { encoding: "utf8" });
    if (said.status === 0) throw new Error(`isorig ${words.join(" ")} was not refused`);
    return said.stderr.trim().split("\n");
  }
  call(...words) {
    return this.isorig(...words, "--socket", this.socket);
  }
  async reach(state) {
    await until(state, () => {
      try {
        return JSON.parse(this.call("status", "--json")).state === state;
      } catch {
        return false;
      }
    });
  }

  logs() {
    return this.children.map((c) => `${c.spawnfile}:\n${c.logged().slice(-3000)}`).join("\n");
  }
  end() {
    for (const c of this.children) c.kill("SIGKILL");
    rmSync(this.dir, { recursive: true, force: true });
  }
}
