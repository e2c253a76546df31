import { Component, type ComponentChildren } from "preact";

interface Props {
  /** What stands in it. */
  name: string;
  children: ComponentChildren;
}

/** What cannot be drawn takes nothing else with it: without this an error in one table would leave a page without Pause and
 *  Abort until it is loaded again. */
export class Boundary extends Component<Props, { wrong: string }> {
  override state = { wrong: "" };

  static override getDerivedStateFromError(error: unknown): { wrong: string } {
    return { wrong: (error as Error | null)?.message || String(error) };
  }

  override componentDidCatch(error: unknown): void {
    console.error(error);
  }

  override render() {
    const { name, children } = this.props, { wrong } = this.state;
    if (!wrong) return children;
    return (
      <section class="panel" aria-label={name}>
        <h2>{name}</h2>
        <p class="bad" role="alert">✕ This cannot be shown: {wrong}. Everything else on the page goes on.</p>
        <button type="button" onClick={() => this.setState({ wrong: "" })}>Try again</button>
      </section>
    );
  }
}
