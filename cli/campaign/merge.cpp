#include "cli/campaign/merge.hpp"

#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "base/formatted.hpp"
#include "base/number_text.hpp"
#include "base/text_file.hpp"
#include "cli/campaign/campaign_page.hpp"
#include "cli/campaign/piece.hpp"
#include "cli/campaign/row.hpp"
#include "identify/pooling/pool.hpp"

namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr std::size_t kMostPooled = 10'000;  // diagnoses in memory at once, some kB each
constexpr std::size_t kLookEach = 64;        // rows between two looks at the stop: some 10 ms on a local disk

/// Thrown through a merge that is stopped.
struct Stopped {};

/// What the pieces of this campaign are made with. Where the model is gone nothing that is there is of it.
ordered_json stamp_now(const Ask& ask) {
  try {
    return stamp_of(ask);
  } catch (const base::FileError&) {
    return {{"command", ask.command}, {"model", ask.model}, {"model_sha256", nullptr}};
  }
}

/// A text file that appears whole, or not at all.
class Appearing {
 public:
  explicit Appearing(fs::path file) : file_(std::move(file)), out_(aside(), std::ios::binary) {}
  ~Appearing() {
    std::error_code none;
    fs::remove(aside(), none);
  }
  Appearing(const Appearing&) = delete;
  Appearing& operator=(const Appearing&) = delete;
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

void look(const Watching& watching, double fraction, const std::string& doing) {
  if (watching.stop && watching.stop()) throw Stopped();
  if (watching.at) watching.at(fraction, doing);
}

Together pooled_of(const std::vector<identify::pooling::Source>& diagnoses, bool all,
                   const std::function<void(double)>& at) {
  if (!all)
    return {{},
            base::formatted("There are more than %zu diagnoses, too many to pool at once: `isorig pool` takes the "
                            "folders of one kind of actuator",
                            kMostPooled)};
  try {
    return {
        identify::pooling::pool(diagnoses, {.unpoolable = identify::pooling::Unpoolable::kLeaveOut, .on_progress = at}),
        ""};
  } catch (const identify::pooling::PoolError& e) {
    return {{}, std::string("The diagnoses were not pooled: ") + e.what()};
  }
}

void count(Standing& s, const ordered_json& row) {
  const std::string state = row.at("state");
  ++s.recordings;
  if (state == "made" || state == "bad_recording") {
    ++s.made;
    ++s.verdicts[row.at("verdict").get<std::string>()];
  }
  if (state == "bad_recording") ++s.bad;
  if (state == "failed") ++s.failed;
}

/// What the fits say together.
std::vector<std::string> findings_of(const Curves& curves) {
  if (curves.fits() == 0) return {};
  std::string text = std::to_string(curves.fits()) + (curves.fits() == 1 ? " fit, R² " : " fits, R² ") +
                     identify::report::r_squared_text(curves.r_squared_mean());
  if (curves.fits() > 1) text += " ± " + base::number_text(curves.r_squared_sd(), 2) + " (mean and standard deviation)";
  return {text};
}

/// `s` is filled as the rows come.
void merge_into(Standing& s, const Plan& plan, const identify::report::Made* made, const Watching& watching) {
  CampaignPage page(plan);
  std::vector<identify::pooling::Source> diagnoses;
  bool all_diagnoses = true;
  Appearing csv(plan.folder / "campaign.csv"), json(plan.folder / "campaign.json");
  const ordered_json ask = stamp_now(plan.ask);
  const ordered_json head{{"format", "isorig-campaign-pieces/1"}, {"ask", ask}, {"program", plan.program}};
  std::string opening = head.dump(2);
  opening.resize(opening.size() - 2);  // the brace and its line
  json.out() << opening << ",\n  \"recordings\": [";
  csv.out() << csv_header(plan.ask) << '\n';
  const bool to_pool = made != nullptr && plan.ask.command == "diagnose";
  const double rows_share = to_pool ? 0.5 : 1.0;
  const auto bytes = static_cast<double>(fs::file_size(recordings_of(plan)));
  double read = 0.0;
  for_each_line(recordings_of(plan), [&](const std::string& recording) {
    if (s.recordings % kLookEach == 0) look(watching, rows_share * read / bytes, "writing the table of what is done");
    read += static_cast<double>(recording.size() + 1);
    const ordered_json row = row_now(plan, ask, recording);
    count(s, row);
    csv.out() << csv_line(plan.ask, row) << '\n';
    json.out() << (s.recordings == 1 ? "\n    " : ",\n    ")
               << row.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
    if (made == nullptr) return;
    page.add(row);
    if (!to_pool || row.at("state") != "made") return;
    all_diagnoses = all_diagnoses && diagnoses.size() < kMostPooled;
    if (all_diagnoses) diagnoses.push_back({.diagnosis = piece_folder(plan, recording), .name = short_name(recording)});
  });
  json.out() << "\n  ]\n}\n";
  csv.finish();
  json.finish();
  if (made == nullptr) return;
  Together together;
  if (diagnoses.size() > 1)
    together = pooled_of(diagnoses, all_diagnoses, [&](double fraction) {
      look(watching, rows_share + (1.0 - rows_share) * fraction, "pooling the diagnoses");
    });
  if (together.pooled) {
    s.findings = together.pooled->findings;
    Appearing pooled(plan.folder / "pooled.json");
    pooled.out() << identify::pooling::pooled_json(*together.pooled, plan.folder).dump(1) << '\n';
    pooled.finish();
  } else if (plan.ask.command == "fv") {
    s.findings = findings_of(page.curves());
  }
  page.write(s, together, *made);
  // After the page that links to it.
  if (!together.pooled) fs::remove(plan.folder / "pooled.json");
}

}  // namespace

Standing merge(const Plan& plan, const identify::report::Made* made, const Watching& watching) {
  Standing out;
  try {
    merge_into(out, plan, made, watching);
  } catch (const Stopped&) {
    out.stopped = true;
  }
  return out;
}

}  // namespace isorig::cli::pieces
