#include "proof/real/study.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>

#include "base/parallel.hpp"
#include "base/process.hpp"
#include "base/text_file.hpp"
#include "proof/real/conversions.hpp"

namespace isorig::proof {
namespace {

namespace fs = std::filesystem;
using messages::Output;

/// What a case is written into, and nothing else: the folder may be anybody's.
void clear(const fs::path& folder) {
  std::error_code none;
  std::vector<fs::path> own{folder / "diagnosis", folder / "asked", folder / "nominal-given.toml", folder / "log.txt"};
  for (const auto& entry : fs::directory_iterator(folder, none)) {
    const auto name = entry.path().filename().string();
    if (name.starts_with("train") || name.starts_with("heldout")) own.push_back(entry.path());
  }
  for (const auto& path : own) fs::remove_all(path);
}

struct Removed {
  ~Removed() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
  fs::path path;
};

std::vector<double>& answers_of(messages::Recording& recording) {
  if (recording.metadata.output == Output::kForce) return recording.frame.force_N;
  if (recording.metadata.output == Output::kPosition) return recording.frame.position_mm;
  return recording.pressure.value().pressure_psi;
}

std::string unit_of(Output output) {
  if (output == Output::kForce) return "N";
  return output == Output::kPosition ? "mm" : "psi";
}

/// The column of a prediction whose name begins so; "" where there is none.
std::string column_of(const fs::path& file, std::string_view begins) {
  const std::string text = base::read_text_file(file);
  std::string_view header = std::string_view(text).substr(0, text.find('\n'));
  while (!header.empty()) {
    const auto name = header.substr(0, header.find(','));
    if (name.starts_with(begins)) return std::string(name);
    header.remove_prefix(std::min(header.size(), name.size() + 1));
  }
  return {};
}

std::vector<double> column(const fs::path& file, std::string_view name) {
  const std::string_view names[] = {"t_s", name};
  return read_columns(file, names)[1];
}

double rms_error(const std::vector<double>& predicted, const std::vector<double>& measured) {
  if (predicted.size() != measured.size()) throw std::runtime_error("a prediction of another length");
  double sum = 0.0;
  for (std::size_t i = 0; i < measured.size(); ++i) sum += (predicted[i] - measured[i]) * (predicted[i] - measured[i]);
  return std::sqrt(sum / static_cast<double>(measured.size()));
}

double spread_of(const std::vector<double>& values) {
  const double mean = std::reduce(values.begin(), values.end()) / static_cast<double>(values.size());
  return rms_error(std::vector<double>(values.size(), mean), values);
}

HeldoutPrediction predict(const RealCase& real, std::size_t i, const fs::path& folder, const fs::path& log,
                          const fs::path& isorig) {
  const std::string name = heldout_name(real, i);
  auto recording = messages::read_recording_of_any_output(folder / name);
  const auto measured = answers_of(recording);
  HeldoutPrediction out{std::string(real.heldout[i]), unit_of(recording.metadata.output), spread_of(measured)};
  const std::string value = recording.metadata.output == Output::kForce      ? "force_N"
                            : recording.metadata.output == Output::kPosition ? "position_mm"
                                                                             : "pressure_psi";
  const Removed at_the_end{folder / "asked"};
  messages::write_recording(folder / "asked", without_answers(std::move(recording)));
  for (const char* model : {"nominal", "model"}) {
    const auto file = folder / (name + "-" + model + ".csv");
    const auto ran = base::run_process({isorig, "predict", folder / "asked", "--model",
                                        folder / "diagnosis" / (std::string(model) + ".toml"), "--out", file},
                                       log);
    if (ran.exit_code != 0) throw std::runtime_error("predict ended with exit code " + std::to_string(ran.exit_code));
    const auto predicted = column(file, value);
    const bool nominal = std::string_view(model) == "nominal";
    (nominal ? out.nominal_rms : out.model_rms) = rms_error(predicted, measured);
    const auto low = column_of(file, "low95"), high = column_of(file, "high95");
    if (nominal || low.empty()) continue;
    const auto lows = column(file, low), highs = column(file, high);
    std::size_t inside = 0;
    for (std::size_t k = 0; k < measured.size(); ++k)
      if (measured[k] >= lows[k] && measured[k] <= highs[k]) ++inside;
    out.in_band = static_cast<double>(inside) / static_cast<double>(measured.size());
  }
  return out;
}

/// Of several the one that is furthest from what is known stays.
void take(FoundNumber& out, const nlohmann::json& number) {
  const double value = number.at("value");
  if (++out.of > 1 && !(std::abs(value - out.known.value) > std::abs(out.value - out.known.value))) return;
  out.value = value;
  out.low95 = out.high95 = NAN;
  const auto& ci95 = number.at("ci95");
  if (!ci95.is_array() || ci95.size() != 2 || !ci95[0].is_number() || !ci95[1].is_number()) return;
  out.low95 = ci95[0];
  out.high95 = ci95[1];
}

std::string number(double value) {
  if (std::isnan(value)) return "-";
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

std::string claims_text(const Outcome& said) {
  std::string out;
  for (const Claim& claim : said.missing) {
    char probability[16];
    std::snprintf(probability, sizeof probability, " %.2f", claim.probability);
    out += (out.empty() ? "" : ", ") + ("`" + claim.effect + "`") + probability;
  }
  return out.empty() ? "-" : out;
}

}  // namespace

messages::Recording without_answers(messages::Recording recording) {
  constexpr std::size_t kFirst = 10;
  auto& answers = answers_of(recording);
  if (recording.metadata.output != Output::kForce && answers.size() > kFirst)
    std::fill(answers.begin() + kFirst, answers.end(), answers[kFirst - 1]);
  std::ranges::fill(recording.frame.force_N, 0.0);
  recording.metadata.units_stated = true;  // a column that stands still looks like one in another unit
  return recording;
}

FoundNumber found_number(const KnownNumber& known, const nlohmann::json& diagnosis) {
  FoundNumber out{known};
  for (const auto& one : diagnosis.at("fit").at("model").value("numbers", nlohmann::json::array()))
    if (one.at("part") == std::string(known.physics) && one.at("number") == std::string(known.key)) take(out, one);
  if (out.of > 0) return out;
  // Named, and not in the model that is handed out.
  for (const auto& one : diagnosis.at("missing")) {
    const auto number = one.at("parameters").find(std::string(known.key));
    if (one.at("effect") == std::string(known.physics) && number != one.at("parameters").end()) take(out, *number);
  }
  return out;
}

RealOutcome run_real_case(const RealCase& real, const fs::path& source, const fs::path& out,
                          const RealOptions& options) {
  const fs::path folder = out / real.name, log = folder / "log.txt";
  clear(folder);
  write_real_case(real, source, folder);
  std::vector<std::string> command{options.isorig, "diagnose"};
  for (std::size_t i = 0; i < real.train.size(); ++i) command.push_back(folder / train_name(real, i));
  command.insert(command.end(),
                 {"--model", nominal_is_text(real) ? (folder / "nominal-given.toml").string() : real.nominal, "--out",
                  folder / "diagnosis", "--threads", std::to_string(options.threads)});
  const base::ProcessResult ran = base::run_process(command, log);
  RealOutcome outcome;
  outcome.name = real.name;
  try {
    if (ran.exit_code != 0) throw std::runtime_error("diagnose ended with exit code " + std::to_string(ran.exit_code));
    const fs::path file = folder / "diagnosis" / "diagnosis.json";
    outcome.said = read_diagnosis(file);
    const auto diagnosis = nlohmann::json::parse(base::read_text_file(file));
    for (const auto& [key, value] : diagnosis.at("fit").items())
      if (key.starts_with("noise_") && value.is_number()) outcome.noise = value;
    for (const KnownNumber& known : real.numbers) outcome.numbers.push_back(found_number(known, diagnosis));
    for (std::size_t i = 0; i < real.heldout.size(); ++i)
      outcome.heldout.push_back(predict(real, i, folder, log, options.isorig));
  } catch (const std::exception& error) {
    outcome.said.failed = true;
    outcome.said.why = error.what();
    // Asked for, and not found: their rows stay.
    for (std::size_t i = outcome.numbers.size(); i < real.numbers.size(); ++i)
      outcome.numbers.push_back({real.numbers[i]});
  }
  outcome.said.wall_s = ran.wall_s;
  outcome.said.cpu_s = ran.cpu_s;
  return outcome;
}

std::vector<RealOutcome> run_real_cases(std::span<const RealCase> cases, const fs::path& source, const fs::path& out,
                                        const RealOptions& options) {
  std::vector<RealOutcome> outcomes(cases.size());
  base::parallel_for(cases.size(), options.jobs,
                     [&](std::size_t i) { outcomes[i] = run_real_case(cases[i], source, out, options); });
  return outcomes;
}

std::string real_markdown(std::span<const RealCase> cases, std::span<const RealOutcome> outcomes) {
  std::string found = "| recordings | left out | verdict | found | CPU s |\n|---|---|---|---|---|\n";
  std::string predicted =
      "| held out | spread | nominal model errs by | model with what was missing | in its band "
      "|\n|---|---|---|---|---|\n";
  std::string numbers = "| number | known | found | 95 % |\n|---|---|---|---|\n";
  std::size_t asked = 0, unpredicted = 0, worse = 0;
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const auto& o = outcomes[i];
    found += "| " + o.name + " | " + std::string(cases[i].left_out) + " | " +
             (o.said.failed ? "failed: " + o.said.why : o.said.verdict) + " | " + claims_text(o.said) + " | " +
             number(o.said.cpu_s) + " |\n";
    asked += cases[i].heldout.size();
    // What was to be predicted and was not is worse than any prediction.
    unpredicted += cases[i].heldout.size() - o.heldout.size();
    for (const auto& h : o.heldout) {
      if (h.worse(o.noise)) ++worse;
      predicted += "| " + o.name + ", " + h.name + " | " + number(h.spread) + " " + h.unit + " | " +
                   number(h.nominal_rms) + " | " + (h.worse(o.noise) ? "**" : "") + number(h.model_rms) +
                   (h.worse(o.noise) ? "**" : "") + " | " +
                   (std::isnan(h.in_band) ? "-" : number(100.0 * h.in_band) + " %") + " |\n";
    }
    for (const auto& n : o.numbers)
      numbers += "| " + o.name + ", `" + std::string(n.known.physics) + "." + std::string(n.known.key) + "` | " +
                 number(n.known.value) + " | " + number(n.value) +
                 (n.of > 1 ? ", the furthest of " + std::to_string(n.of) : "") + " | " +
                 (std::isnan(n.low95) ? "-" : number(n.low95) + " to " + number(n.high95)) + " |\n";
  }
  return found + "\n" + predicted + "\n" + std::to_string(worse + unpredicted) + " of " + std::to_string(asked) +
         " held-out recordings are predicted worse than by the nominal model" +
         (unpredicted > 0 ? ", " + std::to_string(unpredicted) + " of them not at all" : "") + ".\n\n" + numbers;
}

nlohmann::ordered_json real_json(std::span<const RealCase> cases, std::span<const RealOutcome> outcomes) {
  auto json = nlohmann::ordered_json{{"format", "isorig-real/1"}};
  auto& all = json["cases"] = nlohmann::ordered_json::array();
  const auto or_null = [](double v) { return std::isnan(v) ? nlohmann::ordered_json() : nlohmann::ordered_json(v); };
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const auto& o = outcomes[i];
    nlohmann::ordered_json one{{"case", o.name},
                               {"set", cases[i].set},
                               {"left_out", cases[i].left_out},
                               {"known", cases[i].known},
                               {"failed", o.said.failed},
                               {"why", o.said.why},
                               {"verdict", o.said.verdict},
                               {"cpu_s", or_null(o.said.cpu_s)},
                               {"noise", or_null(o.noise)}};
    auto& missing = one["missing"] = nlohmann::ordered_json::array();
    for (const auto& c : o.said.missing) missing.push_back({{"effect", c.effect}, {"probability", c.probability}});
    auto& heldout = one["heldout"] = nlohmann::ordered_json::array();
    for (const auto& h : o.heldout)
      heldout.push_back({{"file", h.name},
                         {"unit", h.unit},
                         {"spread", h.spread},
                         {"nominal_rms", h.nominal_rms},
                         {"model_rms", h.model_rms},
                         {"in_band", or_null(h.in_band)},
                         {"worse", h.worse(o.noise)}});
    auto& numbers = one["numbers"] = nlohmann::ordered_json::array();
    for (const auto& n : o.numbers)
      numbers.push_back({{"physics", n.known.physics},
                         {"key", n.known.key},
                         {"known", n.known.value},
                         {"found", or_null(n.value)},
                         {"of", n.of},
                         {"low95", or_null(n.low95)},
                         {"high95", or_null(n.high95)}});
    all.push_back(std::move(one));
  }
  return json;
}

}  // namespace isorig::proof
