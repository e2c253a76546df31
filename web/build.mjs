// Bundles the front end into --out: report.html, the template of every report, and report_template.cpp, which holds it;
// page_assets.cpp, the live page with its script and style.
// Usage: node web/build.mjs --out FOLDER
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const at = process.argv.indexOf("--out");
if (at < 0 || !process.argv[at + 1]) {
  console.error("usage: node web/build.mjs --out FOLDER");
  process.exit(2);
}
const out = process.argv[at + 1];

/** Two years of browsers. */
const target = ["chrome109", "firefox115", "safari16"];

/** The text of one bundled entry. */
async function bundled(entry) {
  const made = await build({
    entryPoints: [join(here, entry)],
    bundle: true, minify: true, write: false, format: "iife", target, charset: "utf8", legalComments: "none",
    jsx: "automatic", jsxImportSource: "preact", logLevel: "warning",
  });
  return made.outputFiles[0].text.trim();
}

/** As C++ string literals, in pieces: a compiler does not take any length in one. */
function cppLiteral(text) {
  const escapes = { "\\": "\\\\", "\"": "\\\"", "\n": "\\n", "?": "\\?" };
  const lines = [];
  let line = "";
  for (const c of text) {  // by code points: none is cut in two
    const code = c.codePointAt(0);
    line += escapes[c] ?? (code < 0x20 ? "\\" + code.toString(8).padStart(3, "0") : c);
    if (line.length > 1500) {
      lines.push(line);
      line = "";
    }
  }
  return [...lines, line].map((l) => `    "${l}"`).join("\n");
}

const script = await bundled("src/report/main.tsx");
const style = await bundled("src/report/report.css");
for (const end of ["</script", "<!--"]) {
  if (script.toLowerCase().includes(end)) throw new Error(`the script holds ${end}, which would end it`);
}
const hash = createHash("sha256").update(script).digest("base64");
const policy = `default-src 'none'; script-src 'sha256-${hash}'; style-src 'unsafe-inline'; img-src data: blob:; ` +
  "base-uri 'none'; form-action 'none'";
const template = readFileSync(join(here, "src/report/report.html"), "utf8")
  .replace("@CSP@", () => policy).replace("@STYLE@", () => style).replace("@SCRIPT@", () => script);
const [head, rest] = template.split("@TITLE@");
const [body, tail] = rest.split("@DATA@");
mkdirSync(out, { recursive: true });
writeFileSync(join(out, "report_template.cpp"), `// Made by web/build.mjs.
#include "identify/report/template.hpp"

namespace isorig::identify::report {

const std::string_view kTemplateHead =
${cppLiteral(head)};
const std::string_view kTemplateBody =
${cppLiteral(body)};
const std::string_view kTemplateTail =
${cppLiteral(tail)};

}  // namespace isorig::identify::report
`);
writeFileSync(join(out, "report.html"), template);

// The live page: three files, since its policy allows nothing inline.
const page = {
  kPageHtml: readFileSync(join(here, "src/live/live.html"), "utf8"),
  kPageScript: await bundled("src/live/main.tsx"),
  kPageStyle: await bundled("src/live/live.css"),
};
writeFileSync(join(out, "page_assets.cpp"), `// Made by web/build.mjs.
#include "webserver/assets.hpp"

namespace isorig::web {

${Object.entries(page).map(([name, text]) => `const std::string_view ${name} =\n${cppLiteral(text)};`).join("\n")}

}  // namespace isorig::web
`);
