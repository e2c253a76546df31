/** The protocol that is being edited. It outlives the page: a reload, or a look at another page, loses nothing. Each tab has its
 *  own; a new one begins with what was written last in any. */
export interface Draft {
  name: string;
  text: string;
  /** Of the saved protocol that this one may replace; empty: it is new. */
  version: string;
  /** The text as it was opened or saved: what differs from it is not saved yet. */
  opened: string;
}

export const SKELETON = `format = "isorig-protocol/1"
name = "new"
description = ""

steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 2, settled_for_s = 2, timeout_s = 60 },
  { do = "hold", duration_s = 10 },
  { do = "ramp", to_mm = 1, velocity_mm_s = 1 },
  { do = "hold", duration_s = 10 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 1 },
]
`;

const KEY = "protocol-draft";
const EMPTY: Draft = { name: "new.toml", text: SKELETON, version: "", opened: SKELETON };

/** The tab's own, then the browser's, where a draft is found after the tab was closed. */
const stores = () => [sessionStorage, localStorage];

export function loadDraft(from: Pick<Storage, "getItem">[] = stores()): Draft {
  for (const storage of from) {
    try {
      const kept = JSON.parse(storage.getItem(KEY) ?? "null") as Partial<Draft> | null;
      if (kept && [kept.name, kept.text, kept.version, kept.opened].every((v) => typeof v === "string")) return kept as Draft;
    } catch {
      // What stands there is no draft.
    }
  }
  return { ...EMPTY };
}

export function keepDraft(draft: Draft, to: Pick<Storage, "setItem">[] = stores()): void {
  for (const storage of to) {
    try {
      storage.setItem(KEY, JSON.stringify(draft));
    } catch {
      // A browser that keeps nothing: the draft lives as long as the page.
    }
  }
}

export const isDirty = (draft: Draft) => draft.text !== draft.opened;

/** What the page says of a name, before the server does. */
export function nameFault(name: string): string {
  if (!name.endsWith(".toml")) return "the name ends in .toml";
  if (!/^[A-Za-z0-9_-][A-Za-z0-9_.-]*\.toml$/.test(name) || name.length > 128) return "letters, digits, - _ and . only, at most 128";
  return "";
}

/** Where line and column of a diagnostic lie in the text, from 0; both count from 1, columns in characters. */
export function offsetOf(text: string, line: number, column: number): [number, number] {
  let at = 0;
  for (let l = 1; l < line; ++l) {
    const next = text.indexOf("\n", at);
    if (next < 0) break;
    at = next + 1;
  }
  const end = text.indexOf("\n", at), stop = end < 0 ? text.length : end;
  const whole = [...text.slice(at, stop)];
  const from = at + whole.slice(0, Math.max(0, column - 1)).join("").length;
  return [Math.min(from, stop), stop];
}
