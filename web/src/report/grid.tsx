import type { JSX } from "preact";
import { useId } from "preact/hooks";
import { colour } from "../shared/chart.tsx";
import type { Grid, GridCell } from "./document.ts";

/** Many small answers on one page. What a colour says its letter says as well. */
export function Answers({ grid }: { grid: Grid }): JSX.Element {
  const caption = useId();
  return (
    <div class="answers">
      <p class="answers-key">
        {grid.key.map((k) => <span key={k.text}><Mark cell={{ ...k, title: "" }} /> {k.title}</span>)}
      </p>
      <div class="table-frame" tabIndex={0} role="group" aria-label="all recordings">
        <table class="grid" aria-labelledby={caption}>
          <thead>
            <tr><td />{grid.columns.map((c) => <th key={c} scope="col">{c}</th>)}</tr>
          </thead>
          <tbody>
            {grid.rows.map((row) => (
              <tr key={row.name}>
                <th scope="row">{row.name}</th>
                {row.cells.map((cells, i) => (
                  <td key={i}><span class="marks">{cells.map((cell, k) => <Mark key={k} cell={cell} />)}</span></td>
                ))}
              </tr>
            ))}
          </tbody>
        </table>
        <p class="caption" id={caption}>{grid.caption}</p>
      </div>
    </div>
  );
}

function Mark({ cell }: { cell: GridCell }): JSX.Element {
  const style = cell.color === undefined ? undefined : { "--mark": colour(cell.color) } as JSX.CSSProperties;
  const kind = cell.color === undefined ? "mark plain" : "mark";
  return cell.href === undefined
    ? <span class={kind} style={style} title={cell.title || undefined}>{cell.text}</span>
    : <a class={kind} style={style} title={cell.title} aria-label={cell.title} href={cell.href}>{cell.text}</a>;
}
