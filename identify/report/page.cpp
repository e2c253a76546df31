#include "identify/report/page.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include "base/text_file.hpp"

namespace isorig::identify::report {
namespace {

constexpr std::string_view kStyle = R"(
body{font:15px/1.5 system-ui,sans-serif;color:#1a1a1a;max-width:1180px;margin:2em auto;padding:0 1.2em}
h1{font-size:1.6em;margin-bottom:.2em}h2{font-size:1.25em;margin-top:2em;border-bottom:1px solid #ddd}
h3{font-size:1.05em;margin-bottom:.3em}
table{border-collapse:collapse;margin:.8em 0;font-size:13px;font-variant-numeric:tabular-nums}
caption{text-align:left;color:#444;padding-bottom:.3em}
th,td{padding:.22em .7em;border-bottom:1px solid #e6e6e6;text-align:left}td.n{text-align:right}
th{border-bottom:2px solid #999;vertical-align:bottom}
tr:hover td{background:#f6f8fa}
.note{background:#fff7e0;border-left:4px solid #e6a700;padding:.5em 1em;margin:1em 0}
figure{margin:1.2em 0}figure svg{max-width:100%;height:auto}figcaption{color:#444;font-size:13px;max-width:80ch}
.wide{overflow-x:auto}
)";

bool reads_as_number(std::string_view cell) {
  if (cell.empty()) return false;
  if (cell == "-") return true;
  return std::string_view("0123456789+-.").find(cell.front()) != std::string_view::npos &&
         cell.find_first_of("0123456789") != std::string_view::npos;
}

std::string inline_svg(const std::filesystem::path& file) {
  const std::string text = base::read_text_file(file);  // gnuplot wrote it
  const auto start = text.find("<svg");
  if (start == std::string::npos) throw std::runtime_error("no SVG in " + file.string());
  return text.substr(start);
}

}  // namespace

std::string escaped(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (char c : text) switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  return out;
}

std::string number_text(double value, int digits) {
  if (std::isnan(value)) return "-";
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.*g", digits, value);
  return text.data();
}

std::string interval_text(double value, double low, double high) {
  const double width = high - low;
  int digits = 3;
  if (std::isfinite(width) && width > 0.0 && value != 0.0)
    digits = std::clamp(static_cast<int>(std::ceil(std::log10(std::abs(value) / width))) + 2, 2, 7);
  auto end = [&](double v) { return std::isfinite(v) ? number_text(v, digits) : std::string(".."); };
  return number_text(value, digits) + " [" + end(low) + ", " + end(high) + "]";
}

void write_text_file(const std::filesystem::path& file, std::string_view text) {
  const std::filesystem::path aside = file.string() + ".part";
  std::ofstream out(aside, std::ios::binary);
  out.write(text.data(), static_cast<std::streamsize>(text.size()));
  out.close();
  if (!out) throw std::runtime_error("cannot write " + aside.string());
  std::filesystem::rename(aside, file);
}

Page::Page(std::string title) : title_(std::move(title)) {}

void Page::heading(std::string_view text) {
  blocks_.push_back({"<h2>" + escaped(text) + "</h2>\n"});
}
void Page::subheading(std::string_view text) {
  blocks_.push_back({"<h3>" + escaped(text) + "</h3>\n"});
}
void Page::paragraph(std::string_view text) {
  blocks_.push_back({"<p>" + escaped(text) + "</p>\n"});
}
void Page::note(std::string_view text) {
  blocks_.push_back({"<p class=\"note\">" + escaped(text) + "</p>\n"});
}

void Page::list(const std::vector<std::string>& items) {
  if (items.empty()) return;
  std::string html = "<ul>\n";
  for (const auto& item : items) html += "<li>" + escaped(item) + "</li>\n";
  blocks_.push_back({html + "</ul>\n"});
}

void Page::table(const std::vector<std::string>& header, const std::vector<std::vector<std::string>>& rows,
                 std::string_view caption) {
  std::string html = "<div class=\"wide\"><table>\n";
  if (!caption.empty()) html += "<caption>" + escaped(caption) + "</caption>\n";
  html += "<tr>";
  for (const auto& cell : header) html += "<th>" + escaped(cell) + "</th>";
  html += "</tr>\n";
  for (const auto& row : rows) {
    html += "<tr>";
    for (const auto& cell : row)
      html += (reads_as_number(cell) ? "<td class=\"n\">" : "<td>") + escaped(cell) + "</td>";
    html += "</tr>\n";
  }
  blocks_.push_back({html + "</table></div>\n"});
}

void Page::figure(Figure figure) {
  blocks_.push_back({{}, static_cast<int>(figures_.size())});
  figures_.push_back(std::move(figure));
}

void Page::write(const std::filesystem::path& folder, const DrawOptions& options, std::string_view file_name) const {
  std::filesystem::create_directories(folder);
  const auto drawn = folder / "figures";
  draw(figures_, drawn, options);
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width\">\n<title>" +
      escaped(title_) + "</title>\n<style>" + std::string(kStyle) + "</style></head><body>\n<h1>" + escaped(title_) +
      "</h1>\n";
  for (const Block& block : blocks_) {
    if (block.figure < 0) {
      html += block.html;
      continue;
    }
    const Figure& f = figures_[static_cast<std::size_t>(block.figure)];
    html += "<figure id=\"" + escaped(f.name) + "\">\n" + inline_svg(drawn / (f.name + ".svg")) + "<figcaption>" +
            escaped(f.caption) + "</figcaption></figure>\n";
  }
  write_text_file(folder / file_name, html + "</body></html>\n");
}

}  // namespace isorig::identify::report
