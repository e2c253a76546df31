import { useRef, useState } from "preact/hooks";
import type { JSX } from "preact";
import { Chart, Legend, useWidth } from "../shared/chart.tsx";
import type { Figure as FigureData, Range, Series } from "../shared/figure.ts";
import { axisLabel, number } from "../shared/format.ts";
import { save, savePng, saveSvg, valuesCsv } from "./save.ts";

/** A figure with its key, its caption, its numbers as a table, and itself as a file. */
export function Figure({ figure, index }: { figure: FigureData; index: number }): JSX.Element {
  const [box, total] = useWidth(900);
  const [zoom, setZoom] = useState<Range | null>(null);
  const [cursor, setCursor] = useState<number | null>(null);
  const grid = useRef<HTMLDivElement>(null);
  const columns = total < 560 ? 1 : Math.max(1, Math.min(figure.columns, total < 800 ? 2 : figure.columns));
  const width = Math.max(260, Math.floor((total - 16 * (columns - 1)) / columns));
  const linked = figure.linked === true;
  const several = figure.panels.length > 1;
  const sameKeys = !several || columns === 1 && linked || allKeysIn(figure);
  return (
    <figure id={figure.name} ref={box as never}>
      {sameKeys && <Legend panels={figure.panels} cursor={cursor} />}
      <div ref={grid} class="panels" style={{ gridTemplateColumns: `repeat(${columns}, minmax(0, 1fr))` }}>
        {figure.panels.map((panel, k) => (
          <div class="panel" key={k}>
            {!sameKeys && <Legend panels={[panel]} cursor={cursor} />}
            <Chart panel={panel} characters={linked ? 6 : 2} name={`${figure.name}-${k}`} width={width}
              height={Math.round(Math.min(420, Math.max(190, width * (panel.aspect ?? (columns > 1 ? 0.68 : 0.34)))))}
              zoom={linked || !several ? zoom : null} onZoom={linked || !several ? setZoom : undefined}
              cursor={linked || !several ? cursor : null} onCursor={linked || !several ? setCursor : undefined} />
          </div>
        ))}
      </div>
      <figcaption>
        <b>Figure {index}.</b> {figure.caption}
      </figcaption>
      <div class="tools screen-only">
        {zoom && <button type="button" onClick={() => setZoom(null)}>whole range</button>}
        <details>
          <summary>Numbers and files</summary>
          <p class="files">
            <button type="button" onClick={() => saveSvg(figure.name, grid.current)}>SVG</button>
            <button type="button" onClick={() => savePng(figure.name, grid.current)}>PNG</button>
            <button type="button" onClick={() => save(`${figure.name}.csv`, "text/csv", valuesCsv(figure))}>CSV</button>
          </p>
          <Numbers figure={figure} />
        </details>
      </div>
    </figure>
  );
}

/** Every name in the first panel's key: then the others need none. */
function allKeysIn(figure: FigureData): boolean {
  const first = new Map(figure.panels[0]?.series.filter((s) => s.label).map((s) => [s.label, s.color]));
  return figure.panels.every((p) => p.series.every((s) => !s.label || first.get(s.label) === s.color));
}

/** For those who do not see the curves: short series in full, long ones by what they span. */
function Numbers({ figure }: { figure: FigureData }): JSX.Element {
  const rows = figure.panels.flatMap((panel) => panel.series.map((s, i) => ({ panel, s, i })));
  return (
    <div class="table-frame" tabIndex={0}>
      <table>
        <caption>What figure “{figure.name}” shows</caption>
        <thead>
          <tr>
            <th scope="col">series</th>
            <th scope="col">abscissa</th>
            <th scope="col">ordinate</th>
            <th scope="col" class="number">points</th>
            <th scope="col" class="number">lowest</th>
            <th scope="col" class="number">highest</th>
          </tr>
        </thead>
        <tbody>
          {rows.map(({ panel, s, i }) => {
            const [low, high] = span(s);
            return (
              <tr key={`${panel.title}${i}`}>
                <th scope="row">{[panel.title, s.label].filter(Boolean).join(": ") || `series ${i + 1}`}</th>
                <td>{axisLabel(panel.x.name, panel.x.unit ?? "")}</td>
                <td>{axisLabel(panel.y.name, panel.y.unit ?? "")}</td>
                <td class="number">{s.y.filter((v) => v !== null).length}</td>
                <td class="number">{number(low)}</td>
                <td class="number">{number(high)}</td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </div>
  );
}

function span(s: Series): [number | null, number | null] {
  let low: number | null = null, high: number | null = null;
  for (const v of [...s.y, ...(s.y2 ?? [])]) {
    if (v === null) continue;
    low = low === null ? v : Math.min(low, v);
    high = high === null ? v : Math.max(high, v);
  }
  return [low, high];
}
