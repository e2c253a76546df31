import type { Said } from "./model.ts";
import { ageText } from "./words.ts";

/** Readings in numbers with their age, and what is well with its sign and words. */

/** So many decimals, always: digits that come and go cannot be read from afar. */
export function value(v: number | null | undefined, digits: number): string {
  if (v === null || v === undefined) return "–";
  const text = v.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
}

const SIGNS = { good: "✓", warn: "!", bad: "✕", unknown: "?" } as const;

function Line({ kind, children }: { kind: keyof typeof SIGNS; children: preact.ComponentChildren }) {
  return <li class={kind}><span aria-hidden="true">{SIGNS[kind]}</span> {children}{kind === "bad" ? " (!)" : ""}</li>;
}

export function Check({ good, children }: { good: boolean | null; children: preact.ComponentChildren }) {
  return <Line kind={good === null ? "unknown" : good ? "good" : "bad"}>{children}</Line>;
}

/** As the terminal judges it: isorig-web sends the verdict with its words. */
export function Judged({ name, said }: { name: string; said: Said | undefined }) {
  return <Line kind={said?.tone ?? "unknown"}>{name}: {said?.text ?? "no verdict"}</Line>;
}

/** A reading with its unit; greyed with its age in words when it is not of now. */
export function Reading({ name, unit, value: shown, age_s, children }: { name: string; unit: string; value: string; age_s: number; children: preact.ComponentChildren }) {
  const age = ageText(age_s);
  return (
    <div class={age ? "stale" : ""}>
      <h3>{name}</h3>
      <p class="big">{age_s < 0 ? "–" : shown}<small> {unit}</small></p>
      {age && <p class="age">{age}</p>}
      {children}
    </div>
  );
}
