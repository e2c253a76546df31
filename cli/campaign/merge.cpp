#include "cli/campaign/merge.hpp"

#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "base/formatted.hpp"
#include "base/number_text.hpp"
#include "base/text_file.hpp"
#include "cli/campaign/piece.hpp"
#include "identify/pooling/pool.hpp"
#include "identify/report/neighbours.hpp"

namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr std::size_t kMostRows = 2000;      // of the page: a browser lays them out in a second
constexpr std::size_t kMostCells = 400;      // specimens and pressures of the page's first table
constexpr std::size_t kMostInCell = 24;      // repetitions in one of its cells
constexpr std::size_t kMostPooled = 10'000;  // diagnoses in memory at once, some kB each

std::string text_of(const ordered_json& value) {
  if (value.is_null()) return "";
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number_integer()) return std::to_string(value.get<long long>());
  return base::number_text(value.get<double>(), 15);
}

/// RFC 4180.
std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

/// Repetitions of all specimens are called alike: the folder that a recording lies in tells them apart.
std::string short_name(const fs::path& recording) {
  return (recording.parent_path().filename() / recording.filename()).string();
}

/// "coulomb_friction 0.98; slack 0.91"
std::string names_of(const ordered_json& missing) {
  std::string out;
  for (const auto& one : missing)
    out += (out.empty() ? "" : "; ") + one.at("effect").get<std::string>() + " " +
           base::formatted("%.2f", one.at("probability").get<double>());
  return out;
}

/// What the pieces of this campaign are made with. Where the model is gone nothing that is there is of it.
ordered_json stamp_now(const Ask& ask) {
  try {
    return stamp_of(ask);
  } catch (const base::FileError&) {
    return {{"command", ask.command}, {"model", ask.model}, {"model_sha256", nullptr}};
  }
}

/// What is known of a recording now. A piece that another model, question or program made is none of this campaign's: a
/// call that was interrupted leaves such, and the next one makes them anew.
ordered_json row_of(const Plan& plan, const ordered_json& ask, const std::string& recording) {
  ordered_json out{{"recording", recording}, {"specimen", nullptr},  {"pressure_psi", nullptr},
                   {"repetition", nullptr},  {"verdict", ""},        {"missing", ordered_json::array()},
                   {"state", "waiting"},     {"exit_code", nullptr}, {"why", nullptr},
                   {"folder", nullptr},      {"page", nullptr}};
  const fs::path piece = piece_folder(plan, recording), failed = failed_folder(plan, recording);
  try {
    ordered_json json;
    if (fs::exists(piece / "piece.json")) json = ordered_json::parse(base::read_text_file(piece / "piece.json"));
    if (!json.is_null() && json.at("stamp").at("ask") == ask && json.at("stamp").at("program") == plan.program) {
      const ordered_json& row = json.at("row");
      for (const char* key : {"specimen", "pressure_psi", "repetition", "verdict", "missing"}) out[key] = row.at(key);
      const int code = json.at("exit_code");
      out["state"] = row.at("verdict") == "bad_recording" ? "bad_recording" : "made";
      out["exit_code"] = code;
      out["folder"] = piece.lexically_relative(plan.folder).string();
      if (row.at("page").is_string())
        out["page"] = (piece.lexically_relative(plan.folder) / row.at("page").get<std::string>()).string();
    } else if (fs::exists(failed / "failure.json")) {
      json = ordered_json::parse(base::read_text_file(failed / "failure.json"));
      out["state"] = "failed";
      out["why"] = json.at("why");
      out["folder"] = failed.lexically_relative(plan.folder).string();
    }
  } catch (const std::exception& e) {
    out["state"] = "failed";
    out["why"] = e.what();
  }
  return out;
}

/// A text file that appears whole.
class Appearing {
 public:
  explicit Appearing(fs::path file) : file_(std::move(file)), out_(aside(), std::ios::binary) {}
  std::ofstream& out() { return out_; }
  void finish() {
    out_.close();
    if (!out_) throw std::runtime_error("cannot write " + file_.string() + "; is there room, and may you write there?");
    fs::rename(aside(), file_);
  }

 private:
  [[nodiscard]] fs::path aside() const { return file_.string() + ".part"; }
  fs::path file_;
  std::ofstream out_;
};

/// What the page shows, of bounded size.
struct PageRows {
  fs::path folder;  ///< of the campaign
  std::vector<std::vector<std::string>> rows, hrefs;
  std::map<std::tuple<std::string, double>, std::vector<std::string>> cells;
  bool all_rows = true, all_cells = true;

  void add(const ordered_json& row) {
    std::string where;
    if (!row["page"].is_null()) {
      where = row["page"].get<std::string>();
    } else if (!row["folder"].is_null()) {
      // What failed before its command began has no log.
      for (const char* file : {"/log.txt", "/failure.json"})
        if (where.empty() && fs::exists(folder / (row["folder"].get<std::string>() + file)))
          where = row["folder"].get<std::string>() + file;
    }
    all_rows = all_rows && rows.size() < kMostRows;
    if (all_rows) {
      const std::string state = row["state"];
      rows.push_back(
          {short_name(row["recording"].get<std::string>()), text_of(row["specimen"]), text_of(row["pressure_psi"]),
           text_of(row["repetition"]),
           state == "made" ? text_of(row["verdict"]) : state + (row["why"].is_null() ? "" : ": " + text_of(row["why"])),
           names_of(row["missing"])});
      hrefs.push_back({where.empty() ? "" : identify::report::as_link(where)});
    }
    if (!row["specimen"].is_string() || !row["pressure_psi"].is_number()) return;
    const auto key = std::tuple(row["specimen"].get<std::string>(), row["pressure_psi"].get<double>());
    if (!cells.contains(key) && cells.size() >= kMostCells) {
      all_cells = false;
      return;
    }
    auto& names = cells[key];
    const std::string found = row["missing"].empty() ? text_of(row["verdict"]) : names_of(row["missing"]);
    if (names.size() < kMostInCell) names.push_back(found);
  }
};

/// What the diagnoses say together, or why they cannot be put together.
struct Together {
  std::optional<identify::pooling::PooledCampaign> pooled;
  std::string why;
};

Together pooled_of(const std::vector<identify::pooling::Source>& diagnoses, bool all) {
  if (!all)
    return {{},
            base::formatted("There are more than %zu diagnoses, too many to pool at once: `isorig pool` takes the "
                            "folders of one kind of actuator",
                            kMostPooled)};
  try {
    return {identify::pooling::pool(diagnoses), ""};
  } catch (const identify::pooling::PoolError& e) {
    return {{}, std::string("The diagnoses were not pooled: ") + e.what()};
  }
}

std::string counted(const Standing& s, const std::string& subjects) {
  return base::formatted("%zu of %zu %s answered, %zu of them unreadable; %zu failed, %zu waiting", s.made,
                         s.recordings, subjects.c_str(), s.bad, s.failed, s.waiting());
}

std::string subtitle_of(const Ask& ask) {
  if (ask.is_case()) return "`isorig diagnose` and `isorig predict` of each case of a study";
  return "isorig " + ask.command + " --model " + ask.model + " of each recording";
}

void write_page(const Plan& plan, const Standing& s, const PageRows& shown, const Together& together,
                const identify::report::Made& made) {
  identify::report::Page page("Campaign", "Campaign: " + plan.folder.filename().string());
  page.subtitle(subtitle_of(plan.ask));
  const bool whole = s.failed == 0 && s.waiting() == 0;
  page.lead(!whole ? identify::report::Mood::kWarning : identify::report::Mood::kInfo,
            whole ? "complete" : "incomplete", counted(s, subjects_of(plan.ask)) + ".");
  page.made(made);
  if (together.pooled) {
    page.link("pooled.json", "pooled.json");
    identify::pooling::add_pooled_sections(page, *together.pooled, plan.folder);
  } else if (!together.why.empty()) {
    page.note(together.why);
  }
  std::vector<std::vector<std::string>> verdicts;
  for (const auto& [verdict, count] : s.verdicts) verdicts.push_back({verdict, std::to_string(count)});
  page.heading("Verdicts");
  page.table({"verdict", "recordings"}, verdicts);
  if (!together.pooled && !shown.cells.empty() && !plan.ask.is_case()) {
    page.heading("Specimens and pressures");
    std::vector<std::vector<std::string>> rows;
    for (const auto& [key, found] : shown.cells) {
      std::map<std::string, std::size_t> counts;
      for (const auto& one : found) ++counts[one];
      std::string text;
      for (const auto& [what, count] : counts)
        text += (text.empty() ? "" : ", ") + std::to_string(count) + " × " + what;
      rows.push_back({std::get<0>(key), base::number_text(std::get<1>(key), 6), std::to_string(found.size()), text});
    }
    page.table({"specimen", "pressure (psi)", "recordings", "found"}, rows);
    if (!shown.all_cells)
      page.note("There are more specimens and pressures than this page holds: campaign.csv has all.");
  }
  page.heading(together.pooled ? "All answers" : "Recordings");
  page.paragraph("Each name leads to the recording's own page, or to the log of what went wrong.");
  page.table({"recording", "specimen", "pressure (psi)", "repetition", "verdict", "missing, with probability"},
             shown.rows, {}, shown.hrefs);
  if (!shown.all_rows)
    page.note(base::formatted("The first %zu of %zu recordings; campaign.csv has all.", kMostRows, s.recordings));
  page.write(plan.folder, "campaign-report.html");
}

}  // namespace

Standing merge(const Plan& plan, const identify::report::Made* made) {
  Standing s;
  PageRows shown;
  shown.folder = plan.folder;
  std::vector<identify::pooling::Source> diagnoses;
  bool all_diagnoses = true;
  Appearing csv(plan.folder / "campaign.csv"), json(plan.folder / "campaign.json");
  const ordered_json ask = stamp_now(plan.ask);
  const ordered_json head{{"format", "isorig-campaign-pieces/1"}, {"ask", ask}, {"program", plan.program}};
  std::string opening = head.dump(2);
  opening.resize(opening.size() - 2);  // the brace and its line
  json.out() << opening << ",\n  \"recordings\": [";
  csv.out() << "recording,specimen,pressure_psi,repetition,verdict,missing,state,exit_code,why,folder,page\n";
  for_each_line(recordings_of(plan), [&](const std::string& recording) {
    const ordered_json row = row_of(plan, ask, recording);
    const std::string state = row["state"];
    ++s.recordings;
    if (state == "made" || state == "bad_recording") {
      ++s.made;
      ++s.verdicts[row["verdict"].get<std::string>()];
    }
    if (state == "bad_recording") ++s.bad;
    if (state == "failed") ++s.failed;
    std::string line;
    for (const auto& [key, value] : row.items())
      line += (key == "recording" ? "" : ",") + csv_cell(key == "missing" ? names_of(value) : text_of(value));
    csv.out() << line << '\n';
    json.out() << (s.recordings == 1 ? "\n    " : ",\n    ")
               << row.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
    if (made == nullptr) return;
    shown.add(row);
    if (plan.ask.command != "diagnose" || state != "made") return;
    all_diagnoses = all_diagnoses && diagnoses.size() < kMostPooled;
    if (all_diagnoses) diagnoses.push_back({piece_folder(plan, recording)});
  });
  json.out() << "\n  ]\n}\n";
  csv.finish();
  json.finish();
  fs::remove(plan.folder / "pooled.json");
  if (made == nullptr) return s;
  Together together;
  if (diagnoses.size() > 1) together = pooled_of(diagnoses, all_diagnoses);
  if (together.pooled) {
    s.findings = together.pooled->findings;
    Appearing pooled(plan.folder / "pooled.json");
    pooled.out() << identify::pooling::pooled_json(*together.pooled, plan.folder).dump(1) << '\n';
    pooled.finish();
  }
  write_page(plan, s, shown, together, *made);
  return s;
}

}  // namespace isorig::cli::pieces
