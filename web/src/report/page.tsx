import type { ComponentChildren, JSX } from "preact";
import { useId } from "preact/hooks";
import type { Block, Document, Fact } from "./document.ts";
import { Figure } from "./figure.tsx";
import { Answers } from "./grid.tsx";

/** A report as a page: the sentence it comes to, what it rests on, how it was made. */
export function Page({ document: d }: { document: Document }): JSX.Element {
  const headings = d.blocks.flatMap((b) => (b.type === "heading" && b.level === 2 ? [b.text] : []));
  return (
    <>
      <a class="skip screen-only" href="#content">To the content</a>
      <header>
        <p class="kind">{d.kind}</p>
        <h1>{d.title}</h1>
        {d.subtitle && <p class="subtitle">{d.subtitle}</p>}
        <Neighbours links={d.links ?? []} />
      </header>
      <main id="content">
        {d.lead && (
          <p class={`lead ${d.lead.mood}`}>
            <strong>{d.lead.word}</strong> {d.lead.text}
          </p>
        )}
        {headings.length > 4 && (
          <nav class="contents screen-only" aria-label="Contents">
            {headings.map((h) => <a key={h} href={`#${slug(h)}`}>{h}</a>)}
          </nav>
        )}
        <Blocks blocks={d.blocks} count={{ figures: 0 }} />
      </main>
      <Made document={d} />
    </>
  );
}

/** What a server of isorig gives out (base/report_pages.hpp). */
const REPORT = /(^|\/)(report|(fv|campaign|diagnosis|investigation)-report)\.html$/;

/** Links lead from file to file. isorig-web has a report at /page and its path, so that they lead to other reports there, too;
 *  data beside it are for who is at the disk. */
function Neighbours({ links }: { links: { text: string; href: string }[] }): JSX.Element | null {
  const served = location.protocol.startsWith("http") && location.pathname.startsWith("/page/");
  const there = served ? links.filter((l) => REPORT.test(l.href)) : links, rest = links.filter((l) => !there.includes(l));
  if (links.length === 0 && !served) return null;
  return (
    <>
      {(served || there.length > 0) && (
        <nav class={there.length === 0 ? "links screen-only" : "links"} aria-label="Neighbours of this report">
          {there.map((l) => <a key={l.href} href={l.href}>{l.text}</a>)}
          {served && <><a class="screen-only" href="/#runs">All runs</a><a class="screen-only" href="/#diagnosis">All diagnoses</a></>}
        </nav>
      )}
      {rest.length > 0 && <p class="links screen-only">Beside it on the disk: {rest.map((l) => l.text).join(", ")}.</p>}
    </>
  );
}

/** What stands in `backticks` is a command, a file or a key. */
function words(text: string): ComponentChildren {
  const parts = text.split("`");
  return parts.length % 2 === 0 ? text : parts.map((part, i) => (i % 2 === 1 ? <code key={i}>{part}</code> : part));
}

export function slug(text: string): string {
  return text.toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "");
}

function Blocks({ blocks, count }: { blocks: Block[]; count: { figures: number } }): JSX.Element {
  return <>{blocks.map((b, i) => <One key={i} block={b} count={count} />)}</>;
}

function One({ block: b, count }: { block: Block; count: { figures: number } }): JSX.Element {
  const caption = useId();
  switch (b.type) {
    case "heading":
      return b.level === 2 ? <h2 id={slug(b.text)}>{b.text}</h2> : <h3>{b.text}</h3>;
    case "paragraph":
      return <p>{words(b.text)}</p>;
    case "note":
      return <p class={`note ${b.mood}`} role="note">{words(b.text)}</p>;
    case "equation":
      return <p class="equation">{b.text}</p>;
    case "code":
      return <pre tabIndex={0} aria-label={b.name}><code>{b.text}</code></pre>;
    case "list":
      return <ul>{b.items.map((item, i) => <li key={i}>{words(item)}</li>)}</ul>;
    case "facts":
      return <Facts items={b.items} />;
    case "table":
      return (
        <Frame label={b.caption || "table"}>
          {b.caption && <p class="caption" id={caption}>{b.caption}</p>}
          <table aria-labelledby={b.caption ? caption : undefined}>
            <thead>
              <tr>
                {b.columns.map((c, i) => (c.name === "" ? <td key={i} /> : <th key={i} scope="col" class={c.numeric ? "number" : undefined}>{c.name}</th>))}
              </tr>
            </thead>
            <tbody>
              {b.rows.map((row, r) => (
                <tr key={r}>
                  {b.columns.map((c, i) => {
                    const href = b.hrefs?.[r]?.[i], kind = c.numeric ? "number" : undefined;
                    const text = href ? <a href={href}>{row[i] ?? ""}</a> : row[i] ?? "";
                    return i === 0 && !c.numeric ? <th key={i} scope="row">{text}</th> : <td key={i} class={kind}>{text}</td>;
                  })}
                </tr>
              ))}
            </tbody>
          </table>
        </Frame>
      );
    case "grid":
      return <Answers grid={b} />;
    case "figure":
      count.figures += 1;
      return <Figure figure={b.figure} index={count.figures} />;
    case "more":
      return (
        <details class="more">
          <summary>{b.summary}</summary>
          <Blocks blocks={b.blocks} count={count} />
        </details>
      );
  }
}

/** Wide tables scroll on a narrow screen, by keyboard as well; on paper they wrap. */
function Frame({ label, children }: { label: string; children: ComponentChildren }): JSX.Element {
  return <div class="table-frame" tabIndex={0} role="group" aria-label={label}>{children}</div>;
}

function Facts({ items }: { items: Fact[] }): JSX.Element {
  return (
    <dl class="facts">
      {items.map((f, i) => (
        <div key={i} class={f.mood}>
          <dt>{f.name}</dt>
          <dd>{f.value}{f.note && <span class="hint">{f.note}</span>}</dd>
        </div>
      ))}
    </dl>
  );
}

function Made({ document: d }: { document: Document }): JSX.Element {
  const m = d.made;
  return (
    <footer>
      <h2>How this page was made</h2>
      <dl class="made">
        {m.command && <><dt>Command</dt><dd><code>{m.command}</code></dd></>}
        {m.version && <><dt>Version</dt><dd>{m.version}</dd></>}
        {m.at_utc && <><dt>Time</dt><dd>{m.at_utc}</dd></>}
        {m.inputs?.map((i) => <><dt>{i.name}</dt><dd>{i.what}</dd></>)}
      </dl>
      <p class="screen-only">
        One file, no network. Drag in a figure to zoom, double click for all of it; under each figure are its numbers, and the
        figure as SVG, PNG and CSV.
      </p>
    </footer>
  );
}
