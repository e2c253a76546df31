/** A stretch of the past that was marked with the mouse. */
import type { Model } from "./model.ts";
import type { Window } from "./plots.ts";
import { blocks, CHANNELS, grid, StretchRing } from "./stretches.ts";

/** From the server's raw samples where they are still kept, else from the stretches of 5 s of the day; or why it cannot be shown. */
export async function zoomed(model: Model, from_s: number, to_s: number, pixels: number, get: typeof fetch = fetch): Promise<Window | string> {
  const h = model.hello;
  if (h === null) return "The stretch cannot be enlarged: isorig-web has sent no samples yet.";
  const epoch_s = h.epoch_unix_us / 1e6;
  const from = Math.max(0, Math.round((from_s - epoch_s) * 1e9)), to = Math.round((to_s - epoch_s) * 1e9);
  if (from < model.newest_ns() - h.fine_kept_ns) return ofTheDay(model, from, to, pixels);
  let buffer: ArrayBuffer;
  try {
    const answer = await get(`/api/zoom?from=${from}&to=${to}&stretches=${Math.max(1, Math.round(pixels))}`);
    if (!answer.ok) return `The stretch cannot be enlarged: ${await reason(answer)}.`;
    buffer = await answer.arrayBuffer();
  } catch (error) {
    return `The stretch cannot be enlarged: isorig-web did not answer (${(error as Error).message}).`;
  }
  const found = blocks(buffer);
  const rings = found.map((b, i) => {
    const ring = new StretchRing(Math.max(16, Math.ceil((to - from) / b.width_ns) + 4), CHANNELS[i] as number);
    ring.put(b);
    return ring;
  });
  const width_ns = found[0]?.width_ns ?? 1e6;
  if (rings.every((ring) => !Number.isFinite(ring.newest))) return NOTHING;
  return { rings, width_ns, from_ns: from, to_ns: to, grid: grid(from, to, width_ns, Infinity) };
}

const NOTHING = "Nothing is kept of that stretch: no samples came then, or isorig-web was started later.";

function ofTheDay(model: Model, from: number, to: number, pixels: number): Window | string {
  const width_ns = model.hello?.coarse_ns ?? 1;
  const first = Math.floor(from / width_ns), last = Math.ceil(to / width_ns);
  const there = model.coarse.some((ring) => {
    for (let i = first; i < last; ++i) if (ring.at(i) >= 0) return true;
    return false;
  });
  return there ? { rings: model.coarse, width_ns, from_ns: from, to_ns: to, grid: grid(from, to, width_ns, pixels) } : NOTHING;
}

/** The server's own words where it has some. */
async function reason(answer: Response): Promise<string> {
  try {
    const text = ((await answer.json()) as { text?: unknown }).text;
    if (typeof text === "string" && text !== "") return text;
  } catch {
    // No JSON: the number of the answer says as much.
  }
  return `isorig-web answered ${answer.status}`;
}
