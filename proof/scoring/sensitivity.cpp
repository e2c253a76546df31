#include "proof/scoring/sensitivity.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>

#include "base/formatted.hpp"
#include "base/lock_file.hpp"
#include "base/nearest.hpp"
#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/process.hpp"
#include "base/text_file.hpp"
#include "cli/screen/progress.hpp"
#include "proof/scoring/score.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr std::array kFactors{0.5, 2.0};
constexpr const char* kStated = "stated";

std::vector<StatedNumber> numbers_of(const fs::path& program, const fs::path& folder) {
  const fs::path file = folder / "deciding.json";
  fs::remove(file);
  const auto asked = base::run_process({program, "diagnose", "--deciding", "--json"}, file);
  if (asked.exit_code != 0)
    throw std::runtime_error(program.string() + " has no `diagnose --deciding`: " + file.string());
  std::vector<StatedNumber> out;
  for (const auto& one : nlohmann::json::parse(base::read_text_file(file)))
    out.push_back({one.at("name"), one.at("unit"), one.at("value"), one.at("least"), one.at("most"), one.at("whole")});
  return out;
}

/// One set of numbers: all as stated, or one at another value.
std::string assignment(const StatedNumber& number, double value) {
  return number.name + "=" + base::exact_number_text(value);
}

ordered_json json_of(const Outcome& outcome) {
  ordered_json missing = ordered_json::array();
  for (const Claim& claim : outcome.missing)
    missing.push_back({{"effect", claim.effect}, {"probability", claim.probability}});
  ordered_json json{
      {"failed", outcome.failed}, {"why", outcome.why}, {"verdict", outcome.verdict}, {"missing", missing}};
  // What is not finite becomes null.
  json["nominal_rmse_N"] = outcome.nominal_rmse_N;
  json["model_rmse_N"] = outcome.model_rmse_N;
  json["cpu_s"] = outcome.cpu_s;
  return json;
}

Outcome outcome_of(const fs::path& piece) {
  const auto json = nlohmann::json::parse(base::read_text_file(piece));
  const auto number = [&](const char* key) {
    return json.at(key).is_null() ? double{NAN} : json.at(key).get<double>();
  };
  Outcome out;
  out.failed = json.at("failed");
  out.why = json.at("why");
  out.verdict = json.at("verdict");
  for (const auto& one : json.at("missing")) out.missing.push_back({one.at("effect"), one.at("probability")});
  out.nominal_rmse_N = number("nominal_rmse_N");
  out.model_rmse_N = number("model_rmse_N");
  out.cpu_s = number("cpu_s");
  return out;
}

/// A study, and the pieces that were measured of it.
class Pieces {
 public:
  explicit Pieces(const SensitivityOptions& options)
      : options_(options), folder_(options.study / "sensitivity"), cases_(cases_of(options.study)) {
    labels_file_ = options.labels.empty() ? options.study / "sealed" / "labels.json" : options.labels;
    sha256_ = published_hash(options.study / "labels.sha256");
    const std::vector<Label> all = parse_labels(unseal(labels_file_, options.study / "labels.sha256"));
    for (const CaseToRun& one : cases_) {
      const auto found = std::ranges::find(all, one.name, &Label::name);
      if (found == all.end()) throw std::runtime_error(one.name + " has no label in " + labels_file_.string());
      labels_.push_back(*found);
    }
    program_ = path_of(options.run.isorig);
    fs::create_directories(folder_);
    alone_.emplace(folder_ / "sensitivity.lock");  // a second call would make the same pieces in the same folders
    // What may not be mixed, before any file is written.
    require_one("study.sha256", sha256_, "labels.json",
                "holds what was measured of another study than " + options.study.string() + "; move it away");
    require_one("program.sha256", sha256(base::read_text_file(program_)), program_.filename().string(),
                "holds what another program made than " + program_.string() +
                    "; move it away, or name that program with --isorig");
    numbers_ = numbers_of(program_, folder_);
  }

  [[nodiscard]] const std::vector<StatedNumber>& numbers() const noexcept { return numbers_; }
  [[nodiscard]] const std::vector<Label>& labels() const noexcept { return labels_; }
  [[nodiscard]] const std::string& labels_sha256() const noexcept { return sha256_; }

  /// Runs what is not there yet of these sets of numbers.
  void run(const std::vector<std::string>& sets) const {
    struct Piece {
      std::string set;
      std::size_t at;
    };
    std::vector<Piece> wanted;
    for (const std::string& set : sets)
      for (std::size_t i = 0; i < cases_.size(); ++i)
        if (!fs::exists(file_of(set, i))) wanted.push_back({set, i});
    std::printf("%zu pieces to run, %zu are there\n", wanted.size(), sets.size() * cases_.size() - wanted.size());
    std::fflush(stdout);
    cli::Progress progress("sensitivity");
    std::atomic<std::size_t> ended = 0;
    base::parallel_for(wanted.size(), options_.run.jobs, [&](std::size_t i) {
      make(wanted[i].set, wanted[i].at);
      const std::size_t now = ++ended;
      progress.at(static_cast<double>(now) / static_cast<double>(wanted.size()),
                  std::to_string(now) + " of " + std::to_string(wanted.size()) + ", " + wanted[i].set);
    });
  }

  [[nodiscard]] bool has(const std::string& set) const {
    for (std::size_t i = 0; i < cases_.size(); ++i)
      if (!fs::exists(file_of(set, i))) return false;
    return true;
  }
  [[nodiscard]] std::vector<Outcome> outcomes(const std::string& set) const {
    std::vector<Outcome> out;
    for (std::size_t i = 0; i < cases_.size(); ++i) out.push_back(outcome_of(file_of(set, i)));
    return out;
  }

 private:
  [[nodiscard]] fs::path file_of(const std::string& set, std::size_t at) const {
    return folder_ / set / (cases_[at].name + ".json");
  }

  void make(const std::string& set, std::size_t at) const {
    const fs::path work = folder_ / set / (cases_[at].name + ".work"), file = file_of(set, at);
    RunOptions run = options_.run;
    run.isorig = program_;
    run.also = {"--no-report"};
    if (set != kStated) run.also.insert(run.also.end(), {"--decide", set});
    fs::remove_all(work);  // of a call that was interrupted
    (void)run_case(cases_[at], work, run);
    // Whole or not there: a piece that was cut off is run again.
    write_text(fs::path(file) += ".part",
               json_of(collect(work, true_force_N(labels_file_, labels_[at]))).dump(2) + "\n");
    fs::rename(fs::path(file) += ".part", file);
    fs::remove_all(work);
  }

  /// The hash that the first call left in `file` is this one's, and pieces without one are of nobody knows what.
  void require_one(const char* file, const std::string& hash, const std::string& of, const std::string& differs) const {
    if (!fs::exists(folder_ / file)) {
      for (const auto& entry : fs::directory_iterator(folder_))
        if (entry.is_directory())
          throw std::runtime_error(folder_.string() + " does not say of which study and program its pieces are (no " +
                                   file + "); move it away");
      write_text(folder_ / file, hash + "  " + of + "\n");
    } else if (published_hash(folder_ / file) != hash) {
      throw std::runtime_error(folder_.string() + " " + differs);
    }
  }

  const SensitivityOptions& options_;
  fs::path folder_, program_, labels_file_;
  std::vector<CaseToRun> cases_;
  std::vector<Label> labels_;
  std::string sha256_;
  std::vector<StatedNumber> numbers_;
  std::optional<base::LockFile> alone_;
};

Tally tally_of(const std::vector<Label>& labels, const std::vector<Outcome>& outcomes) {
  const Score s = score("isorig", labels, outcomes);
  return {s.sure_right.hits, s.sure_right.of - s.sure_right.hits, s.median_gap};
}

std::set<std::string> names_of(const Outcome& outcome) {
  std::set<std::string> names;
  for (const Claim& claim : outcome.missing) names.insert(claim.effect);
  return names;
}

ordered_json json_of(const Tally& tally) {
  return {{"right_above_0.9", tally.right}, {"wrong_above_0.9", tally.wrong}, {"median_gap_closed", tally.median_gap}};
}

std::string row_of(const std::string& name, const std::string& value, const std::string& verdicts,
                   const std::string& names, const Tally& tally) {
  return base::formatted("| %s | %s | %s | %s | %zu | %zu | %.1f |\n", name.c_str(), value.c_str(), verdicts.c_str(),
                         names.c_str(), tally.right, tally.wrong, 100.0 * tally.median_gap);
}

}  // namespace

std::optional<double> moved(const StatedNumber& number, double factor) {
  double value = number.value * factor;
  if (number.whole) value = std::round(value);
  value = std::clamp(value, number.least, number.most);
  if (value == number.value) return std::nullopt;
  return value;
}

Shift shift_of(double value, const std::vector<Label>& labels, const std::vector<Outcome>& stated,
               const std::vector<Outcome>& now) {
  Shift out{value, 0, 0, tally_of(labels, now)};
  for (std::size_t i = 0; i < stated.size(); ++i) {
    out.verdicts_changed += stated[i].verdict != now[i].verdict || stated[i].failed != now[i].failed ? 1 : 0;
    out.names_changed += names_of(stated[i]) != names_of(now[i]) ? 1 : 0;
  }
  return out;
}

Sensitivity measure_sensitivity(const SensitivityOptions& options) {
  const Pieces pieces(options);
  std::vector<std::string> known;
  for (const StatedNumber& number : pieces.numbers()) known.push_back(number.name);
  for (const std::string& name : options.only) {
    if (std::ranges::find(known, name) != known.end()) continue;
    const std::string meant = base::nearest(name, known);
    throw std::runtime_error("no number \"" + name + "\" decides a diagnosis" +
                             (meant.empty() ? "" : "; did you mean " + meant + "?") +
                             " `isorig diagnose --deciding` lists all");
  }
  std::vector<std::string> sets{kStated};
  for (const StatedNumber& number : pieces.numbers()) {
    if (!options.only.empty() && std::ranges::find(options.only, number.name) == options.only.end()) continue;
    for (const double factor : kFactors)
      if (const auto value = moved(number, factor)) sets.push_back(assignment(number, *value));
  }
  pieces.run(sets);

  const std::vector<Outcome> stated = pieces.outcomes(kStated);
  Sensitivity out{pieces.labels_sha256(), stated.size(), tally_of(pieces.labels(), stated), {}};
  for (const StatedNumber& number : pieces.numbers()) {
    NumberSensitivity one{number, {}};
    for (std::size_t f = 0; f < kFactors.size(); ++f) {
      const auto value = moved(number, kFactors[f]);
      if (!value || !pieces.has(assignment(number, *value))) continue;
      one.shifts[f] = shift_of(*value, pieces.labels(), stated, pieces.outcomes(assignment(number, *value)));
    }
    if (std::ranges::any_of(one.shifts, [](const auto& shift) { return shift.has_value(); }))
      out.numbers.push_back(std::move(one));
  }
  return out;
}

std::string sensitivity_text(const Sensitivity& of) {
  std::string out =
      "| number | at | verdicts changed | names changed | right > 0.9 | wrong > 0.9 | gap closed, median % |\n"
      "|---|---|---|---|---|---|---|\n";
  const std::string cases = "/" + std::to_string(of.cases);
  out += row_of("all as stated", "", "", "", of.stated);
  for (const NumberSensitivity& one : of.numbers) {
    const std::string unit = one.number.unit == "1" ? "" : " " + one.number.unit;
    const std::string name = "`" + one.number.name + "`, " + base::number_text(one.number.value) + unit;
    for (const auto& shift : one.shifts)
      if (shift)
        out += row_of(name, base::number_text(shift->value), std::to_string(shift->verdicts_changed) + cases,
                      std::to_string(shift->names_changed) + cases, shift->tally);
  }
  return out;
}

ordered_json sensitivity_json(const Sensitivity& of) {
  ordered_json json{{"labels_sha256", of.labels_sha256},
                    {"cases", of.cases},
                    {"stated", json_of(of.stated)},
                    {"numbers", ordered_json::array()}};
  constexpr std::array kNames{"half", "double"};
  for (const NumberSensitivity& one : of.numbers) {
    ordered_json entry{{"name", one.number.name}, {"unit", one.number.unit}, {"stated", one.number.value}};
    for (std::size_t f = 0; f < kNames.size(); ++f) {
      entry[kNames[f]] = nullptr;
      if (!one.shifts[f]) continue;
      const Shift& shift = *one.shifts[f];
      entry[kNames[f]] = {
          {"value", shift.value}, {"verdicts_changed", shift.verdicts_changed}, {"names_changed", shift.names_changed}};
      entry[kNames[f]].update(json_of(shift.tally));
    }
    json["numbers"].push_back(std::move(entry));
  }
  return json;
}

}  // namespace isorig::proof
