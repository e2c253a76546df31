import type { Figure } from "../shared/figure.ts";

/** Figures and their numbers as files, made in the page itself: no server, no network. */

export function save(name: string, type: string, content: string | Blob): void {
  const blob = typeof content === "string" ? new Blob([content], { type }) : content;
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** The panels of a figure as one drawing, with every colour and font that the style sheet gives it written into it. */
export function svgText(panels: Element): string {
  const drawn = [...panels.querySelectorAll<SVGSVGElement>("svg.chart")];
  const origin = panels.getBoundingClientRect();
  const parts = drawn.map((svg) => {
    const copy = svg.cloneNode(true) as SVGSVGElement;
    const from = [svg, ...svg.querySelectorAll("*")], to = [copy, ...copy.querySelectorAll("*")];
    from.forEach((element, i) => {
      const style = getComputedStyle(element), target = to[i] as SVGElement;
      const outer = i > 0 && element.parentElement ? getComputedStyle(element.parentElement) : null;
      for (const name of ["fill", "stroke", "stroke-width", "stroke-opacity", "fill-opacity", "stroke-dasharray", "opacity",
        "font-family", "font-size", "font-weight", "text-anchor"]) {
        const value = style.getPropertyValue(name);
        // All but opacity are inherited in the drawing as they are in the page.
        if (name === "opacity" ? value === "1" : value === outer?.getPropertyValue(name)) target.removeAttribute(name);
        else target.setAttribute(name, value);
      }
      // A tenth of a pixel is below what 288 dots an inch show.
      const path = target.getAttribute("d");
      if (path) target.setAttribute("d", path.replace(/\d+\.\d+/g, (v) => String(Math.round(10 * Number(v)) / 10)));
      target.removeAttribute("class");
    });
    const at = svg.getBoundingClientRect();
    copy.setAttribute("x", String(Math.round(at.left - origin.left)));
    copy.setAttribute("y", String(Math.round(at.top - origin.top)));
    copy.setAttribute("width", String(Math.round(at.width)));
    copy.setAttribute("height", String(Math.round(at.height)));
    copy.removeAttribute("tabindex");
    return new XMLSerializer().serializeToString(copy);
  });
  const [w, h] = [Math.ceil(origin.width), Math.ceil(origin.height)];
  const ground = getComputedStyle(document.body).backgroundColor;
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${w}" height="${h}" viewBox="0 0 ${w} ${h}">` +
    `<rect width="100%" height="100%" fill="${ground}"/>${parts.join("")}</svg>`;
}

export function saveSvg(name: string, panels: Element | null): void {
  if (panels) save(`${name}.svg`, "image/svg+xml", svgText(panels));
}

/** Three times the size of the screen's: 288 dots an inch. */
export function savePng(name: string, panels: Element | null): void {
  if (!panels) return;
  const picture = new Image();
  picture.onload = () => {
    const canvas = document.createElement("canvas");
    canvas.width = 3 * picture.width;
    canvas.height = 3 * picture.height;
    canvas.getContext("2d")?.drawImage(picture, 0, 0, canvas.width, canvas.height);
    canvas.toBlob((blob) => blob && save(`${name}.png`, "image/png", blob), "image/png");
  };
  picture.src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(svgText(panels));
}

/** In place of the page, all its figures as JSON. */
export function listFigures(): void {
  for (const fold of document.querySelectorAll("details")) if (fold.querySelector("figure")) fold.open = true;
  // Time, not frames: a browser without a window may draw none. By then what was unfolded has its size.
  setTimeout(() => {
    const all = [...document.querySelectorAll("figure")].flatMap((figure) => {
      const panels = figure.querySelector(".panels");
      if (!panels) return [];
      const { width, height } = panels.getBoundingClientRect();
      return [{ name: figure.id, width: Math.ceil(width), height: Math.ceil(height), svg: svgText(panels) }];
    });
    const list = document.createElement("pre");
    list.id = "figures";
    list.textContent = JSON.stringify(all);
    document.body.replaceChildren(list);
  }, 500);
}

/** One row a point: panel, series, x, y, other edge of a band, what its bar reaches above and below it. */
export function valuesCsv(figure: Figure): string {
  const quoted = (text: string) => `"${text.replace(/"/g, '""')}"`;
  const lines = ["panel,series,x,y,y2,error,error_below"];
  figure.panels.forEach((panel, k) => {
    for (const s of panel.series)
      s.x.forEach((x, i) => {
        const cells = [x, s.y[i], s.y2?.[i], s.error?.[i], s.error_below?.[i] ?? s.error?.[i]].map((v) => (v === null || v === undefined ? "" : String(v)));
        lines.push([quoted(panel.title ?? String(k + 1)), quoted(s.label ?? ""), ...cells].join(","));
      });
  });
  return lines.join("\n") + "\n";
}
