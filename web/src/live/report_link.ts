/** Reports are shown in an origin of their own, and the session's cookie goes with no link of another origin: a link in a report
 *  is led here by the server (webserver/http_session.cpp), as `/#/page/PATH`, and opened again as this site's own. */

const PREFIX = "#/page/";
const TRIED = "report-tried";
/** Within so long the same report is not asked for again: the server led here twice, since there is no session. */
const SOON_MS = 10_000;

/** The address of a report on this server, as the server takes them (webserver/rules/requests.cpp); null of anything else. */
export function reportIn(hash: string): string | null {
  if (!hash.startsWith(PREFIX)) return null;
  const path = hash.slice(1);
  return /^[A-Za-z0-9/._~%-]+\.html$/.test(path) && !path.includes("//") && !/\/\.\.?\//.test(path) ? path : null;
}

/** The address of the report whose file is `path`. */
export function reportAt(path: string): string {
  return "/page" + path.split("/").map((part) => encodeURIComponent(part).replace(/[!'()*]/g, (c) => `%${c.charCodeAt(0).toString(16).toUpperCase()}`)).join("/");
}

/** Whether to lead on to `report`; of the second time in a row it is no. */
export function leadsOn(report: string, memory: Pick<Storage, "getItem" | "setItem" | "removeItem">, now_ms: number): boolean {
  const mine = `${report} `, tried = memory.getItem(TRIED) ?? "";
  const again = tried.startsWith(mine) && now_ms - Number(tried.slice(mine.length)) < SOON_MS;
  if (again) memory.removeItem(TRIED);
  else memory.setItem(TRIED, mine + now_ms);
  return !again;
}

/** True: the browser is on its way to a report. */
export function openReport(): boolean {
  const report = reportIn(location.hash);
  if (report === null || !leadsOn(report, sessionStorage, Date.now())) return false;
  location.replace(report);
  return true;
}
