import { render } from "preact";
import { parseDocument } from "./document.ts";
import { Page } from "./page.tsx";

const data = document.getElementById("data")?.textContent ?? "";
const root = document.getElementById("report") as HTMLElement;
try {
  render(<Page document={parseDocument(data)} />, root);
} catch (error) {
  root.textContent = (error as Error).message;
  throw error;
}
