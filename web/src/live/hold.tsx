import { useEffect, useRef, useState } from "preact/hooks";
import type { ComponentChildren } from "preact";

/** How long a button has to be held, ms. Long enough that no slip does it, short enough for an abort. */
export const HOLD_MS = 800;

/** A button that acts when it was held for HOLD_MS, with pointer, Enter or Space; letting go earlier does nothing. */
export function HoldButton(props: { act: () => void; disabled?: boolean; class?: string; children: ComponentChildren; title?: string }) {
  const [held, setHeld] = useState(false);
  const [early, setEarly] = useState(false);
  const timer = useRef<number | undefined>(undefined);
  const begin = () => {
    if (props.disabled || timer.current !== undefined) return;
    setHeld(true);
    setEarly(false);
    timer.current = window.setTimeout(() => {
      timer.current = undefined;
      setHeld(false);
      props.act();
    }, HOLD_MS);
  };
  const end = () => {
    if (timer.current === undefined) return;
    window.clearTimeout(timer.current);
    timer.current = undefined;
    setHeld(false);
    setEarly(true);
  };
  useEffect(() => {
    if (!early) return;
    const gone = window.setTimeout(() => setEarly(false), 2000);
    return () => window.clearTimeout(gone);
  }, [early]);
  useEffect(() => () => window.clearTimeout(timer.current), []);
  return (
    <button
      type="button" class={`hold ${props.class ?? ""}${held ? " held" : ""}`} disabled={props.disabled} title={props.title ?? "Hold to act"}
      onPointerDown={begin} onPointerUp={end} onPointerLeave={end} onPointerCancel={end}
      onKeyDown={(e) => {
        if (e.key !== "Enter" && e.key !== " ") return;
        e.preventDefault();
        if (!e.repeat) begin();
      }}
      onKeyUp={end} onBlur={end} onContextMenu={(e) => e.preventDefault()}
    >
      <span class="fill" aria-hidden="true" />
      <span class="label">{early ? "hold longer" : props.children}</span>
    </button>
  );
}
