#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace isorig::identify::report {

/// Figures of reports, as data: the page draws them (web/src/shared/chart.tsx). Text is UTF-8 and is shown as it is;
/// NaN leaves a gap.

enum class Mark {
  kLine,
  kDashes,
  kPoints,
  kLinePoints,  ///< points joined by a dashed line
  kSteps,
  kBand,  ///< filled between y and y2
  kBars,  ///< a box for each point
};

struct Series {
  std::vector<double> x;
  std::vector<double> y;
  std::string label{};  ///< in the key; empty: not in it
  Mark mark = Mark::kLine;
  std::vector<double> error{};        ///< +- bars, empty: none
  std::vector<double> y2{};           ///< for kBand
  int color = -1;                     ///< of the palette (0..7, colour-blind safe, Okabe and Ito); -1: next
  double width = 0.0;                 ///< of a line, or radius of a point, in CSS pixels; 0: the mark's own
  std::vector<double> error_below{};  ///< what the bars of `error` reach below the point by; empty: as above it
};

struct Panel {
  std::string title{};
  std::string x_label{};  ///< with its unit: "time (s)"
  std::string y_label{};
  std::vector<Series> series{};
  std::optional<std::pair<double, double>> x_range{};
  std::optional<std::pair<double, double>> y_range{};
  bool log_x = false;
  bool log_y = false;
  /// Lines: where and what they mean.
  std::vector<std::pair<double, std::string>> verticals{};
  std::vector<std::pair<double, std::string>> horizontals{};
  std::vector<std::pair<double, double>> shaded{};  ///< stretches of x, behind the data
  std::vector<std::string> categories{};            ///< names for x = 0, 1, 2 ...
  double aspect = 0.0;                              ///< height over width; 0: by the number of columns
};

struct Figure {
  std::string name;     ///< of its files: letters, digits, '-', '_'
  std::string caption;  ///< for people: what is seen, and what of it is simulated
  std::vector<Panel> panels{};
  int columns = 1;
  bool linked = false;  ///< the panels share their abscissa: zooming into one zooms into all
};

/// Throws std::invalid_argument for a figure that cannot be drawn (unequal lengths, no panel, a name that is no file
/// name).
[[nodiscard]] nlohmann::ordered_json figure_json(const Figure& figure);

/// A long signal for a page: lowest to highest of equal stretches of x as a band, and the mean as a line, in one
/// colour. Nothing is skipped: an outlier of one reading reaches the band's edge. Short signals (at most `stretches`
/// points) come as a line alone. x need not increase; values that are not finite are left out.
[[nodiscard]] std::vector<Series> enveloped(std::span<const double> x, std::span<const double> y,
                                            const std::string& label, int color, std::size_t stretches = 900);

/// A band for a page: from the lowest `low` to the highest `high` of equal stretches of x, which increases.
[[nodiscard]] Series enveloped_band(std::span<const double> x, std::span<const double> low,
                                    std::span<const double> high, const std::string& label, int color,
                                    std::size_t stretches = 900);

}  // namespace isorig::identify::report
