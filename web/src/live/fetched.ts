import { useCallback, useEffect, useState } from "preact/hooks";

/** What the server answers to a GET; asked when the page is opened, and again when `again` is called. */
export interface Fetched<T> {
  value: T | null;
  /** What went wrong, for people. */
  wrong: string;
  busy: boolean;
  again: () => void;
}

/** A run's own page. The server has room for one at a time, and says when to ask again. */
export async function getReport(id: string, pause_ms = 1000, patience = 30): Promise<string> {
  for (let left = patience; ; --left) {
    const answer = await fetch(`/report/${id}`);
    const text = await answer.text();
    if (answer.ok) return text;
    if (answer.status !== 503 || left <= 1) throw new Error((JSON.parse(text) as { text: string }).text);
    await new Promise((done) => setTimeout(done, pause_ms));
  }
}

export async function getJson<T>(path: string): Promise<T> {
  const answer = await fetch(path);
  const body = (await answer.json()) as T & { text?: string };
  if (!answer.ok) throw new Error(body.text ?? `the server answered ${answer.status}`);
  return body;
}

export function useFetched<T>(path: string): Fetched<T> {
  const [state, set] = useState<{ value: T | null; wrong: string; busy: boolean }>({ value: null, wrong: "", busy: true });
  const [turn, setTurn] = useState(0);
  useEffect(() => {
    let gone = false;
    set((s) => ({ ...s, busy: true }));
    getJson<T>(path).then(
      (value) => !gone && set({ value, wrong: "", busy: false }),
      (error: Error) => !gone && set((s) => ({ ...s, wrong: error.message, busy: false })));
    return () => {
      gone = true;
    };
  }, [path, turn]);
  return { ...state, again: useCallback(() => setTurn((n) => n + 1), []) };
}
