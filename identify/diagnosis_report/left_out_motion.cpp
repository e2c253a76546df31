#include "identify/diagnosis_report/left_out_motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "identify/diagnose/forecast.hpp"
#include "identify/diagnosis_report/colors.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify {
namespace {

using report::number_text;
using report::Panel;

constexpr const char* kBand = "95 % band";

void add(Panel& panel, std::vector<report::Series> all) {
  for (auto& series : all) panel.series.push_back(std::move(series));
}

std::vector<double> minus(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> out(a.size());
  std::ranges::transform(a, b, out.begin(), [](double x, double y) { return x - y; });
  return out;
}

/// An ordinate for the lines, with room for as much of the band as they span: numbers that nothing that was kept
/// determines give a band of thousands of newtons, in which nothing else would be seen.
std::pair<double, double> ordinate(const std::vector<const std::vector<double>*>& lines, const std::vector<double>& low,
                                   const std::vector<double>& high) {
  constexpr double kMargin = 0.05;
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (const auto* line : lines) {
    const auto [from, to] = std::ranges::minmax(*line);
    least = std::min(least, from);
    most = std::max(most, to);
  }
  const double span = std::max(most - least, 1e-9);
  const double from = std::min(least, std::max(std::ranges::min(low), least - span)),
               to = std::max(most, std::min(std::ranges::max(high), most + span));
  return {from - kMargin * (to - from), to + kMargin * (to - from)};
}

/// The band leaves the picture.
bool is_cut(const PredictedStretch& shown, const std::pair<double, double>& range) {
  return std::ranges::min(shown.low95_N) < range.first || std::ranges::max(shown.high95_N) > range.second;
}

std::string span_text(const PredictedStretch& of) {
  return number_text(of.t_s.front(), 5) + " to " + number_text(of.t_s.back(), 5) + " s";
}

/// What was left out, with what, and what of it is drawn.
std::string what_text(const Study& study, const LeftOutStretch& stretch, const PredictedStretch& all,
                      const PredictedStretch& drawn) {
  const std::string recording = study.series.size() > 1 ? " of " + study.series[stretch.series].name : std::string();
  std::string text = stretch.worst ? "The worst of " : "The median of ";
  text += std::to_string(stretch.of);
  if (stretch.by == "block")
    text += " " + blocks_text(study.diagnosis.heldout.blocks) + ", " + span_text(all) + recording +
            ": left out of the fits with a quarter of all. ";
  else
    text += " kinds of motion (velocities, amplitudes, waveforms, recordings), " + stretch.by + " " + stretch.value +
            ": left out of the fits altogether, here " + span_text(all) + recording + ". ";
  if (drawn.t_s.size() < all.t_s.size()) text += "Drawn where most of the error is. ";
  text += "Below, measured minus predicted. ";
  return text;
}

std::string errors_text(const Study& study, const LeftOutStretch& stretch, const PredictedStretch& all) {
  const bool same = stretch.model.parts.size() == stretch.nominal.parts.size();
  const bool found = study.diagnosis.model.parts.size() != study.diagnosis.nominal.parts.size();
  std::string text = "Over all that is left out of this kind, the nominal model errs by ";
  if (stretch.by == "block") text = "The nominal model errs by ";
  text += number_text(stretch.nominal_rmse_N, 3) + " N rms";
  if (found) text += ", with what it lacked by " + number_text(stretch.model_rmse_N, 3) + " N";
  text += "; " + number_text(100.0 * all.inside(), 3) + " % of " + std::to_string(all.t_s.size()) +
          " readings lie in the band that was stated for 95 %.";
  if (found && same)
    text += " What was kept would not have shown the missing physics: there the nominal model stands for both.";
  return text;
}

}  // namespace

double PredictedStretch::inside() const {
  if (t_s.empty()) return std::numeric_limits<double>::quiet_NaN();
  double count = 0.0;
  for (std::size_t i = 0; i < t_s.size(); ++i) count += force_N[i] >= low95_N[i] && force_N[i] <= high95_N[i];
  return count / static_cast<double>(t_s.size());
}

PredictedStretch PredictedStretch::between(double from_s, double to_s) const {
  PredictedStretch out;
  for (std::size_t i = 0; i < t_s.size(); ++i) {
    if (t_s[i] < from_s || t_s[i] > to_s) continue;
    out.t_s.push_back(t_s[i]);
    out.force_N.push_back(force_N[i]);
    out.nominal_N.push_back(nominal_N[i]);
    out.model_N.push_back(model_N[i]);
    out.low95_N.push_back(low95_N[i]);
    out.high95_N.push_back(high95_N[i]);
  }
  return out;
}

std::pair<double, double> worst_part(const PredictedStretch& stretch, double noise_N) {
  constexpr double kShare = 0.8, kNoises = 2.0, kMargin = 1.0;
  constexpr std::size_t kFewest = 40;
  const std::size_t n = stretch.t_s.size();
  std::vector<double> sum{0.0};  // up to each reading
  for (std::size_t i = 0; i < n; ++i) {
    const double most_N = std::max(std::abs(stretch.force_N[i] - stretch.nominal_N[i]),
                                   std::abs(stretch.force_N[i] - stretch.model_N[i]));
    sum.push_back(sum.back() + std::max(most_N * most_N - kNoises * kNoises * noise_N * noise_N, 0.0));
  }
  if (n <= kFewest || !(sum.back() > 0.0)) return {stretch.t_s.front(), stretch.t_s.back()};
  double best_s = std::numeric_limits<double>::infinity();
  std::size_t first = 0, last = n - 1;
  for (std::size_t from = 0, to = 0; from < n; ++from) {
    to = std::max(to, std::min(from + kFewest, n) - 1);
    while (to + 1 < n && sum[to + 1] - sum[from] < kShare * sum.back()) ++to;
    if (sum[to + 1] - sum[from] < kShare * sum.back()) break;
    if (stretch.t_s[to] - stretch.t_s[from] >= best_s) continue;
    best_s = stretch.t_s[to] - stretch.t_s[from];
    first = from;
    last = to;
  }
  const double margin_s = kMargin * (stretch.t_s[last] - stretch.t_s[first]);
  return {std::max(stretch.t_s.front(), stretch.t_s[first] - margin_s),
          std::min(stretch.t_s.back(), stretch.t_s[last] + margin_s)};
}

std::string blocks_text(BlockKind kind) {
  switch (kind) {
    case BlockKind::kNone:
      break;
    case BlockKind::kMoves:
      return "moves";
    case BlockKind::kStrokes:
      return "strokes";
    case BlockKind::kPressureStrokes:
      return "rises and falls of the pressure";
    case BlockKind::kStretches:
      return "stretches of time";
  }
  return "";
}

PredictedStretch predicted(const Study& study, const LeftOutStretch& stretch) {
  const Series& series = study.series[stretch.series];
  const std::vector<bool>* usable = stretch.series < study.usable.size() && !study.usable[stretch.series].empty()
                                        ? &study.usable[stretch.series]
                                        : nullptr;
  const Forecast nominal = forecast(stretch.nominal, series.excitation),
                 model = forecast(stretch.model, series.excitation);
  PredictedStretch out;
  for (std::size_t row = series.first_row[stretch.first_bin]; row < series.first_row[stretch.end_bin]; ++row) {
    if (usable != nullptr && !(*usable)[row]) continue;
    out.t_s.push_back(series.excitation.instants[row].t_s);
    out.force_N.push_back(series.recording.frame.force_N[row]);
    out.nominal_N.push_back(nominal.force_N[row]);
    out.model_N.push_back(model.force_N[row]);
    out.low95_N.push_back(model.low95_N[row]);
    out.high95_N.push_back(model.high95_N[row]);
  }
  return out;
}

report::Figure left_out_motion(const Study& study, const LeftOutStretch& stretch, std::size_t stretches) {
  const PredictedStretch all = predicted(study, stretch);
  const std::string name =
      std::string("left-out-") + (stretch.worst ? "worst" : "median") + (stretch.by == "block" ? "" : "-kind");
  if (all.t_s.empty()) return {name, "", {}};
  const auto [from_s, to_s] = worst_part(all, study.diagnosis.noise_N);
  const PredictedStretch shown = all.between(from_s, to_s);
  const bool found = study.diagnosis.model.parts.size() != study.diagnosis.nominal.parts.size();
  const int banded = found ? kModel : kNominal;
  Panel force{.y_label = "force (N)"};
  force.series.push_back(report::enveloped_band(shown.t_s, shown.low95_N, shown.high95_N, kBand, banded, stretches));
  add(force, report::enveloped(shown.t_s, shown.force_N, "measured", kMeasured, stretches));
  force.series.push_back(report::enveloped(shown.t_s, shown.nominal_N, "nominal model", kNominal, stretches).back());
  if (found)
    force.series.push_back(
        report::enveloped(shown.t_s, shown.model_N, "with what it lacked", kModel, stretches).back());
  force.aspect = 0.32;
  force.y_range = ordinate({&shown.force_N, &shown.nominal_N, &shown.model_N}, shown.low95_N, shown.high95_N);
  Panel error{.x_label = "time (s)", .y_label = "prediction error (N)"};
  const std::vector<double> nominal_error = minus(shown.force_N, shown.nominal_N),
                            model_error = minus(shown.force_N, shown.model_N),
                            low = minus(shown.low95_N, shown.model_N), high = minus(shown.high95_N, shown.model_N);
  error.series.push_back(report::enveloped_band(shown.t_s, low, high, kBand, banded, stretches));
  add(error, report::enveloped(shown.t_s, nominal_error, "nominal model", kNominal, stretches));
  if (found) add(error, report::enveloped(shown.t_s, model_error, "with what it lacked", kModel, stretches));
  error.aspect = 0.25;
  error.y_range = ordinate({&nominal_error, &model_error}, low, high);
  std::string caption = what_text(study, stretch, all, shown) + errors_text(study, stretch, all);
  if (is_cut(shown, *force.y_range))
    caption += " The band is wider than the picture: what was kept does not determine every number.";
  report::Figure figure{name, caption, {force, error}};
  figure.linked = true;
  return figure;
}

}  // namespace isorig::identify
