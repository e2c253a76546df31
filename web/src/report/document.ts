import type { Figure } from "../shared/figure.ts";

/** The JSON that identify/report/page.cpp writes and this template shows: isorig-report-data/1. */

export type Mood = "good" | "info" | "warning" | "bad";

export interface Column {
  name: string;
  numeric?: boolean;
}

export interface Fact {
  name: string;
  value: string;
  note?: string;
  mood?: Mood;
}

/** A letter, a colour of the palette, where it leads, and what it says in full. */
export interface GridCell {
  text: string;
  title: string;
  color?: number;
  href?: string;
}

export interface Grid {
  caption: string;
  columns: string[];
  /** Of each row a list of cells for each column. */
  rows: { name: string; cells: GridCell[][] }[];
  key: GridCell[];
}

export type Block =
  | { type: "heading"; text: string; level: 2 | 3 }
  | { type: "paragraph"; text: string }
  | { type: "note"; text: string; mood: Mood }
  | { type: "equation"; text: string }
  | { type: "code"; name: string; text: string }
  | { type: "list"; items: string[] }
  | { type: "facts"; items: Fact[] }
  | ({ type: "grid" } & Grid)
  | { type: "table"; caption: string; columns: Column[]; rows: string[][]; hrefs?: string[][] }
  | { type: "figure"; figure: Figure }
  | { type: "more"; summary: string; blocks: Block[] };

export interface Document {
  format: string;
  kind: string;
  title: string;
  subtitle?: string;
  lead?: { text: string; mood: Mood; word: string };
  /** By which command, version and inputs. */
  made: { command?: string; version?: string; at_utc?: string; inputs?: { name: string; what: string }[] };
  links?: { text: string; href: string }[];
  blocks: Block[];
}

const kFormat = "isorig-report-data/1";

/** Says what is wrong instead of showing half of it. */
export function parseDocument(text: string): Document {
  let made: unknown;
  try {
    made = JSON.parse(text);
  } catch (error) {
    throw new Error(`The data of this report cannot be read: ${(error as Error).message}`);
  }
  const document = made as Document;
  if (document === null || typeof document !== "object" || document.format !== kFormat) {
    throw new Error(`The data of this report are not of the format ${kFormat}`);
  }
  if (!Array.isArray(document.blocks)) throw new Error("The data of this report have no blocks");
  return document;
}
