#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace isorig::identify::report {

/// Figures for reports, drawn by gnuplot (package gnuplot-nox): all figures of a report in one process.
/// Text is UTF-8 and is shown as it is; NaN leaves a gap.

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
  std::vector<double> error{};  ///< +- bars, empty: none
  std::vector<double> y2{};     ///< for kBand
  int color = -1;               ///< of the palette (0..7, colour-blind safe, Okabe and Ito); -1: next
  double width = 1.6;
};

struct Panel {
  std::string title{};
  std::string x_label{};
  std::string y_label{};
  std::vector<Series> series{};
  std::optional<std::pair<double, double>> x_range{};
  std::optional<std::pair<double, double>> y_range{};
  double x_tic = 0.0;  ///< distance of the ticks; 0: gnuplot's choice
  bool log_x = false;
  bool log_y = false;
  std::string key = "top right";  ///< a gnuplot key place; empty: no key
  /// Vertical lines: where and what they mean.
  std::vector<std::pair<double, std::string>> verticals{};
  std::vector<std::pair<double, double>> shaded{};  ///< stretches of x, behind the data
  std::vector<std::string> categories{};            ///< names for x = 0, 1, 2 ...
};

struct Figure {
  std::string name;     ///< file name without ending: letters, digits, '-', '_'
  std::string caption;  ///< for people: what is seen, and what of it is simulated
  std::vector<Panel> panels{};
  int columns = 1;
  int panel_width_px = 420;
  int panel_height_px = 280;
};

struct DrawOptions {
  bool png = true;  ///< beside the SVG; costs about as much as the SVG again
  std::string gnuplot = "gnuplot";
};

/// Draws every figure to `folder`/NAME.svg (and .png). Throws std::runtime_error with gnuplot's own message
/// when it fails or is not installed, and std::invalid_argument for a figure that cannot be drawn (unequal
/// lengths).
void draw(std::span<const Figure> figures, const std::filesystem::path& folder, const DrawOptions& options = {});

/// At most about `points` of a long line, with the lowest and highest of each stretch kept, so that what is
/// drawn is what all of them would have drawn.
[[nodiscard]] Series thinned(Series series, std::size_t points = 2000);

/// The script alone (for tests and for the curious).
[[nodiscard]] std::string gnuplot_script(std::span<const Figure> figures, const std::filesystem::path& folder,
                                         bool png);

}  // namespace isorig::identify::report
