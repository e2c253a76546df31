import { localDay, localTime, zone } from "./words.ts";

/** A moment in the page's zone, whose name stands in the table's head; in UTC when the mouse rests on it. */
export function Moment({ utc, digits = 0, day = false }: { utc: string | Date; digits?: number; day?: boolean }) {
  const moment = new Date(utc);
  if (Number.isNaN(moment.getTime())) return <>–</>;
  const iso = moment.toISOString();
  return <time dateTime={iso} title={`${iso.slice(0, digits > 0 ? 23 : 19).replace("T", " ")} UTC`}>{day ? localDay(moment) : localTime(moment, digits)}</time>;
}

/** Behind the name of a column or a list with times. */
export function Zone() {
  return <small class="zone"> {zone()}</small>;
}
