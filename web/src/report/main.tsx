import { render } from "preact";
import { parseDocument } from "./document.ts";
import { Page } from "./page.tsx";
import { listFigures } from "./save.ts";

const data = document.getElementById("data")?.textContent ?? "";
const root = document.getElementById("report") as HTMLElement;
try {
  render(<Page document={parseDocument(data)} />, root);
  // `isorig figures` opens the page so, in a browser without a window, and reads what then stands there.
  if (location.hash === "#figures") setTimeout(listFigures, 500);
} catch (error) {
  root.textContent = (error as Error).message;
  throw error;
}
