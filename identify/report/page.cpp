#include "identify/report/page.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/formatted.hpp"
#include "base/number_text.hpp"
#include "base/utc_text.hpp"
#include "base/whole_file.hpp"
#include "identify/report/neighbours.hpp"
#include "identify/report/template.hpp"

namespace isorig::identify::report {
namespace {

using nlohmann::ordered_json;

const char* name_of(Mood mood) {
  switch (mood) {
    case Mood::kGood:
      return "good";
    case Mood::kInfo:
      return "info";
    case Mood::kWarning:
      return "warning";
    case Mood::kBad:
      return "bad";
  }
  return "";
}

/// A number, with its error or its interval: digits, signs, exponents, brackets and "..", and no word.
bool reads_as_number(std::string_view cell) {
  if (cell == "-" || cell == "–" || cell.empty()) return true;
  bool digit = false;
  for (std::size_t i = 0; i < cell.size(); ++i) {
    const auto c = static_cast<unsigned char>(cell[i]);
    if (std::isdigit(c) != 0) {
      digit = true;
    } else if (c == 'e') {
      if (i == 0 || std::isdigit(static_cast<unsigned char>(cell[i - 1])) == 0) return false;
    } else if (c < 0x80 && std::string_view(" +-.,[]<>%").find(cell[i]) == std::string_view::npos) {
      return false;
    } else if (c >= 0x80) {
      // The sign of "± 0.1", a minus or a space: any other character is a word's.
      bool known = false;
      for (const std::string_view sign : {"±", "−", " ", " ", "∞"})
        if (cell.substr(i).starts_with(sign)) {
          i += sign.size() - 1;
          known = true;
          break;
        }
      if (!known) return false;
    }
  }
  return digit;
}

/// Bytes of somebody's file name need not be UTF-8.
std::string dumped(const ordered_json& json) {
  return json.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace

struct Page::Content {
  ordered_json top{{"format", "isorig-report-data/1"}};
  std::vector<ordered_json> open{ordered_json::array()};  ///< blocks of the page, then of each "more" that is open
  std::vector<std::string> summaries;
  std::string title;
};

Page::Page(std::string_view kind, std::string_view title) : content_(std::make_unique<Content>()) {
  content_->title = title;
  content_->top["kind"] = kind;
  content_->top["title"] = title;
  content_->top["made"] = ordered_json::object();
}
Page::~Page() = default;

void Page::add(ordered_json block) {
  content_->open.back().push_back(std::move(block));
}

void Page::subtitle(std::string_view text) {
  content_->top["subtitle"] = text;
}
void Page::lead(Mood mood, std::string_view word, std::string_view text) {
  content_->top["lead"] = {{"mood", name_of(mood)}, {"word", word}, {"text", text}};
}
void Page::made(const Made& made) {
  ordered_json out = ordered_json::object();
  if (!made.command.empty()) out["command"] = made.command;
  if (!made.version.empty()) out["version"] = made.version;
  if (!made.undated) out["at_utc"] = made.at_utc.empty() ? now_utc() : made.at_utc;
  out["inputs"] = ordered_json::array();
  for (const auto& [name, what] : made.inputs) out["inputs"].push_back({{"name", name}, {"what", what}});
  content_->top["made"] = std::move(out);
  for (const auto& [text, href] : made.links) link(text, href);
}
void Page::link(std::string_view text, std::string_view href) {
  content_->top["links"].push_back({{"text", text}, {"href", href}});
}

void Page::heading(std::string_view text) {
  add({{"type", "heading"}, {"level", 2}, {"text", text}});
}
void Page::subheading(std::string_view text) {
  add({{"type", "heading"}, {"level", 3}, {"text", text}});
}
void Page::paragraph(std::string_view text) {
  add({{"type", "paragraph"}, {"text", text}});
}
void Page::note(std::string_view text, Mood mood) {
  add({{"type", "note"}, {"mood", name_of(mood)}, {"text", text}});
}
void Page::equation(std::string_view text) {
  add({{"type", "equation"}, {"text", text}});
}
void Page::code(std::string_view name, std::string_view text) {
  add({{"type", "code"}, {"name", name}, {"text", text}});
}
void Page::list(const std::vector<std::string>& items) {
  if (!items.empty()) add({{"type", "list"}, {"items", items}});
}
void Page::facts(const std::vector<Fact>& items) {
  ordered_json all = ordered_json::array();
  for (const Fact& fact : items) {
    all.push_back({{"name", fact.name}, {"value", fact.value}});
    if (!fact.note.empty()) all.back()["note"] = fact.note;
    if (fact.mood) all.back()["mood"] = name_of(*fact.mood);
  }
  add({{"type", "facts"}, {"items", std::move(all)}});
}

void Page::table(const std::vector<std::string>& header, const std::vector<std::vector<std::string>>& rows,
                 std::string_view caption, const std::vector<std::vector<std::string>>& hrefs) {
  ordered_json columns = ordered_json::array();
  for (std::size_t i = 0; i < header.size(); ++i) {
    bool any = false, numeric = true;
    for (const auto& row : rows) {
      if (i >= row.size() || row[i].empty()) continue;
      any = true;
      numeric = numeric && reads_as_number(row[i]);
    }
    columns.push_back({{"name", header[i]}});
    if (any && numeric) columns.back()["numeric"] = true;
  }
  add({{"type", "table"}, {"caption", caption}, {"columns", std::move(columns)}, {"rows", rows}});
  if (!hrefs.empty()) content_->open.back().back()["hrefs"] = hrefs;
}

void Page::grid(const Grid& grid) {
  const auto cell_json = [](const GridCell& cell) {
    ordered_json out{{"text", cell.text}, {"title", cell.title}};
    if (cell.color >= 0) out["color"] = cell.color;
    if (!cell.href.empty()) out["href"] = as_link(cell.href);
    return out;
  };
  ordered_json rows = ordered_json::array(), key = ordered_json::array();
  for (const Grid::Row& row : grid.rows) {
    ordered_json cells = ordered_json::array();
    for (const auto& place : row.cells) {
      cells.push_back(ordered_json::array());
      for (const GridCell& cell : place) cells.back().push_back(cell_json(cell));
    }
    rows.push_back({{"name", row.name}, {"cells", std::move(cells)}});
  }
  for (const GridCell& cell : grid.key) key.push_back(cell_json(cell));
  add({{"type", "grid"},
       {"caption", grid.caption},
       {"columns", grid.columns},
       {"rows", std::move(rows)},
       {"key", std::move(key)}});
}

void Page::figure(const Figure& figure) {
  add({{"type", "figure"}, {"figure", figure_json(figure)}});
}

void Page::begin_more(std::string_view summary) {
  content_->open.push_back(ordered_json::array());
  content_->summaries.emplace_back(summary);
}
void Page::end_more() {
  if (content_->summaries.empty()) throw std::logic_error("end_more() without begin_more()");
  ordered_json blocks = std::move(content_->open.back());
  content_->open.pop_back();
  add({{"type", "more"}, {"summary", content_->summaries.back()}, {"blocks", std::move(blocks)}});
  content_->summaries.pop_back();
}

ordered_json Page::json() const {
  if (!content_->summaries.empty()) throw std::logic_error("begin_more() without end_more()");
  ordered_json out = content_->top;
  out["blocks"] = content_->open.front();
  return out;
}

void Page::write(const std::filesystem::path& folder, std::string_view file_name) const {
  std::filesystem::create_directories(folder);
  ordered_json whole = json();
  std::vector<std::string> inputs;
  if (const auto made_from = whole["made"].find("inputs"); made_from != whole["made"].end())
    for (const auto& input : *made_from) inputs.push_back(input.at("what"));
  for (const RunOf& run : runs_of(inputs)) {
    const std::string where = run.folder.empty() ? "" : " (" + run.folder.string() + ")";
    whole["made"]["inputs"].push_back({{"name", "Recorded in run"}, {"what", run.id + where}});
  }
  for (const auto& [text, href] : neighbours(folder, file_name, inputs)) {
    const bool there =
        whole.contains("links") &&
        std::ranges::any_of(whole["links"], [&, &to = href](const auto& link) { return link.at("href") == to; });
    if (!there) whole["links"].push_back({{"text", text}, {"href", href}});
  }
  const std::string data = dumped(whole);
  std::string html;
  html.reserve(kTemplateHead.size() + kTemplateBody.size() + kTemplateTail.size() + data.size() + 256);
  html += kTemplateHead;
  html += escaped(content_->title);
  html += kTemplateBody;
  // "</script>" in a text would end the data; JSON has another way to write '<'.
  for (const char c : data) {
    if (c == '<')
      html += "\\u003c";
    else
      html += c;
  }
  html += kTemplateTail;
  base::write_whole_file(folder / file_name, html);
}

std::string now_utc() {
  return base::utc_text(std::time(nullptr), "%Y-%m-%d %H:%M UTC");
}

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
  return base::number_text(value, digits);
}

std::string interval_text(double value, double low, double high) {
  const double width = high - low;
  int digits = 3;
  if (std::isfinite(width) && width > 0.0 && value != 0.0)
    digits = std::clamp(static_cast<int>(std::ceil(std::log10(std::abs(value) / width))) + 2, 2, 7);
  auto end = [&](double v) { return std::isfinite(v) ? number_text(v, digits) : std::string(".."); };
  return number_text(value, digits) + " [" + end(low) + ", " + end(high) + "]";
}

std::string r_squared_text(double value) {
  if (!std::isfinite(value)) return "-";
  const double missing = 1.0 - value;
  if (missing < 1e-6) return "> 0.999999";
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(missing))) + 1, 3, 7);
  return base::formatted("%.*f", decimals, value);
}

}  // namespace isorig::identify::report
