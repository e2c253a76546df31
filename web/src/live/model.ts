/** What the page knows: the daemon's answers as they come, the samples in rings. */
import { SentClock } from "./sent_clock.ts";
import { blocks, CHANNELS, COARSE, StretchRing } from "./stretches.ts";

export interface Link {
  connected: boolean;
  clock_ready: boolean;
  bound_us: number | null;
  repeatability_us: number | null;
  lost: number;
  corrupt: number;
  errors: number;
  reconnects: number;
  detail: string;
}

export interface Status {
  pid: number;
  rig: string;
  state: string;
  not_ready: string;
  fault: string;
  faults: { mono_ns: number; severity: string; code: string; text: string }[];
  zero_confirmed: boolean;
  simulated: boolean;
  arming: string;
  mono_ns: number;
  position_mm: number;
  force_N: number;
  pressure_psi: number;
  frame_age_s: number;
  pressure_age_s: number;
  setpoint_psi: number;
  /** Both valves are kept shut: nothing regulates the pressure. */
  sealed: boolean;
  fill_permille: number;
  vent_permille: number;
  target_mm: number;
  velocity_mm_s: number;
  progress: number;
  remaining_s: number;
  operator_left_s: number | null;
  loop: { ticks: number; overruns: number; worst_wakeup_us: number; worst_run_us: number };
  frame: Link;
  pressure: Link;
  interlock: { watched: boolean; not_watched: string; estop_closed: boolean; guard_closed: boolean; connected: boolean };
  records_dropped: number;
  publish_dropped: number;
  run?: { id: string; protocol: string; step: number; steps: number; step_text: string; session: number | null; session_text: string; sessions: number };
  last_run?: { id: string; outcome: string; fault: string };
  recorder?: { disk: string; free_MiB: number; written_MiB: number; lost_messages: number; dropped_records: number; missing_samples: number; error: string };
}

/** The live twin; `model` is null without one. */
export interface Twin {
  model: string | null;
  /** Why there is none, if the protocol asked for one. */
  why?: string;
  on_parting?: "mark" | "pause" | "abort";
  by_protocol?: boolean;
  band?: boolean;
  phase?: "waits" | "settles" | "stands" | "judged" | "parted";
  judged?: number;
  covered?: number;
  learning?: boolean;
  k?: number;
  h?: number;
  correlation_s?: number;
  high?: number;
  low?: number;
  notes?: string[];
  /** null: no number, which JSON has no word for. */
  force_N?: number | null;
  half_N?: number | null;
  residual?: number;
  outside?: boolean;
  parting?: { mono_ns: number; found_mono_ns: number; step: number; text: string; residual_N: number };
}

/** A verdict with its words, as the terminal has them (cli/screen/live_verdicts.hpp). */
export interface Said {
  tone: "good" | "warn" | "bad";
  text: string;
}

/** Why there is no status: none came yet, nothing listens on the daemon's socket, it does not answer, or it refuses to. */
export type NoStatus = "not yet" | "gone" | "silent" | "refused";

export interface Web {
  unix_ms: number;
  /** When this was sent, by a clock of isorig-web's that nobody sets. */
  sent_ms: number;
  /** Samples and other records that isorig-web never got, each counted once. */
  lost: number;
  /** Of these what the daemon counted between itself and isorig-web. */
  lost_on_the_way: number;
  /** Of the worst tick of each hundredth of a second in ten minutes, how many were late by 2^(k-1) to 2^k µs. */
  lateness: number[];
  /** Of the loop and the devices; one that the status has no numbers for is not there. */
  verdicts: { loop?: Said; frame?: Said; pressure?: Said };
  viewers: number;
  twin: Twin;
}

export interface Step {
  do: string;
  text: string;
  session: number | null;
  start_s: number;
  nominal_s: number;
  worst_s: number;
}

export interface Plan {
  rig: string;
  limits: { travel_min_mm: number; travel_max_mm: number; force_min_N: number; force_max_N: number; pressure_max_psi: number };
  run: string | null;
  protocol?: string;
  nominal_s?: number;
  worst_s?: number;
  first_step?: number;
  sessions?: string[];
  steps?: Step[];
}

export interface Event {
  mono_ns: number;
  count: number;
  severity: string;
  code: string;
  text: string;
}

export interface Hello {
  rig: string;
  epoch_unix_us: number;
  fine_ns: number;
  fine_kept_ns: number;
  coarse_ns: number;
  may_control: boolean;
  name: string;
}

const DAY_NS = 86_400e9;
/** As many as isorig-web keeps (webserver/hub.cpp). */
export const EVENTS_KEPT = 1000;

export class Model {
  hello: Hello | null = null;
  status: Status | null = null;
  /** Why there is no status. */
  why = "";
  none: NoStatus = "not yet";
  web: Web | null = null;
  plan: Plan | null = null;
  events: Event[] = [];
  lease: { holder: string | null; mine: boolean } = { holder: null, mine: false };
  /** Messages that this page was too slow for. */
  left_out = 0;
  connected = false;
  /** When the last status was sent, by this page's own clock. */
  status_ms = 0;
  private clock = new SentClock();
  fine: StretchRing[] = [];
  coarse: StretchRing[] = [];

  private readonly listeners = new Set<() => void>();

  /** Called after each change of what is not a sample. */
  watch(listener: () => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }
  changed(): void {
    for (const listener of this.listeners) listener();
  }

  binary(buffer: ArrayBuffer): void {
    for (const block of blocks(buffer)) (block.tier === COARSE ? this.coarse : this.fine)[block.stream]?.put(block);
  }

  text(message: string, now_ms = performance.now()): void {
    const m = JSON.parse(message);
    switch (m.kind) {
      case "hello": {
        const first = this.hello === null || this.fine.length === 0;
        this.hello = m as Hello;
        if (first) this.empty();
        break;
      }
      case "status":
        // The daemon tells its own events again. On a slow link the status that says that it has gone may be left out.
        if (m.status === null || (this.status !== null && this.status.pid !== m.status.pid)) {
          this.events = this.events.filter((e) => e.code === "twin");
        }
        this.status = m.status;
        this.why = m.why ?? "";
        this.none = m.none ?? "not yet";
        this.web = m.web;
        this.status_ms = this.clock.sentAt_ms(m.web.sent_ms, now_ms);
        if (m.status === null) this.plan = null;
        break;
      case "plan":
        this.plan = m.plan;
        break;
      case "events":
        this.addEvents(m.events);
        break;
      case "lease":
        this.lease = { holder: m.holder, mine: m.mine };
        break;
      case "left-out":
        this.left_out = m.messages;
        break;
      case "another-clock":
        this.empty();
        break;
    }
    this.changed();
  }

  /** A connection begins, perhaps to another process, which sends all again. */
  connecting(): void {
    this.clock = new SentClock();
    this.events = [];
    this.left_out = 0;
    this.empty();
  }

  /** Before the history is sent again. */
  empty(): void {
    const h = this.hello;
    if (h === null) return;
    this.fine = CHANNELS.map((c) => new StretchRing(Math.ceil(h.fine_kept_ns / h.fine_ns) + 500, c));
    this.coarse = CHANNELS.map((c) => new StretchRing(Math.ceil(DAY_NS / h.coarse_ns) + 10, c));
  }

  /** Seconds of Unix time of a moment on the host's clock. */
  unix_s(mono_ns: number): number {
    return (this.hello?.epoch_unix_us ?? 0) / 1e6 + mono_ns / 1e9;
  }

  /** The newest moment that a sample is known of, ns. */
  newest_ns(): number {
    const h = this.hello;
    return h === null ? 0 : Math.max(0, ...this.fine.map((ring) => (ring.newest + 1) * h.fine_ns).filter(Number.isFinite));
  }

  private addEvents(fresh: Event[]): void {
    const key = (e: Event) => `${e.mono_ns} ${e.code}`;
    const again = new Set(fresh.map(key));
    this.events = [...this.events.filter((e) => !again.has(key(e))), ...fresh].slice(-EVENTS_KEPT);
  }
}

/** Feeds the model for as long as the page is open; a connection that ends is made again. */
export function connect(model: Model): void {
  const again = () => setTimeout(() => connect(model), 1000);
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    model.connected = true;
    model.connecting();
    model.changed();
  };
  socket.onmessage = (message: MessageEvent<string | ArrayBuffer>) => {
    if (typeof message.data === "string") model.text(message.data);
    else model.binary(message.data);
  };
  socket.onclose = () => {
    model.connected = false;
    model.changed();
    again();
  };
}

export interface Reply {
  ok: boolean;
  /** Of HTTP; 0: there was no answer. */
  status: number;
  text: string;
  body: Record<string, unknown>;
}

export async function post(call: string, body: object = {}): Promise<Reply> {
  try {
    const answer = await fetch(`/api/${call}`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
    });
    const json = (await answer.json()) as Record<string, unknown>;
    return { ok: answer.ok && json["ok"] !== false, status: answer.status, text: String(json["text"] ?? ""), body: json };
  } catch (error) {
    return { ok: false, status: 0, text: `isorig-web did not answer: ${(error as Error).message}`, body: {} };
  }
}
