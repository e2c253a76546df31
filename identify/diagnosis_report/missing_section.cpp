#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/number_text.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/search/resolution.hpp"
#include "identify/diagnosis_report/argument.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "model/number_sheet.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

using model::effect_words;
using report::Figure;
using report::Mark;
using report::number_text;
using report::Page;
using report::Panel;

/// "It stands at ..." where that speaks against the law, by the rule that withholds such a model.
std::string bound_text(const NamedValue& value) {
  for (const auto& p : value.law->parameters) {
    if (p.name != value.name || p.fixed || !at_wrong_bound(p, value.value)) continue;
    const bool low = to_search(p, value.value) < 0.5 * (to_search(p, p.lower) + to_search(p, p.upper));
    return std::string("It stands at the ") + (low ? "lower" : "upper") +
           " end of its range: the law may be another one. ";
  }
  return {};
}

/// "velocity (mm/s)" of "rate_mm_s".
std::string axis_text(std::string_view of) {
  constexpr std::array<std::pair<std::string_view, std::string_view>, 8> labels{
      {{"rate_mm_s", "velocity (mm/s)"},
       {"position_mm", "position (mm)"},
       {"time_s", "time (s)"},
       {"time_since_step_s", "time since a step began (s)"},
       {"pressure_psi", "pressure (psi)"},
       {"travel_mm", "travel (mm)"},
       {"load_N", "force without it (N)"},
       {"acceleration_mm_s2", "acceleration (mm/s2)"}}};
  const auto found = std::ranges::find(labels, of, &std::pair<std::string_view, std::string_view>::first);
  return std::string(found == labels.end() ? of : found->second);
}

std::string list_text(const std::vector<std::string_view>& words) {
  std::string out;
  for (const std::string_view word : words) out += (out.empty() ? "" : ", ") + std::string(word);
  return out;
}

Panel shape_panel(const Shape& shape, const std::string& words) {
  report::Series band;
  band.label = "95 % by its numbers";
  band.mark = Mark::kBand;
  band.color = 1;
  band.x = shape.x;
  band.y = shape.low95;
  band.y2 = shape.high95;
  report::Series line;
  line.label = words;
  line.color = 1;
  line.x = shape.x;
  line.y = shape.y;
  Panel panel{.x_label = axis_text(shape.of), .y_label = "force it adds (N)"};
  // There and back a band would cross itself.
  if (std::ranges::is_sorted(shape.x)) panel.series.push_back(std::move(band));
  panel.series.push_back(std::move(line));
  return panel;
}

Figure shape_figure(const Argument& a, std::size_t part, const MissingEffect& missing, const std::string& words) {
  const std::vector<NamedValue>& numbers = missing.parameters;
  const Series& series = a.study.series[a.stretch.series];
  const Contribution all = contribution(series, a.study.diagnosis, part, numbers);
  const double margin = 0.5 * (a.stretch.to_s - a.stretch.from_s);
  Contribution near;
  for (std::size_t i = 0; i < all.t_s.size(); ++i) {
    if (all.t_s[i] < a.stretch.from_s - margin || all.t_s[i] > a.stretch.to_s + margin) continue;
    near.t_s.push_back(all.t_s[i]);
    near.position_mm.push_back(all.position_mm[i]);
    near.force_N.push_back(all.force_N[i]);
    near.half_band_N.push_back(all.half_band_N[i]);
  }
  // As paths of means: a band has to lie round the line that is drawn.
  const auto line = path(near.t_s, near.t_s, near.force_N, words, 1, 700);
  const auto half = path(near.t_s, near.t_s, near.half_band_N, "", 1, 700);
  report::Series band;
  band.label = "95 % by its numbers";
  band.mark = Mark::kBand;
  band.color = 1;
  band.x = line.x;
  for (std::size_t i = 0; i < line.x.size(); ++i) {
    band.y.push_back(line.y[i] - half.y[i]);
    band.y2.push_back(line.y[i] + half.y[i]);
  }
  Panel over_time{.x_label = "time (s)", .y_label = "force it adds (N)"};
  over_time.series = {band, line};
  over_time.shaded = {{a.stretch.from_s, a.stretch.to_s}};
  const std::string caption = "What " + words +
                              " does to the force, by the fitted law: the model's force minus that without it, round "
                              "the stretch above, with the "
                              "band that its numbers' 95 % intervals give (one at a time, added in squares)";
  if (missing.shape.x.empty()) return {"shape-" + std::to_string(part), caption + ".", {over_time}};
  return {"shape-" + std::to_string(part),
          caption +
              "; right in a motion through the recorded range, over what it depends on, with the band of all fitted "
              "numbers.",
          {over_time, shape_panel(missing.shape, words)},
          2};
}

void numbers_table(Page& page, const std::vector<NamedValue>& numbers) {
  std::vector<std::vector<std::string>> rows;
  for (const NamedValue& value : numbers) {
    const auto* sheet = model::sheet_of(*value.law, value.name);
    const std::string_view unit = model::unit_of(*value.law, value.name);
    rows.push_back({model::number_words(value.key(), unit), report::interval_text(value.value, value.low, value.high),
                    model::unit_words(unit), sheet == nullptr ? std::string() : std::string(sheet->what),
                    bound_text(value) + (sheet == nullptr ? std::string() : std::string(sheet->errors))});
  }
  page.table({"number", "value [95 %]", "unit", "what it is", "what makes it wrong"}, rows);
}

std::string sure_text(double probability) {
  if (probability >= 0.95) return "Nearly certain";
  if (probability >= 0.8) return "Probable";
  if (probability >= 0.5) return "More likely than not";
  return "A possibility";
}

void add_effect(Page& page, const Argument& a, const MissingEffect& missing, std::vector<bool>& drawn) {
  const Diagnosis& d = a.study.diagnosis;
  const std::string words = effect_words(missing.effect->name);
  page.subheading(words);
  page.paragraph(std::string(missing.effect->what));
  page.equation(missing.formula);
  page.facts(
      {{"How sure", sure_text(missing.probability), "probability " + number_text(missing.probability, 3)},
       {"How large", number_text(missing.size_N, 3) + " N, 99 % of the readings stay below",
        number_text(d.noise_N > 0.0 ? missing.size_N / d.noise_N : std::nan(""), 2) + " times the noise"},
       {"Acts on", std::string(missing.effect->traits.acts_on), std::string(model::side_of(missing.effect->stage))},
       {"Depends on", list_text(missing.effect->traits.depends_on)},
       {"In the catalogue", std::string(missing.effect->name), "law " + missing.law}});
  const bool modelled =
      std::ranges::find(d.not_modelled.names, std::string(missing.effect->name)) == d.not_modelled.names.end();
  std::size_t part = d.model.parts.size();
  for (std::size_t i = 0; modelled && i < d.model.parts.size(); ++i)
    if (d.model.parts[i].physics == missing.effect && !drawn[i]) part = std::min(part, i);
  if (part < d.model.parts.size()) {
    drawn[part] = true;
    page.figure(shape_figure(a, part, missing, words));
  }
  numbers_table(page, missing.parameters);
  page.note("What would show it, and what it is mistaken for: " + std::string(missing.effect->reveals),
            report::Mood::kInfo);
  if (!modelled) page.note(model::in_words(d.not_modelled.text()));
}

void add_law(Page& page, const DiscoveredLaw& law) {
  page.paragraph(law.in_words + ".");
  page.paragraph(law.formula + ". Inclusion probability " + base::number_text(law.inclusion_probability, 3) +
                 ": the weight of all sets of at most three products that hold it.");
  numbers_table(page, law.parameters);
}

}  // namespace

void add_missing(Page& page, const Argument& a) {
  const Diagnosis& d = a.study.diagnosis;
  if (d.missing.empty() && d.described_by.empty()) return;
  page.heading("What was left out");
  std::vector<bool> drawn(d.model.parts.size(), false);
  for (const MissingEffect& missing : d.missing) add_effect(page, a, missing, drawn);
  if (d.described_by.empty()) return;
  page.subheading("what the catalogue does not know");
  if (d.discovered.empty())
    page.paragraph("It is described, not explained, as a function of " + d.described_by +
                   ": a table in model.toml. A description predicts only what is like what it was learnt from.");
  for (const DiscoveredLaw& law : d.discovered) add_law(page, law);
  for (std::size_t i = 0; i < d.model.parts.size(); ++i) {
    const auto& part = d.model.parts[i];
    const bool in_nominal =
        std::ranges::any_of(d.nominal.parts, [&](const auto& n) { return n.physics == part.physics; });
    if (drawn[i] || in_nominal || model::is_effect(*part.physics)) continue;
    drawn[i] = true;
    page.figure(shape_figure(a, i, {}, "the part without a name"));
  }
}

}  // namespace isorig::identify
