import { render } from "preact";
import { connect, Model } from "./model.ts";
import { Page } from "./page.tsx";
import { openReport } from "./report_link.ts";

addEventListener("hashchange", openReport);
if (!openReport()) {
  const model = new Model();
  render(<Page model={model} />, document.getElementById("page") as HTMLElement);
  connect(model);
}
