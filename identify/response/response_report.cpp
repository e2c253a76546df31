#include "identify/response/response_report.hpp"

#include <string>

#include "base/number_text.hpp"

namespace isorig::identify::response {
namespace {

using report::Mood;

std::string sentence(const ResponseDiagnosis& d) {
  const std::string unit(unit_of(d.output));
  const auto number = [](double value) { return base::number_text(value, 3); };
  const std::string output(messages::name_of(d.output));
  if (d.verdict == "cannot_judge") return "This cannot be judged: " + d.why + ".";
  if (d.verdict == "consistent")
    return "The nominal model answers for the " + output + ": it leaves " + number(d.nominal.rms) + " " + unit +
           ", and readings scatter by " + number(d.noise) + " " + unit + ".";
  std::string names;
  for (const MissingPart& one : d.missing) names += (names.empty() ? "" : ", ") + one.effect;
  return "The nominal model leaves " + number(d.nominal.rms) + " " + unit + " of the " + output +
         (names.empty() ? "" : "; with " + names + " " + number(d.model.rms) + " " + unit + " are left") +
         ". Readings scatter by " + number(d.noise) + " " + unit + "." +
         (d.verdict == "unknown_physics" ? " What is left follows none of what was tried." : "");
}

std::vector<double> sum_of(const std::vector<double>& a, const Eigen::VectorXd& b, double sign) {
  std::vector<double> out(a);
  for (std::size_t k = 0; k < out.size(); ++k) out[k] += sign * b[static_cast<Eigen::Index>(k)];
  return out;
}

std::vector<double> as_vector(const Eigen::VectorXd& v) {
  return {v.data(), v.data() + v.size()};
}

void draw(const ResponseDiagnosis& d, std::size_t r, report::Page& page) {
  const Data& data = d.data[r];
  const std::string unit(unit_of(d.output)), output(messages::name_of(d.output));
  report::Figure figure;
  figure.name = "answer-" + std::to_string(r + 1);
  figure.caption = data.name + ": the " + output + " as read and as fitted, and what each model leaves of it.";
  figure.linked = true;
  report::Panel answer{.title = data.name, .x_label = "time (s)", .y_label = output + " (" + unit + ")"};
  for (auto& s : report::enveloped(data.t_s, data.output_value, "read", 0)) answer.series.push_back(std::move(s));
  for (auto& s : report::enveloped(data.t_s, sum_of(data.output_value, d.model.residual[r], -1.0), "model", 1))
    answer.series.push_back(std::move(s));
  report::Panel left{.x_label = "time (s)", .y_label = "read minus fitted (" + unit + ")"};
  for (auto& s : report::enveloped(data.t_s, as_vector(d.nominal.residual[r]), "nominal", 0))
    left.series.push_back(std::move(s));
  for (auto& s : report::enveloped(data.t_s, as_vector(d.model.residual[r]), "model", 1))
    left.series.push_back(std::move(s));
  left.horizontals = {{d.noise, "noise"}, {-d.noise, ""}};
  figure.panels = {std::move(answer), std::move(left)};
  for (const auto& input : data.inputs) {
    report::Panel panel{.x_label = "time (s)", .y_label = std::string(input.column)};
    for (auto& s : report::enveloped(data.t_s, input.value, std::string(input.column), 2))
      panel.series.push_back(std::move(s));
    figure.panels.push_back(std::move(panel));
  }
  page.figure(figure);
}

}  // namespace

void write_response_report(const ResponseDiagnosis& d, const std::filesystem::path& folder, const report::Made& made) {
  const auto number = [](double value) { return base::number_text(value, 4); };
  const std::string unit(unit_of(d.output));
  report::Page page("Diagnosis", "What the " + std::string(messages::name_of(d.output)) + " answers to");
  const Mood mood = d.verdict == "consistent"        ? Mood::kGood
                    : d.verdict == "missing_physics" ? Mood::kInfo
                                                     : Mood::kWarning;
  std::string word = d.verdict;
  for (char& c : word)
    if (c == '_') c = ' ';
  page.lead(mood, word, sentence(d));
  for (const std::string& warning : d.warnings) page.note(warning);
  for (const std::string& note : d.notes) page.note(note, Mood::kInfo);
  if (!d.record.empty()) page.note("To judge it, record " + d.record + ".");
  if (!d.not_modelled.empty()) page.note("model.toml is the nominal model: " + d.not_modelled + ".");
  for (std::size_t r = 0; r < d.data.size(); ++r) draw(d, r, page);
  if (!d.missing.empty()) {
    page.heading("What was left out");
    for (const MissingPart& one : d.missing) {
      page.subheading(one.effect + ", p = " + base::number_text(one.probability, 2));
      page.equation(one.formula);
      std::vector<std::vector<std::string>> rows;
      for (const FittedNumber& n : one.numbers)
        rows.push_back({n.name, report::interval_text(n.value, n.low95, n.high95)});
      page.table({"number", "value [95 %]"}, rows);
    }
  }
  page.heading("Readings that were left out");
  std::vector<std::vector<std::string>> rows;
  for (const LeftOutPart& part : d.left_out)
    rows.push_back(
        {part.recording, number(part.from_s), number(part.to_s), number(part.nominal_rms), number(part.model_rms)});
  page.table({"recording", "from, s", "to, s", "nominal, " + unit, "model, " + unit}, rows,
             "Each stretch predicted by models fitted to the others, rms.");
  page.heading("What was weighed");
  rows.clear();
  for (const auto& one : d.tried) {
    std::string key;
    for (const std::string& effect : one.effects) key += (key.empty() ? "" : " + ") + effect;
    rows.push_back({key.empty() ? "nominal" : key, base::number_text(one.weight, 2)});
  }
  page.table({"explanation", "weight"}, rows,
             "Weights by the Bayesian information criterion over the readings that are independent of each other.");
  page.note(
      "The numbers are of this load and this specimen: a position under one load cannot tell a spring of the specimen "
      "from the way its pressure acts.",
      Mood::kInfo);
  page.made(made);
  page.write(folder, "diagnosis-report.html");
}

}  // namespace isorig::identify::response
