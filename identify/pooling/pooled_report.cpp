#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "base/formatted.hpp"
#include "base/whole_file.hpp"
#include "identify/pooling/campaign_grid.hpp"
#include "identify/pooling/pool.hpp"
#include "identify/report/neighbours.hpp"

namespace isorig::identify::pooling {
namespace {

using base::formatted;
using report::Figure;
using report::GridCell;
using report::Mark;
using report::number_text;
using report::Panel;
using report::Series;

constexpr int kColours = 6;  // of the palette; black and grey are left for what is no name

/// A letter and a colour for each effect that some recording names, the most frequent first.
class Key {
 public:
  explicit Key(const PooledCampaign& c) {
    std::map<std::string, std::size_t> count;
    for (const ReadDiagnosis& one : c.recordings)
      for (const ReadEffect& effect : one.missing)
        if (effect.probability > 0.5) ++count[effect.name];
    for (const auto& [name, times] : count) names_.emplace_back(times, name);
    std::ranges::stable_sort(names_, std::greater<>(), &std::pair<std::size_t, std::string>::first);
    for (const auto& [times, name] : names_)
      for (const EffectPool& effect : c.effects)
        if (effect.name == name) words_[name] = effect.words;
  }
  [[nodiscard]] std::string letter(const std::string& name) const {
    const std::size_t at = place(name);
    return at < 26 ? std::string(1, static_cast<char>('A' + at)) : formatted("%zu", at);
  }
  [[nodiscard]] int colour(const std::string& name) const {
    const auto at = static_cast<int>(place(name));
    return at < kColours ? at : 7;
  }
  [[nodiscard]] std::vector<GridCell> key() const {
    std::vector<GridCell> out;
    for (const auto& [times, name] : names_)
      out.push_back({letter(name), colour(name), {}, words_.contains(name) ? words_.at(name) : name});
    out.push_back({"·", -1, {}, "nothing missing"});
    out.push_back({"?", 7, {}, "unknown physics"});
    out.push_back({"–", -1, {}, "cannot be judged"});
    return out;
  }
  [[nodiscard]] std::string words(const std::string& name) const {
    return words_.contains(name) ? words_.at(name) : name;
  }

 private:
  [[nodiscard]] std::size_t place(const std::string& name) const {
    const auto at = std::ranges::find(names_, name, &std::pair<std::size_t, std::string>::second);
    return static_cast<std::size_t>(at - names_.begin());
  }
  std::vector<std::pair<std::size_t, std::string>> names_;
  std::map<std::string, std::string> words_;
};

GridCell cell_of(const ReadDiagnosis& one, const Key& key, const std::filesystem::path& folder) {
  GridCell out;
  std::string names;
  for (const ReadEffect& effect : one.missing) {
    if (effect.probability <= 0.5) continue;
    if (out.text.empty()) out.color = key.colour(effect.name);
    out.text += key.letter(effect.name);
    names += (names.empty() ? "" : ", ") + key.words(effect.name) + formatted(" %.2f", effect.probability);
  }
  if (one.verdict == "unknown_physics") {
    if (out.text.empty()) out.color = 7;
    out.text += "?";
    names += (names.empty() ? "" : ", ") + std::string("unknown physics");
  } else if (one.verdict == "cannot_judge") {
    out.text = "–";
    names = "cannot be judged: " + one.cannot_judge;
  } else if (out.text.empty()) {
    out.text = "·";
    names = "nothing missing";
  }
  out.title = name_of(one) + ": " + names;
  out.href = relative_to(folder, one.folder / one.page);
  return out;
}

report::Grid grid_of(const PooledCampaign& c, const std::filesystem::path& folder,
                     const std::vector<NotPooled>& others) {
  const Key key(c);
  CampaignGrid out(
      "Each letter is a recording and leads to its diagnosis, or to the log of what went wrong. A letter is an effect "
      "that the recording names with a probability above one half; several stand in the order of their importance.");
  for (const GridCell& mark : key.key()) out.key(mark);
  for (const ReadDiagnosis& one : c.recordings)
    out.add(one.place.specimen, one.place.pressure_psi, cell_of(one, key, folder));
  for (const LeftOut& one : c.left_out)
    if (one.place)
      out.add({one.place->specimen, one.place->pressure_psi, NoAnswer::kLeftOut, one.name + ": " + one.why,
               relative_to(folder, one.folder / one.page)});
  for (const NotPooled& one : others) out.add(one);
  return out.grid();
}

Series forest_series(const std::string& label, Mark mark, int colour) {
  Series out;
  out.label = label;
  out.mark = mark;
  out.color = colour;
  return out;
}

/// Actuators along the abscissa: alone, with 95 % bars, and as pooled, beside it.
Panel forest(const PooledCampaign& c, const Quantity& q) {
  Panel out;
  const std::string unit = q.unit.empty() ? "" : " (" + q.unit + ")";
  out.title = "each actuator";
  out.y_label = "value" + unit + (q.pooled.slope ? formatted(" at %.3g psi", q.pooled.mean_pressure_psi) : "");
  Series alone = forest_series("from its own recordings", Mark::kPoints, 7);
  Series pooled = forest_series("pooled", Mark::kPoints, 0), off = forest_series("does not belong", Mark::kPoints, 1);
  const bool named = c.actuators.size() <= 24;
  out.x_label = named ? "" : "actuator, in the order of the grid";
  for (std::size_t i = 0; i < c.actuators.size(); ++i) {
    const auto& one = q.pooled.actuators[i];
    if (named) out.categories.push_back(c.actuators[i]);
    if (one.measurements == 0) continue;
    const auto x = static_cast<double>(i) + (named ? 0.0 : 1.0);
    const bool outlying = std::ranges::find(q.outliers.actuators, i, &Outlier::index) != q.outliers.actuators.end();
    Series& own = outlying ? off : alone;
    own.x.push_back(x - 0.14);
    own.y.push_back(one.unpooled_level);
    own.error.push_back(1.96 * one.unpooled_error);
    pooled.x.push_back(x + 0.14);
    pooled.y.push_back(one.level.value);
    pooled.error.push_back(one.level.high95 - one.level.value);
  }
  out.series = {alone, pooled};
  if (!off.x.empty()) out.series.push_back(off);
  out.horizontals.emplace_back(q.pooled.level.value, "mean");
  return out;
}

/// Every recording over the pressure, and the line that all share.
Panel over_pressure(const PooledCampaign& c, const Quantity& q) {
  Panel out;
  out.title = "over the pressure";
  out.x_label = "nominal pressure (psi)";
  out.y_label = q.unit.empty() ? std::string("value") : "value (" + q.unit + ")";
  Series points = forest_series("recordings", Mark::kPoints, 7), line = forest_series("pooled", Mark::kLine, 0);
  const double width = c.pressures_psi.back() - c.pressures_psi.front();
  for (const Measurement& m : q.measurements) {
    // Actuators beside each other, so that they do not hide each other.
    const double aside = c.actuators.size() < 2
                             ? 0.0
                             : (static_cast<double>(m.actuator) / static_cast<double>(c.actuators.size() - 1) - 0.5);
    points.x.push_back(m.pressure_psi + 0.06 * aside * width);
    points.y.push_back(m.value);
  }
  points.width = 1.8;
  const Pooled& p = q.pooled;
  for (const double pressure : {c.pressures_psi.front(), c.pressures_psi.back()}) {
    line.x.push_back(pressure);
    line.y.push_back(p.level.value + p.slope->value * (pressure - p.mean_pressure_psi));
  }
  out.series = {points, line};
  return out;
}

Figure figure_of(const PooledCampaign& c, const Quantity& q) {
  Figure out;
  out.name = "pooled_" + q.key;
  std::ranges::replace_if(
      out.name, [](char ch) { return std::isalnum(static_cast<unsigned char>(ch)) == 0 && ch != '-' && ch != '_'; },
      '_');
  const std::string unit = q.unit.empty() ? "" : " " + q.unit;
  out.caption = q.words + formatted(", %zu recordings. Mean actuator ", q.measurements.size()) +
                report::interval_text(q.pooled.level.value, q.pooled.level.low95, q.pooled.level.high95) + unit;
  if (q.pooled.slope)
    out.caption += formatted(" at %.3g psi; per psi ", q.pooled.mean_pressure_psi) +
                   report::interval_text(q.pooled.slope->value, q.pooled.slope->low95, q.pooled.slope->high95) + unit +
                   formatted(" (evidence for a change with the pressure: ln %.1f)", *q.pooled.log_evidence_of_slope);
  out.caption += ". Actuators spread by " + number_text(q.pooled.level_sd.value, 2) + unit + ", repetitions by " +
                 number_text(q.pooled.repetition_sd.value, 2) + unit +
                 " beyond what their intervals state. Bars are 95 %, with an error of the law that would move all of "
                 "them together; pooled values are drawn towards the others, the more the less an actuator's own "
                 "recordings say.";
  out.panels.push_back(forest(c, q));
  if (q.pooled.slope) out.panels.push_back(over_pressure(c, q));
  out.columns = static_cast<int>(out.panels.size());
  return out;
}

void add_effects(report::Page& page, const PooledCampaign& c) {
  page.heading("Which effects, in how many actuators");
  page.paragraph(
      "Evidence is added over the recordings of an actuator: the prior that each diagnosis has used is divided "
      "out, recordings that could not be judged or could not show the effect are counted apart, and no number "
      "of recordings makes a name surer than the calibration of the diagnosis allows (0.985).");
  constexpr double kUnlikely = 0.05;
  std::vector<std::vector<std::string>> likely, others;
  for (const EffectPool& effect : c.effects) {
    const Presence& p = effect.presence;
    std::size_t named = 0, judged = 0, nothing = 0;
    for (const auto& one : p.actuators) {
      named += one.named;
      judged += one.judged;
      nothing += one.unjudged;
    }
    (named > 0 || p.anywhere > kUnlikely ? likely : others)
        .push_back({effect.words, formatted("%zu of %zu", p.present(), p.judged()), formatted("%.2f", p.anywhere),
                    formatted("%zu of %zu", named, judged), formatted("%zu", nothing)});
  }
  const std::vector<std::string> header{"effect", "in actuators", "in any: probability", "named in recordings",
                                        "recordings that say nothing"};
  if (!likely.empty()) page.table(header, likely);
  if (others.empty()) return;
  page.begin_more(formatted("%zu effects that no recording names", others.size()));
  page.table(header, others);
  page.end_more();
}

/// Recordings that are answered and cannot be pooled.
void add_left_out(report::Page& page, const PooledCampaign& c, const std::filesystem::path& folder) {
  constexpr std::size_t kMost = 200;
  std::vector<std::vector<std::string>> rows, hrefs;
  for (const LeftOut& one : c.left_out) {
    if (rows.size() == kMost) break;
    rows.push_back({one.name, one.why});
    hrefs.push_back({one.page.empty() ? "" : report::as_link(relative_to(folder, one.folder / one.page))});
  }
  page.table({"recording that is left out", "why"}, rows, {}, hrefs);
  if (rows.size() < c.left_out.size())
    page.paragraph(formatted("The first %zu of %zu; pooled.json lists all.", rows.size(), c.left_out.size()));
}

}  // namespace

void add_pooled_sections(report::Page& page, const PooledCampaign& c, const std::filesystem::path& folder,
                         const std::vector<NotPooled>& others) {
  page.heading("What the campaign says");
  page.list(c.findings);
  page.heading("Every recording");
  page.grid(grid_of(c, folder, others));
  add_effects(page, c);
  if (!c.quantities.empty()) {
    page.heading("Numbers, pooled");
    for (const Quantity& one : c.quantities) {
      page.subheading(one.words);
      page.figure(figure_of(c, one));
    }
  }
  if (!c.not_compared.empty() || !c.left_out.empty()) page.heading("What is in no pool");
  if (!c.not_compared.empty()) page.list(c.not_compared);
  if (!c.left_out.empty()) add_left_out(page, c, folder);
}

void write_pooled(const PooledCampaign& c, const std::filesystem::path& folder, const report::Made& made) {
  std::filesystem::create_directories(folder);
  base::write_whole_file(folder / "pooled.json", pooled_json(c, folder).dump(1) + "\n");
  report::Page page("Campaign", "One diagnosis of all recordings");
  page.made(made);
  page.subtitle(formatted("%zu recordings of %zu actuators at %zu %s", c.recordings.size(), c.actuators.size(),
                          c.pressures_psi.size(), c.pressures_psi.size() == 1 ? "pressure" : "pressures"));
  page.link("pooled.json", "pooled.json");
  const bool missing = std::ranges::any_of(c.effects, [](const EffectPool& e) { return e.presence.present() > 0; });
  const auto recordings_with = [&](const char* verdict) {
    return std::ranges::count(c.recordings, verdict, &ReadDiagnosis::verdict);
  };
  const bool unknown = recordings_with("unknown_physics") > 0;
  const bool unjudged = static_cast<std::size_t>(recordings_with("cannot_judge")) == c.recordings.size();
  page.lead(missing               ? report::Mood::kInfo
            : unknown || unjudged ? report::Mood::kWarning
                                  : report::Mood::kGood,
            missing    ? "physics is missing"
            : unknown  ? "unknown physics"
            : unjudged ? "nothing can be judged"
                       : "nothing is missing",
            c.findings.front());
  add_pooled_sections(page, c, folder);
  page.write(folder, "campaign-report.html");
}

}  // namespace isorig::identify::pooling
