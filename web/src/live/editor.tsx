import { useEffect, useRef } from "preact/hooks";
import type { Diagnostic } from "./checked_plan.ts";
import { offsetOf } from "./draft.ts";

/** A text with line numbers, on which lines that are wrong are marked. The browser's own text field: undo, marking, find, and
 *  a telephone's keyboard are what people know. Tab goes on to the next control. */
export function Editor(props: { text: string; wrong: Diagnostic[]; change: (text: string) => void; go: { line: number; column: number } | null }) {
  const field = useRef<HTMLTextAreaElement>(null), gutter = useRef<HTMLDivElement>(null);
  const lines = props.text.split("\n").length;
  const follow = () => {
    if (gutter.current && field.current) gutter.current.scrollTop = field.current.scrollTop;
  };
  useEffect(follow);
  useEffect(() => {
    const f = field.current;
    if (!props.go || !f) return;
    const [from, to] = offsetOf(f.value, props.go.line, props.go.column);
    f.focus();
    f.setSelectionRange(from, to);
    const height = f.scrollHeight / Math.max(1, lines);
    f.scrollTop = Math.max(0, (props.go.line - 4) * height);
    follow();
  }, [props.go]);
  const marked = new Set(props.wrong.map((d) => d.line));
  return (
    <div class="editor">
      <div class="gutter" ref={gutter} aria-hidden="true">
        <pre>{Array.from({ length: lines }, (_, i) => marked.has(i + 1) ? <b class="bad">✕ {i + 1}{"\n"}</b> : `${i + 1}\n`)}</pre>
      </div>
      <textarea ref={field} value={props.text} wrap="off" spellcheck={false} autocapitalize="off" autocomplete="off" aria-label="Protocol, TOML"
        aria-invalid={props.wrong.length > 0} aria-describedby="diagnostics" onScroll={follow} onInput={(e) => props.change(e.currentTarget.value)} />
    </div>
  );
}
