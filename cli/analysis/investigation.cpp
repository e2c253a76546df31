#include "cli/analysis/investigation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>

#include "base/json_words.hpp"
#include "base/whole_file.hpp"
#include "cli/analysis/diagnosis_files.hpp"
#include "cli/protocols/protocol_input.hpp"
#include "identify/report/page.hpp"
#include "model/catalogue.hpp"
#include "model/words.hpp"

namespace isorig::cli {

using identify::report::number_text;
using model::explanation_words;
using nlohmann::ordered_json;

namespace {

constexpr const char* kFormat = "isorig-investigation/1";
constexpr std::array<std::string_view, 8> kOutcomes{"running",     "consistent", "settled", "unknown_physics",
                                                    "inseparable", "rounds",     "budget",  "cannot_judge"};

ordered_json json_of(const Round& round) {
  ordered_json out{
      {"round", round.number}, {"protocol", round.protocol},     {"text", round.text},          {"run", round.run},
      {"rig_s", round.rig_s},  {"recordings", round.recordings}, {"diagnosed", round.diagnosed}};
  if (!round.diagnosed) return out;
  out["verdict"] = round.verdict;
  out["explanations"] = ordered_json::array();
  for (const auto& e : round.explanations)
    out["explanations"].push_back({{"effects", e.key}, {"probability", e.probability}});
  out["found"] = round.found;
  out["tied"] = round.tied;
  out["next_experiment"] = round.experiment;
  if (!round.experiment.is_null()) out["next_protocol"] = round.experiment_protocol;
  out["inseparable"] = round.inseparable;
  return out;
}

Round round_of(const ordered_json& json) {
  Round out;
  out.number = json.at("round");
  out.protocol = json.at("protocol");
  out.text = json.at("text");
  out.run = json.at("run");
  out.rig_s = json.at("rig_s");
  out.recordings = json.at("recordings").get<std::vector<std::string>>();
  out.diagnosed = json.at("diagnosed");
  if (!out.diagnosed) return out;
  out.verdict = json.at("verdict");
  for (const auto& e : json.at("explanations")) out.explanations.push_back({e.at("effects"), e.at("probability")});
  out.found = json.at("found").get<std::vector<std::string>>();
  out.tied = json.at("tied");
  out.experiment = json.at("next_experiment");
  if (!out.experiment.is_null()) out.experiment_protocol = json.at("next_protocol");
  out.inseparable = json.at("inseparable").get<std::vector<std::string>>();
  return out;
}

std::string percent(double probability) {
  return number_text(probability, probability > 0.99 ? 3 : 2);
}

}  // namespace

std::string_view name_of(Outcome outcome) {
  return kOutcomes[static_cast<std::size_t>(outcome)];
}

double Investigation::rig_s() const {
  double sum = 0.0;
  for (const Round& round : rounds) sum += round.rig_s;
  return sum;
}

void take_in(Round& round, const identify::Study& study) {
  const identify::Diagnosis& d = study.diagnosis;
  round.diagnosed = true;
  round.verdict = identify::name_of(d.verdict);
  const auto& selection = study.selection;
  std::vector<std::size_t> order(selection.pool.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::ranges::stable_sort(order, std::greater<>(), [&](std::size_t i) { return selection.weight[i]; });
  round.explanations.clear();
  for (const std::size_t i : order) {
    if (!round.explanations.empty() && (selection.weight[i] < 0.02 || round.explanations.size() >= 6)) break;
    std::string key = selection.pool[i].key();
    round.explanations.push_back({key == "nominal" ? "nothing is missing" : key, selection.weight[i]});
  }
  round.found.clear();
  for (const auto& missing : d.missing) {
    std::string text =
        words_and_name(std::string(missing.effect->name)) + ", probability " + percent(missing.probability);
    for (const auto& value : missing.parameters)
      text +=
          "; " + number_line(value.value, value.low, value.high, model::sheet_of(*value.law, value.name), value.key());
    round.found.push_back(std::move(text));
  }
  if (d.unjudged) round.found.push_back(d.unjudged->why + "; record " + d.unjudged->record);
  if (!d.described_by.empty())
    round.found.push_back("something without a name; " + identify::described_in_words(d.discovered, d.described_by));
  round.tied = !d.design.tied.empty();
  round.experiment = identify::experiment_json(d.design);
  round.experiment_protocol = d.design.experiment ? d.design.experiment->protocol : "";
  round.inseparable.clear();
  for (const auto& pair : d.design.inseparable) round.inseparable.push_back(pair.text);
}

std::optional<Outcome> settled_by(const Round& round) {
  if (round.tied) return round.experiment.is_null() ? std::optional(Outcome::kInseparable) : std::nullopt;
  if (round.verdict == "consistent") return Outcome::kConsistent;
  if (round.verdict == "cannot_judge") return Outcome::kUnjudged;
  return round.verdict == "unknown_physics" ? Outcome::kUnknown : Outcome::kSettled;
}

std::string answer_text(const Investigation& all) {
  const Round& last = all.rounds.back();
  std::string found;
  for (const std::string& f : last.found) found += (found.empty() ? "" : ". Beside it: ") + f;
  std::string tied;
  for (std::size_t i = 0; i < std::min<std::size_t>(last.explanations.size(), 4); ++i)
    tied += (i == 0 ? "" : ", ") + explanation_words(last.explanations[i].key) + " (probability " +
            percent(last.explanations[i].probability) + ")";
  const Round& first = all.rounds.front();
  std::string before;
  if (all.rounds.size() > 1) {
    const auto same = std::ranges::find(first.explanations, last.best().key, &Round::Explanation::key);
    before = " After the first recording it had " +
             (same != first.explanations.end() ? percent(same->probability) : std::string("next to none")) + ".";
  }
  switch (all.outcome) {
    case Outcome::kConsistent:
      return "The model explains what was recorded: nothing is missing that would show." + before;
    case Outcome::kSettled:
      return "One explanation stands out: " + found + "." + before;
    case Outcome::kUnjudged:
      return "What was recorded cannot judge the model: " + found + ".";
    case Outcome::kUnknown:
      return "Something is missing that no effect of the catalogue explains" +
             (found.empty() ? std::string(".") : ": " + found + ".");
    case Outcome::kInseparable: {
      std::string text = "Nothing that this rig can do within its limits separates what is left: " + tied + ".";
      for (const std::string& pair : last.inseparable) text += " " + pair;
      return text;
    }
    case Outcome::kRounds:
      return "Not settled within the rounds allowed (--rounds): " + tied + ".";
    case Outcome::kBudget:
      return "Not settled within the rig time allowed (--budget): " + tied + ".";
    case Outcome::kRunning:
      break;
  }
  return "";
}

void save(const Investigation& all) {
  ordered_json out{{"format", kFormat},
                   {"outcome", name_of(all.outcome)},
                   {"text", all.text},
                   {"rig_s", all.rig_s()},
                   {"inputs", all.inputs}};
  out["rounds"] = ordered_json::array();
  for (const Round& round : all.rounds) out["rounds"].push_back(json_of(round));
  base::write_whole_file(all.folder / "investigation.json", out.dump(2) + "\n");
}

void load(Investigation& all) {
  const auto file = all.folder / "investigation.json";
  std::ifstream in(file);
  if (!in) {
    if (std::filesystem::exists(all.round_folder(1)))
      throw std::runtime_error(all.folder.string() + " holds rounds without investigation.json; choose another --out");
    if (std::filesystem::exists(all.folder / "diagnosis.json"))
      throw std::runtime_error(all.folder.string() +
                               " holds a diagnosis, whose model.toml this would replace; choose another --out");
    return;
  }
  try {
    const auto json = ordered_json::parse(in);
    if (json.at("format") != kFormat) throw std::runtime_error("it is no " + std::string(kFormat));
    if (json.at("inputs") != all.inputs) {
      std::string which;
      for (const auto& [key, value] : all.inputs.items())
        if (!json.at("inputs").contains(key) || json.at("inputs").at(key) != value)
          which += (which.empty() ? "" : ", ") + key;
      throw std::runtime_error("it was begun with another " + which);
    }
    all.rounds.clear();
    for (const auto& round : json.at("rounds")) all.rounds.push_back(round_of(round));
  } catch (const std::exception& e) {
    throw std::runtime_error(file.string() + ": " + base::json_words(e) + "; choose another --out");
  }
}

void write_report(const Investigation& all, const identify::report::Made& made) {
  using identify::report::Mood;
  identify::report::Page page("Investigation", all.inputs.value("rig", "") + " with " + all.inputs.value("model", ""));
  page.made(made);
  switch (all.outcome) {
    case Outcome::kConsistent:
      page.lead(Mood::kGood, "nothing missing", model::in_words(all.text));
      break;
    case Outcome::kSettled:
      page.lead(Mood::kInfo, "settled", model::in_words(all.text));
      break;
    case Outcome::kUnknown:
      page.lead(Mood::kWarning, "unknown physics", model::in_words(all.text));
      break;
    default:
      page.lead(Mood::kWarning, "not settled", model::in_words(all.text));
  }
  // A round that was not the last when it was diagnosed, or was diagnosed with --no-report, has numbers and no page.
  const std::string last = "round-" + std::to_string(all.rounds.back().number) + "/diagnosis/";
  for (const char* file : {"diagnosis-report.html", "diagnosis.json"})
    if (std::filesystem::exists(all.folder / (last + file))) {
      page.link("Diagnosis of all recordings together", last + file);
      break;
    }
  std::vector<std::vector<std::string>> rows;
  for (const Round& round : all.rounds)
    rows.push_back({std::to_string(round.number), round.text, duration_text(round.rig_s),
                    explanation_words(round.best().key), number_text(round.best().probability, 3)});
  page.table({"round", "experiment", "rig time", "most probable then", "probability"}, rows);
  for (const Round& round : all.rounds) {
    page.heading("Round " + std::to_string(round.number) + ": " + round.text);
    rows.clear();
    for (const auto& e : round.explanations) rows.push_back({explanation_words(e.key), number_text(e.probability, 3)});
    page.table({"explanation", "probability"}, rows,
               "After " + std::to_string(round.number) +
                   (round.number == 1 ? " recording" : " rounds, all recordings together"));
    std::vector<std::string> found;
    for (const std::string& each : round.found) found.push_back(model::in_words(each));
    page.list(found);
    for (const std::string& pair : round.inseparable) page.note(model::in_words(pair));
    if (round.experiment.is_null()) continue;
    const auto& e = round.experiment;
    page.subheading("What would settle it");
    page.paragraph(e.at("text").get<std::string>() + ", " + duration_text(e.at("duration_s")) + ", of " +
                   std::to_string(e.at("considered").get<int>()) +
                   " experiments within the limits. A pair counts as separated from " + number_text(e.at("enough"), 3) +
                   " on (squares over the noise).");
    rows.clear();
    for (const auto& x : e.at("expected"))
      rows.push_back({explanation_words(x.at("if").get<std::string>()),
                      explanation_words(x.at("then").get<std::string>()), number_text(x.at("leaves"), 3)});
    page.table({"if this is true", "this, refitted to everything", "leaves"}, rows);
    rows.clear();
    for (const auto& o : e.at("others"))
      rows.push_back({o.at("text"), duration_text(o.at("duration_s")), number_text(o.at("distance"), 3)});
    page.table({"also considered", "duration", "smallest distance, to first order"}, rows);
  }
  page.write(all.folder, "investigation-report.html");
}

}  // namespace isorig::cli
