#include "identify/response/response_report.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/number_text.hpp"
#include "model/words.hpp"

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
  for (const MissingPart& one : d.missing) names += (names.empty() ? "" : ", ") + model::effect_words(one.effect);
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

/// The rms of the other stretches that were left out, and no less than that of a fit: nothing of `part` is in it but
/// what it taught the fits of the others.
double error_elsewhere(const ResponseDiagnosis& d, const LeftOutPart& part) {
  double squares = 0.0, rows = 0.0;
  for (const LeftOutPart& other : d.left_out) {
    if (other.data == part.data && other.first_row == part.first_row) continue;
    const auto count = static_cast<double>(other.model_residual.size());
    squares += count * other.model_rms * other.model_rms;
    rows += count;
  }
  return std::max(rows > 0.0 ? std::sqrt(squares / rows) : 0.0, d.model.rms);
}

/// Numbers that both models have, with their intervals: the nominal model's times are the model's first, second ...
void add_moved(const ResponseDiagnosis& d, report::Page& page) {
  if (d.missing.empty() || !d.not_modelled.empty()) return;
  std::vector<std::vector<std::string>> rows;
  const auto text = [](const FittedNumber& n) { return report::interval_text(n.value, n.low95, n.high95); };
  for (const FittedNumber& was : d.nominal.numbers) {
    const auto is = std::ranges::find(d.model.numbers, was.name, &FittedNumber::name);
    if (is == d.model.numbers.end()) continue;
    rows.push_back({model::number_words(was.name, was.unit), was.unit, text(was), text(*is),
                    was.value != 0.0 ? base::number_text(100.0 * (is->value - was.value) / std::abs(was.value), 3)
                                     : std::string("-")});
  }
  if (rows.empty()) return;
  page.heading("How the model's own numbers moved");
  page.table({"number", "unit", "nominal model alone [95 %]", "with what it lacked [95 %]", "change (%)"}, rows);
}

/// A stretch that no fit had seen, as both models predict it.
void draw_left_out(const ResponseDiagnosis& d, const LeftOutPart& part, bool worst, report::Page& page) {
  constexpr std::size_t kStretchesDrawn = 300;
  constexpr double kTwoSided95 = 1.96;
  constexpr const char* kBand = "95 % band";
  const Data& data = d.data[part.data];
  const std::string unit(unit_of(d.output)), output(messages::name_of(d.output));
  const auto first = static_cast<std::ptrdiff_t>(part.first_row);
  const auto rows = static_cast<std::ptrdiff_t>(part.model_residual.size());
  const std::vector<double> t_s(data.t_s.begin() + first, data.t_s.begin() + first + rows),
      read(data.output_value.begin() + first, data.output_value.begin() + first + rows);
  const double half = kTwoSided95 * error_elsewhere(d, part);
  const bool found = !d.missing.empty();
  std::vector<double> nominal(read), model(read), low, high;
  double inside = 0.0;
  for (std::size_t k = 0; k < read.size(); ++k) {
    nominal[k] -= part.nominal_residual[k];
    model[k] -= part.model_residual[k];
    low.push_back(model[k] - half);
    high.push_back(model[k] + half);
    inside += std::abs(part.model_residual[k]) <= half;
  }
  const int color = found ? 1 : 0;
  report::Panel answer{.y_label = output + " (" + unit + ")"};
  answer.series.push_back(report::enveloped_band(t_s, low, high, kBand, color, kStretchesDrawn));
  for (auto& s : report::enveloped(t_s, read, "read", 7, kStretchesDrawn)) answer.series.push_back(std::move(s));
  answer.series.push_back(report::enveloped(t_s, nominal, "nominal model", 0, kStretchesDrawn).back());
  if (found) answer.series.push_back(report::enveloped(t_s, model, "with what it lacked", 1, kStretchesDrawn).back());
  answer.aspect = 0.32;
  report::Panel left{.x_label = "time (s)", .y_label = "prediction error (" + unit + ")"};
  left.series.push_back(report::enveloped_band(t_s, std::vector<double>(t_s.size(), -half),
                                               std::vector<double>(t_s.size(), half), kBand, color, kStretchesDrawn));
  for (auto& s : report::enveloped(t_s, part.nominal_residual, "nominal model", 0, kStretchesDrawn))
    left.series.push_back(std::move(s));
  if (found)
    for (auto& s : report::enveloped(t_s, part.model_residual, "with what it lacked", 1, kStretchesDrawn))
      left.series.push_back(std::move(s));
  left.aspect = 0.25;
  const auto number = [](double value) { return base::number_text(value, 3); };
  report::Figure figure{
      worst ? "left-out-worst" : "left-out-median",
      std::string(worst ? "The worst" : "The median") + " of " + std::to_string(d.left_out.size()) +
          " stretches that were left out of the fits: " + base::number_text(t_s.front(), 5) + " to " +
          base::number_text(t_s.back(), 5) + " s of " + part.recording +
          ". Below, read minus predicted. The nominal model errs by " + number(part.nominal_rms) + " " + unit + " rms" +
          (found ? ", with what it lacked by " + number(part.model_rms) + " " + unit : std::string()) + "; " +
          number(100.0 * inside / static_cast<double>(read.size())) + " % of " + std::to_string(read.size()) +
          " readings lie in the band that was stated for 95 %.",
      {answer, left}};
  figure.linked = true;
  page.figure(figure);
}

void draw_worst_and_median(const ResponseDiagnosis& d, report::Page& page) {
  std::vector<const LeftOutPart*> order;
  for (const LeftOutPart& part : d.left_out)
    if (!part.model_residual.empty()) order.push_back(&part);
  std::ranges::stable_sort(order, {},
                           [](const LeftOutPart* part) { return std::max(part->nominal_rms, part->model_rms); });
  if (order.empty()) return;
  draw_left_out(d, *order.back(), true, page);
  if (order.size() > 1) draw_left_out(d, *order[(order.size() - 1) / 2], false, page);
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
  for (const std::string& warning : d.warnings) page.note(model::in_words(warning));
  for (const std::string& note : d.notes) page.note(model::in_words(note), Mood::kInfo);
  if (!d.record.empty()) page.note("To judge it, record " + d.record + ".");
  if (!d.not_modelled.empty()) page.note("model.toml is the nominal model: " + d.not_modelled + ".");
  for (std::size_t r = 0; r < d.data.size(); ++r) draw(d, r, page);
  if (!d.missing.empty()) {
    page.heading("What was left out");
    for (const MissingPart& one : d.missing) {
      page.subheading(model::effect_words(one.effect) + ", p = " + base::number_text(one.probability, 2));
      page.equation(one.formula);
      std::vector<std::vector<std::string>> rows;
      for (const FittedNumber& n : one.numbers)
        rows.push_back(
            {model::number_words(n.name, n.unit), report::interval_text(n.value, n.low95, n.high95), n.unit});
      page.table({"number", "value [95 %]", "unit"}, rows);
    }
  }
  add_moved(d, page);
  page.heading("Readings that were left out, predicted");
  draw_worst_and_median(d, page);
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
    for (const std::string& effect : one.effects) key += (key.empty() ? "" : "+") + effect;
    rows.push_back({model::explanation_words(key), base::number_text(one.weight, 2)});
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
