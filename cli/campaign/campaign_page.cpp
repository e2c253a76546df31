#include "cli/campaign/campaign_page.hpp"

#include <cmath>
#include <limits>

#include "base/formatted.hpp"
#include "cli/campaign/row.hpp"
#include "identify/fv/fv_report.hpp"
#include "identify/report/neighbours.hpp"

namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
namespace pooling = identify::pooling;
using identify::report::GridCell;
using identify::report::Page;
using nlohmann::ordered_json;

constexpr std::size_t kMostRows = 2000;         // of the page: a browser lays them out in a second
constexpr std::size_t kMostCells = 400;         // specimens and pressures of the page's grid
constexpr std::size_t kMostInCell = 24;         // repetitions in one of its cells
constexpr std::size_t kMostNotAnswered = 2000;  // of the grid; each is a look at its recording.toml

/// Marks of a grid without a pool, each with its meaning; an effect's own letter is the pool's.
const GridCell kMissing{"M", 0, {}, "physics is missing"}, kNothing{"·", -1, {}, "nothing missing"},
    kUnknown{"?", 7, {}, "unknown physics"}, kUnjudged{"–", -1, {}, "cannot be judged"},
    kFitted{"0.9", -1, {}, "fitted, with the R² of the fit, cut to three decimals"},
    kNotFitted{"∅", 7, {}, "nothing could be fitted"};

/// The fit's R², or empty.
std::string r_squared_of(const ordered_json& row) {
  if (!row.contains("fit") || !row.at("fit").is_object()) return "";
  const ordered_json& fit = row.at("fit").at("fit");
  return fit.is_object() && fit.at("r_squared").is_number()
             ? identify::report::r_squared_text(fit.at("r_squared").get<double>())
             : "";
}

/// "0.8 [0.7, 0.9]"; what is known of it where it is not identifiable; empty where the fit has no such parameter.
std::string parameter_text(const ordered_json& row, const char* name) {
  if (!row.at("fit").is_object() || !row.at("fit").at("fit").is_object()) return "";
  const ordered_json& all = row.at("fit").at("fit").at("parameters");
  if (!all.contains(name)) return "";
  const ordered_json& one = all.at(name);
  const auto end = [&](std::size_t i, double open) {
    return one.at("ci95").at(i).is_number() ? one.at("ci95").at(i).get<double>() : open;
  };
  identify::FittedParameter parameter;
  parameter.name = name;
  parameter.value = one.at("value").is_number() ? one.at("value").get<double>() : std::nan("");
  parameter.low = end(0, -std::numeric_limits<double>::infinity());
  parameter.high = end(1, std::numeric_limits<double>::infinity());
  parameter.identifiable = one.at("identifiable");
  return identify::value_text(parameter);
}

/// The mark of a recording that was answered.
const GridCell& mark_of(const ordered_json& row) {
  const std::string verdict = row.at("verdict");
  if (verdict == "fitted") return kFitted;
  if (verdict == "nothing_fitted") return kNotFitted;
  if (verdict == "unknown_physics") return kUnknown;
  if (verdict == "cannot_judge") return kUnjudged;
  return row.at("missing").empty() ? kNothing : kMissing;
}

/// Three decimals, cut: 0.9996 is not 1.
std::string cut_r_squared(const ordered_json& row) {
  const ordered_json& value = row.at("fit").at("fit").at("r_squared");
  return value.is_number() ? base::formatted("%.3f", std::floor(1000.0 * value.get<double>()) / 1000.0) : "·";
}

std::string in_full(const ordered_json& row) {
  std::string out = short_name(row.at("recording").get<std::string>()) + ": ";
  if (!row.at("why").is_null()) return out + text_of(row.at("state")) + ": " + text_of(row.at("why"));
  if (!row.at("missing").empty()) return out + names_of_missing(row.at("missing"));
  const std::string r_squared = r_squared_of(row);
  return out + (text_of(row.at("verdict")).empty() ? text_of(row.at("state")) : text_of(row.at("verdict"))) +
         (r_squared.empty() ? "" : ", R² " + r_squared);
}

std::string counted(const Standing& s, const std::string& subjects) {
  return base::formatted("%zu of %zu %s answered, %zu of them unreadable; %zu failed, %zu waiting", s.made,
                         s.recordings, subjects.c_str(), s.bad, s.failed, s.waiting());
}

std::string subtitle_of(const Ask& ask) {
  if (ask.is_case()) return "`isorig diagnose` and `isorig predict` of each case of a study";
  return "isorig " + ask.command + " --model " + ask.model + (ask.control.empty() ? "" : " --control " + ask.control) +
         " of each recording";
}

}  // namespace

std::string short_name(const fs::path& recording) {
  return (recording.parent_path().filename() / recording.filename()).string();
}

std::string CampaignPage::page_of(const ordered_json& row) const {
  if (!row.at("page").is_null()) return row.at("page");
  if (row.at("folder").is_null()) return "";
  // What failed before its command began has no log.
  for (const char* file : {"/log.txt", "/failure.json"})
    if (const std::string there = row.at("folder").get<std::string>() + file; fs::exists(plan_.folder / there))
      return there;
  return "";
}

void CampaignPage::add(const ordered_json& row) {
  const std::string where = page_of(row);
  add_row(row, where);
  add_cell(row, where);
  if (row.contains("fit")) curves_.add(row);
}

void CampaignPage::add_row(const ordered_json& row, const std::string& where) {
  all_rows_ = all_rows_ && rows_.size() < kMostRows;
  if (!all_rows_) return;
  const std::string state = row.at("state");
  std::vector<std::string> cells{short_name(row.at("recording").get<std::string>()), text_of(row.at("specimen")),
                                 text_of(row.at("pressure_psi")), text_of(row.at("repetition")),
                                 state == "made"
                                     ? text_of(row.at("verdict"))
                                     : state + (row.at("why").is_null() ? "" : ": " + text_of(row.at("why")))};
  if (row.contains("fit")) {
    const bool there = row.at("fit").is_object();
    if (there && row.at("fit").at("refusal").is_string()) cells.back() += ": " + text_of(row.at("fit").at("refusal"));
    cells.push_back(there ? text_of(row.at("fit").at("model")) : "");
    cells.push_back(r_squared_of(row));
    for (const char* name : {"kappa", "gamma_per_s", "beta"}) cells.push_back(parameter_text(row, name));
  } else {
    cells.push_back(names_of_missing(row.at("missing")));
  }
  rows_.push_back(std::move(cells));
  hrefs_.push_back({where.empty() ? "" : identify::report::as_link(where)});
}

void CampaignPage::add_cell(const ordered_json& row, const std::string& where) {
  const std::string state = row.at("state");
  if (state != "made") {
    if (not_answered_.size() >= kMostNotAnswered) {
      all_cells_ = false;
      return;
    }
    // Of what has no piece nobody has noted the subject.
    const ordered_json subject =
        state == "bad_recording" ? row : subject_of(plan_.ask, row.at("recording").get<std::string>());
    if (!subject.at("specimen").is_string() || !subject.at("pressure_psi").is_number()) return;
    const auto why = state == "failed"          ? pooling::NoAnswer::kFailed
                     : state == "bad_recording" ? pooling::NoAnswer::kUnreadable
                                                : pooling::NoAnswer::kWaiting;
    not_answered_.push_back({subject.at("specimen"), subject.at("pressure_psi"), why, in_full(row), where});
    return;
  }
  if (!row.at("specimen").is_string() || !row.at("pressure_psi").is_number()) return;
  const auto key = std::tuple(row.at("specimen").get<std::string>(), row.at("pressure_psi").get<double>());
  const bool fresh = !cells_.contains(key);
  if ((fresh && cells_.size() >= kMostCells) || (!fresh && cells_[key].size() >= kMostInCell)) {
    all_cells_ = false;
    return;
  }
  GridCell cell = mark_of(row);
  if (cell.text == kFitted.text) cell.text = cut_r_squared(row);
  cell.title = in_full(row);
  cell.href = where;
  cells_[key].push_back(std::move(cell));
}

void CampaignPage::write_grid(Page& page) const {
  pooling::CampaignGrid grid("Each mark is a recording and leads to its own page, or to the log of what went wrong.");
  const bool fv = plan_.ask.command == "fv";
  for (const GridCell& mark :
       fv ? std::vector<GridCell>{kFitted, kNotFitted} : std::vector<GridCell>{kMissing, kNothing, kUnknown, kUnjudged})
    grid.key(mark);
  for (const auto& [key, cells] : cells_)
    for (const GridCell& cell : cells) grid.add(std::get<0>(key), std::get<1>(key), cell);
  for (const pooling::NotPooled& one : not_answered_) grid.add(one);
  if (grid.empty()) return;
  page.heading("Specimens and pressures");
  page.grid(grid.grid());
  if (!all_cells_) page.note("There are more recordings than this grid holds: campaign.csv has all.");
}

void CampaignPage::write_rows(Page& page, const Standing& standing, bool pooled) const {
  page.heading(pooled ? "All answers" : "Recordings");
  page.paragraph("Each name leads to the recording's own page, or to the log of what went wrong.");
  std::vector<std::string> header{"recording", "specimen", "pressure (psi)", "repetition", "verdict"};
  std::string caption;
  if (plan_.ask.command == "fv") {
    for (const char* name : {"model", "R²", "κ [95 %]", "γ (1/s) [95 %]", "β [95 %]"}) header.emplace_back(name);
    caption =
        "Controls: κ_c, γ_c. Sheaths: κ_s, γ_s, β_s with the control's held. Without brackets: not identifiable from "
        "these velocities, and this is all that is known (95 %).";
  } else {
    header.emplace_back("missing, with probability");
  }
  page.table(header, rows_, caption, hrefs_);
  if (!all_rows_)
    page.note(
        base::formatted("The first %zu of %zu recordings; campaign.csv has all.", kMostRows, standing.recordings));
}

void CampaignPage::write(const Standing& s, const Together& together, const identify::report::Made& made) const {
  Page page("Campaign", "Campaign: " + plan_.folder.filename().string());
  page.subtitle(subtitle_of(plan_.ask));
  const bool whole = s.failed == 0 && s.waiting() == 0;
  page.lead(!whole ? identify::report::Mood::kWarning : identify::report::Mood::kInfo,
            whole ? "complete" : "incomplete", counted(s, subjects_of(plan_.ask)) + ".");
  page.made(made);
  if (together.pooled) {
    page.link("pooled.json", "pooled.json");
    pooling::add_pooled_sections(page, *together.pooled, plan_.folder, not_answered_);
  } else if (!together.why.empty()) {
    page.note(together.why);
  }
  if (!together.pooled && !s.findings.empty()) page.list(s.findings);
  std::vector<std::vector<std::string>> verdicts;
  for (const auto& [verdict, count] : s.verdicts) verdicts.push_back({verdict, std::to_string(count)});
  page.heading("Verdicts");
  page.table({"verdict", "recordings"}, verdicts);
  if (!together.pooled && !plan_.ask.is_case()) write_grid(page);
  if (const auto figure = curves_.figure()) {
    page.heading("Force-velocity curves");
    page.figure(*figure);
  }
  write_rows(page, s, together.pooled.has_value());
  page.write(plan_.folder, "campaign-report.html");
}

}  // namespace isorig::cli::pieces
