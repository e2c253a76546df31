/** Numbers, units and times as people read them. A minus is U+2212, a space before a unit is narrow and does not break. */

const MINUS = "\u2212";
const NARROW = "\u202f";
const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/** `value` with so many significant digits: "0.01234", "1.2×10⁻⁷"; "–" for what is no number. */
export function number(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : MINUS + "∞";
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(Number(value.toPrecision(digits)))));
  if (magnitude < -4 || magnitude >= 7) {
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e") as [string, string];
    return `${tidy(mantissa)}×10${superscript(Number(exponent))}`;
  }
  return tidy(value.toFixed(Math.min(20, Math.max(0, digits - 1 - magnitude))));
}

/** Zeros at the end of a fraction say how well a number is known only where somebody counted them: here nobody did. */
function tidy(text: string): string {
  const short = text.includes(".") ? text.replace(/0+$/, "").replace(/\.$/, "") : text;
  return short.startsWith("-") ? MINUS + short.slice(1) : short;
}

function superscript(exponent: number): string {
  const digits = [...String(Math.abs(exponent))].map((d) => SUPERSCRIPTS[Number(d)] ?? d).join("");
  return (exponent < 0 ? "⁻" : "") + digits;
}

/** "1.234 N"; a per cent sign and a degree stand close. */
export function quantity(value: number | null | undefined, unit: string, digits = 4): string {
  const text = number(value, digits);
  return unit === "" || text === "–" ? text : text + NARROW + unit;
}

/** With as many digits as the width of the interval allows: "1.23 [1.10, 1.36]". */
export function interval(value: number, low: number, high: number): string {
  const digits = digitsOf(value, high - low);
  const end = (v: number) => (Number.isFinite(v) ? number(v, digits) : "…");
  return `${number(value, digits)} [${end(low)}, ${end(high)}]`;
}

/** Significant digits of `value` when it is known to about `width`. */
export function digitsOf(value: number, width: number): number {
  if (!Number.isFinite(width) || width <= 0 || value === 0) return 3;
  return Math.min(7, Math.max(2, Math.ceil(Math.log10(Math.abs(value) / width)) + 2));
}

/** "850 ms", "12.3 s", "4 min 10 s", "2 h 05 min", "3 d 4 h". */
export function duration(seconds: number): string {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 0) return MINUS + duration(-seconds);
  if (seconds > 0 && seconds < 1) return quantity(seconds * 1000, "ms", 3);
  if (seconds < 60) return quantity(seconds, "s", 3);
  const whole = Math.round(seconds);
  const [d, h, min, s] = [Math.floor(whole / 86400), Math.floor(whole / 3600) % 24, Math.floor(whole / 60) % 60, whole % 60];
  if (d > 0) return `${d}${NARROW}d ${h}${NARROW}h`;
  if (h > 0) return `${h}${NARROW}h ${String(min).padStart(2, "0")}${NARROW}min`;
  return s > 0 ? `${min}${NARROW}min ${s}${NARROW}s` : `${min}${NARROW}min`;
}

/** Axis label in the field's manner: "force (N)". */
export function axisLabel(name: string, unit: string): string {
  return unit === "" ? name : `${name} (${unit})`;
}
