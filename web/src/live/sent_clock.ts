/** Clocks of two machines that nobody sets part by no more than this: 50 ppm of each quartz. Without an allowance a page that
 *  is open for a day may call every status 8 s old; with it, a queue of 10 s is seen as one for 22 hours. */
const DRIFT = 1e-4;

/** When messages of another clock were sent, by this page's own. The quickest so far counts as one that came at once: what
 *  came later by its clock has waited on the way. */
export class SentClock {
  private least_ms = Infinity;
  private heard_ms = 0;

  /** Of a message that the sender stamped with `sent_ms` and that is here at `now_ms`. */
  sentAt_ms(sent_ms: number, now_ms: number): number {
    this.least_ms = Math.min(now_ms - sent_ms, this.least_ms + DRIFT * (now_ms - this.heard_ms));
    this.heard_ms = now_ms;
    return sent_ms + this.least_ms;
  }
}
