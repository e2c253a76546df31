#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <utility>

#include "identify/diagnosis_report/argument.hpp"
#include "identify/diagnosis_report/left_out_motion.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

using model::effect_words;
using model::number_words;
using report::Figure;
using report::Mark;
using report::number_text;
using report::Page;
using report::Panel;

/// Rms of both models for each kind of motion that was left out.
Figure left_out_figure(const Diagnosis& d) {
  Panel panel{.y_label = "rms error of the prediction (N)"};
  report::Series nominal, model;
  nominal.label = "nominal model";
  model.label = "with what it lacked";
  nominal.mark = model.mark = Mark::kBars;
  nominal.color = 0;
  model.color = 1;
  const auto add = [&](const std::string& name, const LeftOut& one) {
    const auto at = static_cast<double>(panel.categories.size());
    panel.categories.push_back(name);
    nominal.x.push_back(at);
    nominal.y.push_back(one.nominal_rmse_N);
    model.x.push_back(at);
    model.y.push_back(one.model_rmse_N);
  };
  if (d.heldout.all) add("a quarter of the " + blocks_text(d.heldout.blocks), *d.heldout.all);
  for (const LeftOut& one : d.heldout.left_out) add(one.value.empty() ? one.by : one.value, one);
  panel.series = {nominal, model};
  panel.horizontals = {{d.noise_N, "noise"}};
  panel.aspect = 0.4;
  return {"left_out", "Motions left out of the fit, one kind at a time, and predicted by both models.", {panel}};
}

/// A number that the nominal model and the one with what it lacked have in common.
struct Moved {
  std::string part, number, unit;
  NamedValue nominal, model;

  [[nodiscard]] double change() const {
    return nominal.value != 0.0 ? (model.value - nominal.value) / std::abs(nominal.value) : std::nan("");
  }
};

std::vector<Moved> moved_numbers(const Diagnosis& d) {
  std::vector<Moved> out;
  std::set<std::size_t> taken;
  std::map<const model::Physics*, int> of_a_kind;
  for (std::size_t n = 0; n < d.nominal.parts.size(); ++n) {
    const model::Part& before = d.nominal.parts[n];
    const int count = ++of_a_kind[before.physics];
    const auto several = std::ranges::count(d.nominal.parts, before.physics, &model::Part::physics);
    const std::string part = effect_words(before.physics->name) + (several > 1 ? " " + std::to_string(count) : "");
    for (std::size_t m = 0; m < d.model.parts.size(); ++m) {
      const model::Part& after = d.model.parts[m];
      if (after.physics != before.physics || after.law != before.law || !taken.insert(m).second) continue;
      for (std::size_t k = 0; k < d.nominal_numbers[n].size(); ++k) {
        const NamedValue &was = d.nominal_numbers[n][k], &is = d.model_numbers[m][k];
        const std::string_view unit = model::unit_of(*before.law, was.name);
        out.push_back({part, number_words(was.name, unit), model::unit_words(unit), was, is});
      }
      break;
    }
  }
  return out;
}

/// Each number in its unit, in both models, with both intervals.
Figure moved_figure(const std::vector<Moved>& moved) {
  constexpr std::size_t kMost = 12;
  Figure figure{"moved",
                "The numbers that both models have, each in its unit: in the nominal model alone, and with what it "
                "lacked beside it. Bars are 95 % intervals.",
                {},
                4};
  for (const Moved& m : moved) {
    if (figure.panels.size() == kMost) break;
    Panel panel{.title = m.part + ", " + m.number,
                .y_label = m.unit.empty() ? m.number : m.number + " (" + m.unit + ")"};
    panel.categories = {"alone", "with it"};
    for (const bool alone : {true, false}) {
      const NamedValue& value = alone ? m.nominal : m.model;
      const auto bar = [](double length) { return std::isfinite(length) ? length : std::nan(""); };
      report::Series point;
      point.label = alone ? "nominal model alone" : "with what it lacked";
      point.mark = Mark::kPoints;
      point.color = alone ? 0 : 1;
      point.x = {alone ? 0.0 : 1.0};
      point.y = {value.value};
      point.error = {bar(value.high - value.value)};
      point.error_below = {bar(value.value - value.low)};
      panel.series.push_back(std::move(point));
    }
    figure.panels.push_back(std::move(panel));
  }
  return figure;
}

void add_moved(Page& page, const Diagnosis& d) {
  const auto moved = moved_numbers(d);
  if (moved.empty() || d.model.parts.size() == d.nominal.parts.size()) return;
  std::vector<std::vector<std::string>> rows;
  const auto text = [](const NamedValue& v) { return report::interval_text(v.value, v.low, v.high); };
  for (const Moved& m : moved)
    rows.push_back({m.part, m.number, m.unit, text(m.nominal), text(m.model),
                    std::isfinite(m.change()) ? number_text(100.0 * m.change(), 3) : "-"});
  page.subheading("How the model's own numbers moved");
  page.paragraph(
      "What a model lacks, its other numbers take over as well as they can. With the missing part beside "
      "them they go to where they belong.");
  page.figure(moved_figure(moved));
  page.table({"part", "number", "unit", "nominal model alone [95 %]", "with what it lacked [95 %]", "change (%)"},
             rows);
}

/// The worst of the blocks where there are many, in the order of time.
void add_each_block(Page& page, const Study& study) {
  constexpr std::size_t kShown = 60;
  const HeldoutStudy& heldout = study.diagnosis.heldout;
  std::vector<BlockError> shown = heldout.each_block;
  if (shown.empty()) return;
  const std::size_t all = shown.size();
  if (all > kShown) {
    std::ranges::stable_sort(shown, std::greater<>(), &BlockError::model_rmse_N);
    shown.resize(kShown);
    std::ranges::stable_sort(shown, {}, [](const BlockError& b) { return std::pair(b.series, b.t_start_s); });
  }
  std::vector<std::vector<std::string>> rows;
  for (const BlockError& one : shown) {
    rows.push_back({number_text(one.t_start_s, 6), number_text(one.t_end_s, 6), number_text(one.readings, 6),
                    number_text(one.nominal_rmse_N, 3), number_text(one.model_rmse_N, 3)});
    if (study.series.size() > 1) rows.back().insert(rows.back().begin(), one.recording);
  }
  std::vector<std::string> header{"from (s)", "to (s)", "readings", "nominal model, rms (N)", "with it, rms (N)"};
  if (study.series.size() > 1) header.insert(header.begin(), "recording");
  const std::string blocks = blocks_text(heldout.blocks);
  page.table(header, rows,
             all > shown.size() ? "Of " + std::to_string(all) + " " + blocks + " the " + std::to_string(shown.size()) +
                                      " that model.toml predicts worst; diagnosis.json has more"
                                : "Each of the " + blocks + ", predicted by models that were fitted without it");
}

/// "coulomb_friction.force_N" in words, with its unit.
std::pair<std::string, std::string> number_and_unit(const model::ModelSpec& spec, const std::string& key) {
  const auto dot = key.find('.');
  const std::string part = key.substr(0, dot), number = key.substr(dot + 1);
  for (const model::Part& each : spec.parts) {
    if (each.physics->name != part) continue;
    const std::string_view unit = model::unit_of(*each.law, number);
    if (unit.empty()) continue;
    return {effect_words(part) + ", " + number_words(number, unit), model::unit_words(unit)};
  }
  return {effect_words(part) + ", " + number_words(number, ""), ""};
}

}  // namespace

void add_predictions(Page& page, const Argument& a) {
  const Diagnosis& d = a.study.diagnosis;
  page.heading("What was left out of the fit, predicted");
  std::vector<std::vector<std::string>> errors{
      {"nominal model, all recordings", number_text(d.nominal_errors.train_rmse_N)},
      {"with what it lacked, all recordings", number_text(d.model_errors.train_rmse_N)}};
  if (d.heldout.all) {
    const std::string blocks = blocks_text(d.heldout.blocks);
    errors.push_back({"nominal model, a quarter of the " + blocks + " left out in turn",
                      number_text(d.heldout.all->nominal_rmse_N)});
    errors.push_back({"with what it lacked, the same", number_text(d.heldout.all->model_rmse_N)});
  }
  errors.push_back({"noise of the force channel", number_text(d.noise_N)});
  page.table({"", "rms (N)"}, errors, "Measured minus simulated force");
  if (d.heldout.all || !d.heldout.left_out.empty()) page.figure(left_out_figure(d));
  for (const LeftOutStretch& stretch : d.heldout.to_draw)
    if (Figure figure = left_out_motion(a.study, stretch); !figure.panels.empty()) page.figure(figure);
  if (!d.heldout.left_out.empty() || !d.heldout.each_block.empty()) {
    page.begin_more("In numbers");
    std::vector<std::vector<std::string>> rows;
    for (const LeftOut& one : d.heldout.left_out)
      rows.push_back({one.by, one.value, number_text(one.nominal_rmse_N), number_text(one.model_rmse_N)});
    if (!rows.empty()) page.table({"left out", "", "nominal model, rms (N)", "with it, rms (N)"}, rows);
    add_each_block(page, a.study);
    rows.clear();
    for (const Stability& one : d.heldout.stability) {
      const auto [number, unit] = number_and_unit(d.model, one.parameter);
      rows.push_back({number, unit, number_text(one.value), number_text(one.lowest), number_text(one.highest)});
    }
    if (!rows.empty())
      page.table({"number of the model", "unit", "from everything", "lowest", "highest"}, rows,
                 "The model's numbers over these fits: what hangs on one motion is no property of the specimen");
    page.end_more();
  }
  add_moved(page, d);
}

}  // namespace isorig::identify
