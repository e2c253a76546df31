import type { Model } from "./model.ts";

/** In place of a page that is not for everybody who looks on. */
export function NeedsSession({ name, what, model }: { name: string; what: string; model: Model }) {
  return (
    <main class="page"><section class="panel" aria-label={name}><h2>{name}</h2>
      {model.hello && <p>Open the link of <code>isorig web</code> to see {what}: in a terminal on the rig's machine, isorig web prints it.</p>}
    </section></main>
  );
}
