/** What the server sends of the samples (docs/web.md, "Blocks"): lowest, highest and mean of each channel over stretches of
 *  a fixed grid, kept here in rings by the number of the stretch. */

export const STREAMS = { frame: 0, pressure: 1, control: 2, band: 3, twin: 4 } as const;
export const CHANNELS = [2, 1, 2, 2, 2] as const;
export const FINE = 0, COARSE = 1, ZOOM = 2;

export interface Block {
  stream: number;
  tier: number;
  /** Number of each stretch: it reaches from index * width to (index + 1) * width on the host's clock. */
  index: Float64Array;
  width_ns: number;
  /** Low, high, mean of each channel. */
  columns: Float32Array[];
}

const HEAD = 24;

/** All blocks of a message. Throws when it is none. */
export function blocks(buffer: ArrayBuffer): Block[] {
  const out: Block[] = [];
  const view = new DataView(buffer);
  let at = 0;
  while (at < buffer.byteLength) {
    if (at + HEAD > buffer.byteLength) throw new Error("a block of samples is cut short");
    const columns = view.getUint16(at + 2, true), count = view.getUint32(at + 4, true);
    const origin = view.getFloat64(at + 8, true), width_ns = view.getFloat64(at + 16, true);
    const end = at + HEAD + 4 * count * (1 + columns);
    if (end > buffer.byteLength) throw new Error("a block of samples is cut short");
    const offsets = new Uint32Array(buffer, at + HEAD, count);
    out.push({
      stream: view.getUint8(at),
      tier: view.getUint8(at + 1),
      index: Float64Array.from(offsets, (o) => origin + o),
      width_ns,
      columns: Array.from({ length: columns }, (_, c) => new Float32Array(buffer, at + HEAD + 4 * count * (1 + c), count)),
    });
    at = end;
  }
  return out;
}

/** Stretches joined to wider ones for the pixels of a plot. null: no sample, and the line has a gap. */
export interface Reduced {
  low: (number | null)[];
  high: (number | null)[];
  mean: (number | null)[];
}

/** Whole stretches side by side, aligned to the grid and not to the window: nothing flickers while it moves. */
export interface Grid {
  /** Stretches joined to one. */
  join: number;
  first: number;
  count: number;
}

export function grid(from_ns: number, to_ns: number, width_ns: number, pixels: number): Grid {
  const join = Math.max(1, Math.ceil((to_ns - from_ns) / width_ns / Math.max(1, pixels)));
  const first = Math.floor(from_ns / (join * width_ns));
  return { join, first, count: Math.max(1, Math.ceil(to_ns / (join * width_ns)) - first) };
}

export class StretchRing {
  readonly index: Float64Array;
  readonly columns: Float32Array[];
  newest = -Infinity;

  constructor(readonly size: number, channels: number) {
    this.index = new Float64Array(size).fill(NaN);
    this.columns = Array.from({ length: 3 * channels }, () => new Float32Array(size));
  }

  clear(): void {
    this.index.fill(NaN);
    this.newest = -Infinity;
  }

  put(block: Block): void {
    block.index.forEach((index, i) => {
      if (index <= this.newest - this.size) return;
      const at = ((index % this.size) + this.size) % this.size;
      if (this.index[at] as number > index) return;
      this.index[at] = index;
      block.columns.forEach((column, c) => ((this.columns[c] as Float32Array)[at] = column[i] as number));
      if (index > this.newest) this.newest = index;
    });
  }

  /** Where stretch `index` lies, -1 if it has no sample. */
  at(index: number): number {
    const at = ((index % this.size) + this.size) % this.size;
    return this.index[at] === index ? at : -1;
  }

  reduce(channel: number, g: Grid): Reduced {
    const [low, high, mean] = [0, 1, 2].map((c) => this.columns[3 * channel + c]) as [Float32Array, Float32Array, Float32Array];
    const out: Reduced = { low: [], high: [], mean: [] };
    for (let k = 0; k < g.count; ++k) {
      let least = Infinity, greatest = -Infinity, sum = 0, n = 0;
      for (let j = 0; j < g.join; ++j) {
        const at = this.at((g.first + k) * g.join + j);
        if (at < 0) continue;
        least = Math.min(least, low[at] as number);
        greatest = Math.max(greatest, high[at] as number);
        sum += mean[at] as number;
        ++n;
      }
      out.low.push(n ? least : null);
      out.high.push(n ? greatest : null);
      out.mean.push(n ? sum / n : null);
    }
    return out;
  }
}
