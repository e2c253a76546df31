// A picture of the live page as SVG, drawn from the page itself in Chromium: its boxes and words where they stand, and what it
// paints on its canvases, line by line. No pixels, so that it may stand in the tree.
// Usage: node web/picture.mjs BIN_FOLDER SOURCE_FOLDER OUT.svg [MODEL.toml for the twin]
import { copyFileSync, writeFileSync } from "node:fs";
import { basename, join } from "node:path";
import { withBrowser } from "./test/browser.mjs";
import { Rig, until } from "./test/rig.mjs";

const [bin, source, out, model] = process.argv.slice(2);
const WIDTH = 1180, HEIGHT = 1000;
if (!out) {
  console.error("usage: node web/picture.mjs BIN_FOLDER SOURCE_FOLDER OUT.svg [MODEL.toml]");
  process.exit(2);
}

/** In the page, before its script: every canvas remembers what is drawn on it since it was cleared, as SVG. */
function remember() {
  const r = (v) => String(Math.round(10 * v) / 10);
  const Native = globalThis.Path2D;
  globalThis.Path2D = class extends Native {
    constructor(from) {
      super(from);
      this.parts = from?.parts ? [...from.parts] : [];
    }
    moveTo(x, y) { super.moveTo(x, y); this.parts.push(["M", [x, y]]); }
    lineTo(x, y) { super.lineTo(x, y); this.parts.push(["L", [x, y]]); }
    rect(x, y, w, h) { super.rect(x, y, w, h); this.parts.push(["M", [x, y]], ["L", [x + w, y]], ["L", [x + w, y + h]], ["L", [x, y + h]], ["Z", []]); }
    closePath() { super.closePath(); this.parts.push(["Z", []]); }
  };
  /** A path that begins with a line begins where that ends; points on a level or a plumb line between two others are left out. */
  const text = (parts, m) => {
    const out = [];
    parts.forEach(([command, at], i) => {
      if (command === "Z" || command === "O") return out.push([command, at]);
      const x = r(m.a * at[0] + m.c * at[1] + m.e), y = r(m.b * at[0] + m.d * at[1] + m.f);
      const is = i === 0 || ["Z", "O"].includes(parts[i - 1][0]) ? "M" : command;
      const [a, b] = [out[out.length - 2], out[out.length - 1]];
      if (is === "L" && b?.[0] === "L" && a && !["Z", "O"].includes(a[0]) && ((a[1] === b[1] && b[1] === x) || (a[2] === b[2] && b[2] === y))) out.pop();
      out.push([is, x, y]);
    });
    return out.map(([command, x, y]) => (command === "Z" ? "Z" : command === "O" ? x : `${command}${x} ${y}`)).join("");
  };
  const C = CanvasRenderingContext2D.prototype;
  const state = new WeakMap();
  const of = (c) => {
    if (!state.has(c)) state.set(c, { items: [], defs: [], path: [], clip: null, saved: [] });
    return state.get(c);
  };
  globalThis.drawingOf = (canvas) => of(canvas.getContext("2d"));
  const wrap = (name, act) => {
    const native = C[name];
    C[name] = function (...given) {
      act.call(this, of(this), ...given);
      return native.apply(this, given);
    };
  };
  const put = (c, s, d, style) => {
    if (d === "" || /NaN/.test(d)) return;
    const all = `${style}${s.clip === null ? "" : ` clip-path="url(#@${s.clip})"`}${c.globalAlpha < 1 ? ` opacity="${c.globalAlpha}"` : ""}`;
    const last = s.items[s.items.length - 1];
    // Shapes of one colour are one, and the same one again is not drawn again.
    if (last?.style === all && last.parts) last.parts.add(d);
    else s.items.push({ style: all, ...(style.startsWith("fill=") ? { parts: new Set([d]) } : { d }) });
  };
  const stroke = (c) => {
    const k = c.getTransform().a;
    const dash = c.getLineDash().map((v) => r(v * k)).join(" ");
    return `fill="none" stroke="${c.strokeStyle}" stroke-width="${r(c.lineWidth * k)}"${dash ? ` stroke-dasharray="${dash}"` : ""}`;
  };
  wrap("clearRect", function (s, x, y, w, h) { if (w >= this.canvas.width - 1 && h >= this.canvas.height - 1) Object.assign(s, { items: [], defs: [] }); });
  wrap("save", function (s) { s.saved.push(s.clip); });
  wrap("restore", function (s) { if (s.saved.length) s.clip = s.saved.pop(); });
  wrap("beginPath", function (s) { s.path = []; });
  /** Where a point is when it is put into the path: the transform may change before the path is drawn. */
  const at = (c, x, y) => {
    const m = c.getTransform();
    return [m.a * x + m.c * y + m.e, m.b * x + m.d * y + m.f];
  };
  wrap("moveTo", function (s, x, y) { s.path.push(["M", at(this, x, y)]); });
  wrap("lineTo", function (s, x, y) { s.path.push(["L", at(this, x, y)]); });
  wrap("rect", function (s, x, y, w, h) {
    s.path.push(["M", at(this, x, y)], ["L", at(this, x + w, y)], ["L", at(this, x + w, y + h)], ["L", at(this, x, y + h)], ["Z", []]);
  });
  wrap("arc", function (s, x, y, radius, from, to) {
    const k = this.getTransform().a * radius, p = at(this, x, y);
    if (Math.abs(to - from) > 6.28) s.path.push(["O", `M${r(p[0] - k)} ${r(p[1])}a${r(k)} ${r(k)} 0 1 0 ${r(2 * k)} 0a${r(k)} ${r(k)} 0 1 0 ${r(-2 * k)} 0Z`]);
  });
  const given = (c, s, path) => (path?.parts ? text(path.parts, c.getTransform()) : text(s.path, { a: 1, b: 0, c: 0, d: 1, e: 0, f: 0 }));
  wrap("stroke", function (s, path) { put(this, s, given(this, s, path), stroke(this)); });
  wrap("fill", function (s, path) { put(this, s, given(this, s, path), `fill="${this.fillStyle}"`); });
  wrap("clip", function (s, path) { s.clip = s.defs.push({ d: given(this, s, path), within: s.clip }) - 1; });
  wrap("fillRect", function (s, x, y, w, h) {
    const m = this.getTransform();
    put(this, s, `M${r(m.a * x + m.e)} ${r(m.d * y + m.f)}h${r(m.a * w)}v${r(m.d * h)}h${r(-m.a * w)}Z`, `fill="${this.fillStyle}"`);
  });
  wrap("fillText", function (s, words, x, y) {
    if (words === "") return;
    const m = this.getTransform(), size = parseFloat(this.font);
    const anchor = { center: "middle", right: "end", end: "end" }[this.textAlign] ?? "start";
    const down = { top: 0.8, middle: 0.35, bottom: -0.2 }[this.textBaseline] ?? 0;
    const turn = Math.abs(m.b) > 1e-6 || Math.abs(m.c) > 1e-6 ? ` transform="matrix(${[m.a, m.b, m.c, m.d, m.e, m.f].map(r).join(" ")})"` : "";
    const p = turn ? [x, y] : [m.a * x + m.e, m.d * y + m.f];
    s.items.push({ text: words, style: `x="${r(p[0])}" y="${r(p[1] + down * size)}" font-size="${r(size)}" text-anchor="${anchor}" fill="${this.fillStyle}"${turn}` });
  });
}

/** In the page: what stands there, as one drawing. */
function draw(width) {
  const height = Math.ceil(document.querySelector(".strips").getBoundingClientRect().bottom) + 12;
  const r = (v) => String(Math.round(10 * v) / 10);
  const quoted = (t) => t.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/"/g, "&quot;");
  const parts = [], defs = [];
  let clips = 0;
  const clear = (c) => /^rgba\(.*, 0\)$|^transparent$/.test(c);
  const measure = document.createElement("canvas").getContext("2d");
  const box = (e, style, b) => {
    if (!clear(style.backgroundColor)) {
      parts.push(`<rect x="${r(b.left)}" y="${r(b.top)}" width="${r(b.width)}" height="${r(b.height)}" rx="${r(parseFloat(style.borderTopLeftRadius) || 0)}" fill="${style.backgroundColor}"/>`);
    }
    const sides = ["Top", "Right", "Bottom", "Left"].map((s) => ({ w: style[`border${s}Style`] === "none" ? 0 : parseFloat(style[`border${s}Width`]), c: style[`border${s}Color`], dash: style[`border${s}Style`] === "dashed" }));
    if (sides.every((s) => s.w === sides[0].w && s.c === sides[0].c)) {
      const w = sides[0].w;
      if (w > 0 && !clear(sides[0].c)) {
        parts.push(`<rect x="${r(b.left + w / 2)}" y="${r(b.top + w / 2)}" width="${r(b.width - w)}" height="${r(b.height - w)}" rx="${r(Math.max(0, (parseFloat(style.borderTopLeftRadius) || 0) - w / 2))}" fill="none" stroke="${sides[0].c}" stroke-width="${r(w)}"/>`);
      }
      return;
    }
    const lines = [[b.left, b.top, b.right, b.top, 0, 1], [b.right, b.top, b.right, b.bottom, -1, 0], [b.left, b.bottom, b.right, b.bottom, 0, -1], [b.left, b.top, b.left, b.bottom, 1, 0]];
    sides.forEach((s, i) => {
      if (s.w === 0 || clear(s.c)) return;
      const [x1, y1, x2, y2, dx, dy] = lines[i];
      const [ox, oy] = [(dx * s.w) / 2, (dy * s.w) / 2];
      parts.push(`<path d="M${r(x1 + ox)} ${r(y1 + oy)}L${r(x2 + ox)} ${r(y2 + oy)}" stroke="${s.c}" stroke-width="${r(s.w)}"${s.dash ? ' stroke-dasharray="4 3"' : ""}/>`);
    });
  };
  const words = (node, style) => {
    const size = parseFloat(style.fontSize);
    measure.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
    const m = measure.measureText("x");
    const range = document.createRange();
    const lines = [];
    // Word by word: a line ends where the next word stands lower.
    for (const found of node.data.matchAll(/\S+\s*/g)) {
      range.setStart(node, found.index);
      range.setEnd(node, found.index + found[0].trimEnd().length);
      const b = range.getBoundingClientRect();
      if (b.width === 0) continue;
      const last = lines[lines.length - 1];
      if (last && Math.abs(last.top - b.top) < 2) Object.assign(last, { text: `${last.text} ${found[0].trimEnd()}`, right: b.right });
      else lines.push({ text: found[0].trimEnd(), left: b.left, right: b.right, top: b.top, height: b.height });
    }
    for (const l of lines) {
      if (l.top > height) continue;
      const y = l.top + (l.height * m.fontBoundingBoxAscent) / (m.fontBoundingBoxAscent + m.fontBoundingBoxDescent);
      parts.push(`<text x="${r(l.left)}" y="${r(y)}" font-size="${r(size)}"${Number(style.fontWeight) > 500 ? ' font-weight="bold"' : ""} fill="${style.color}" textLength="${r(l.right - l.left)}" lengthAdjust="spacingAndGlyphs">${quoted(l.text)}</text>`);
    }
  };
  const canvas = (e, b) => {
    const d = globalThis.drawingOf(e), k = b.width / e.width, first = clips;
    for (const c of d.defs) defs.push(`<clipPath id="c${clips++}"${c.within === null ? "" : ` clip-path="url(#c${first + c.within})"`}><path d="${c.d}"/></clipPath>`);
    const body = d.items.map((i) => {
      const style = i.style.replace(/url\(#@(\d+)\)/, (_, n) => `url(#c${first + Number(n)})`);
      return i.text === undefined ? `<path ${style} d="${i.d ?? [...i.parts].join("")}"/>` : `<text ${style}>${quoted(i.text)}</text>`;
    }).join("");
    parts.push(`<g transform="translate(${r(b.left)} ${r(b.top)})${k === 1 ? "" : ` scale(${k})`}">${body}</g>`);
  };
  const svg = (e, b) => {
    const copy = e.cloneNode(true);
    const from = [e, ...e.querySelectorAll("*")], to = [copy, ...copy.querySelectorAll("*")];
    from.forEach((x, i) => {
      const s = getComputedStyle(x);
      to[i].setAttribute("fill", s.fill);
      if (s.stroke !== "none") to[i].setAttribute("stroke", s.stroke);
      to[i].removeAttribute("class");
    });
    copy.querySelectorAll("title").forEach((t) => t.remove());
    for (const [key, v] of [["x", b.left], ["y", b.top], ["width", b.width], ["height", b.height]]) copy.setAttribute(key, r(v));
    parts.push(new XMLSerializer().serializeToString(copy));
  };
  const walk = (e) => {
    const style = getComputedStyle(e);
    if (style.display === "none" || style.visibility === "hidden" || Number(style.opacity) === 0) return;
    const b = e.getBoundingClientRect();
    if (b.top > height || (b.width === 0 && e.childElementCount === 0)) return;
    const faded = Number(style.opacity) < 1;
    if (faded) parts.push(`<g opacity="${style.opacity}">`);
    const dom = e instanceof SVGElement ? null : e;
    if (dom && !(style.display === "inline" && clear(style.backgroundColor) && b.height > 60)) box(e, style, b);
    if (e instanceof HTMLMeterElement) {
      const share = (e.value - e.min) / (e.max - e.min), bar = (w, color) => `<rect x="${r(b.left)}" y="${r(b.top + b.height / 4)}" width="${r(w)}" height="${r(b.height / 2)}" rx="3" fill="${color}"/>`;
      parts.push(bar(b.width, "#d9dde3"), bar(b.width * share, share > e.high ? "#a81818" : "#00875f"));
    } else if (e instanceof HTMLCanvasElement) canvas(e, b);
    else if (e instanceof SVGSVGElement) svg(e, b);
    else for (const child of e.childNodes) child.nodeType === Node.TEXT_NODE ? words(child, style) : child.nodeType === Node.ELEMENT_NODE && walk(child);
    if (faded) parts.push("</g>");
  };
  walk(document.body);
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" font-family="system-ui, -apple-system, &quot;Segoe UI&quot;, &quot;Noto Sans&quot;, &quot;DejaVu Sans&quot;, sans-serif">` +
    `<title>The live page of a rig during a run</title><defs>${defs.join("")}</defs><rect width="100%" height="100%" fill="${getComputedStyle(document.body).backgroundColor}"/>${parts.join("\n")}</svg>\n`;
}

const rig = new Rig(bin, source);
try {
  if (model) copyFileSync(model, join(rig.models, basename(model)));
  rig.startDaemon();
  await rig.startWeb();
  await rig.reach("ready");
  await withBrowser(async (browser) => {
    const page = await browser.newPage();
    await page.setViewport({ width: WIDTH, height: HEIGHT });
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "light" }]);
    await page.evaluateOnNewDocument(remember);
    await page.goto(rig.call("web", "--name", "Ann"), { waitUntil: "load" });
    await page.waitForSelector(".frame[data-look=ready]", { timeout: 20_000 });
    const post = (call, body) => page.evaluate(async (c, b) => (await (await fetch(`/api/${c}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(b) })).json()).text, call, body);
    await post("lease", { action: "take" });
    if (model) await post("twin", { model_file: basename(model), on_parting: "mark" });
    await post("start", { operator: "Ann", specimen_file: "", protocol_from: "shipped", protocol_file: "vma-smoke.toml" });
    // Into the second repetition, when the loop has some strokes.
    await until("the second repetition", () => JSON.parse(rig.call("status", "--json")).run?.session === 1, 120);
    await until("a ramp", async () => /RUNNING · MOVING/.test(await page.$eval(".state", (e) => e.textContent)), 60);
    await new Promise((done) => setTimeout(done, 6500));
    const svg = await page.evaluate(draw, WIDTH);
    writeFileSync(out, svg);
    console.log(`${out}: ${(svg.length / 1024).toFixed(0)} KiB`);
  });
} catch (error) {
  console.error(rig.logs());
  console.error(error);
  process.exitCode = 1;
} finally {
  rig.end();
}
