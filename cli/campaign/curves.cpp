#include "cli/campaign/curves.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/number_text.hpp"

namespace isorig::cli::pieces {
namespace {

using identify::report::Figure;
using identify::report::Mark;
using identify::report::Panel;
using identify::report::Series;

constexpr std::size_t kMostPanels = 24;   // specimens
constexpr std::size_t kMostPoints = 400;  // of one specimen at one pressure: 40 repetitions of the paper's ten ramps
constexpr int kColumns = 4, kColours = 6;

}  // namespace

void Curves::add(const nlohmann::ordered_json& row) {
  const auto& curve = row.at("fit");
  if (!curve.is_object()) return;
  if (const auto& fit = curve.at("fit"); fit.is_object() && fit.at("r_squared").is_number()) {
    const double r_squared = fit.at("r_squared"), step = r_squared - mean_;
    mean_ += step / static_cast<double>(++fits_);
    squares_ += step * (r_squared - mean_);
  }
  if (!row.at("specimen").is_string() || !row.at("pressure_psi").is_number()) return;
  const std::string specimen = row.at("specimen");
  if (!of_.contains(specimen) && of_.size() >= kMostPanels) {
    all_ = false;
    return;
  }
  Points& points = of_[specimen][row.at("pressure_psi").get<double>()];
  for (const auto& one : curve.at("means")) {
    if (!one.at("strain_rate_per_s").is_number() || !one.at("normalized_force").is_number()) continue;
    if (points.force.size() >= kMostPoints) {
      all_ = false;
      return;
    }
    points.rate_per_s.push_back(-one.at("strain_rate_per_s").get<double>());
    points.force.push_back(one.at("normalized_force"));
  }
}

double Curves::r_squared_sd() const {
  return fits_ > 1 ? std::sqrt(squares_ / static_cast<double>(fits_ - 1)) : 0.0;
}

std::optional<Figure> Curves::figure() const {
  Figure out{.name = "force_velocity_curves",
             .caption =
                 "Force-velocity points of all recordings, one panel a specimen, one colour a pressure. Abscissa: "
                 "shortening velocity. Each recording's own page has its fit."};
  if (!all_) out.caption += " Not all fit on this page: campaign.json has the rest.";
  for (const auto& [specimen, pressures] : of_) {
    Panel panel;
    panel.title = specimen;
    panel.x_label = "shortening velocity (1/s)";
    panel.y_label = "F/F0";
    int colour = 0;
    for (const auto& [pressure_psi, points] : pressures) {
      Series series;
      series.x = points.rate_per_s;
      series.y = points.force;
      series.label = base::number_text(pressure_psi, 3) + " psi";
      series.mark = Mark::kPoints;
      series.color = colour++ % kColours;
      if (!series.x.empty()) panel.series.push_back(std::move(series));
    }
    if (!panel.series.empty()) out.panels.push_back(std::move(panel));
  }
  if (out.panels.empty()) return std::nullopt;
  out.columns = std::min(kColumns, static_cast<int>(out.panels.size()));
  return out;
}

}  // namespace isorig::cli::pieces
