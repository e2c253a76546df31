#pragma once
#include <filesystem>

#include "identify/fv/fv_analysis.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify {

/// fv-report.html of an analysis. Throws what report::Page::write() throws.
void write_fv_report(const FvAnalysis& analysis, const std::filesystem::path& folder, const report::Made& made = {});

/// Fits of every curve with what is known of each number.
void add_parameters_table(report::Page& page, const FvAnalysis& analysis);
/// All pressures of each specimen in one panel, points and fits; one colour a pressure, the same in every panel.
[[nodiscard]] report::Figure all_curves_figure(const FvAnalysis& analysis, const std::string& name);
/// How the fitted numbers follow the pressure; empty where no specimen has two pressures with a fit.
[[nodiscard]] std::optional<report::Figure> parameters_over_pressure(const FvAnalysis& analysis);
/// Every ramp of one recording: what it was, what it gave, and what speaks against it.
void add_ramps_table(report::Page& page, const RecordingResult& recording);
/// Force, position and pressure of one recording over its time.
[[nodiscard]] report::Figure history_figure(const History& history, const std::string& name,
                                            const std::string& caption);
/// "R² 0.9987" or, of several fits, "R² 0.9921 to 0.9987"; empty without a fit.
[[nodiscard]] std::string r_squared_of(const FvAnalysis& analysis);

/// The figure of one curve: points with +-1 SD (or their standard error), and the fit. Abscissa as in the
/// paper: shortening velocity, the negative of the extension strain rate.
[[nodiscard]] report::Panel curve_panel(const Curve& curve);
/// The points alone, shortening and lengthening apart: nothing joins them through zero, where the curve
/// jumps.
[[nodiscard]] report::Series measured_points(const Curve& curve);
/// Largest |strain rate| of the points.
[[nodiscard]] double fastest_per_s(const Curve& curve);
/// The fit of a curve over its own range of speeds, or of any elements with its strains.
[[nodiscard]] report::Series fitted_line(const Curve& curve, std::span<const model::FvElement> elements);
/// Force over F0 against time, all ramps of some recordings over each other.
[[nodiscard]] report::Panel overlay_panel(const FvAnalysis& analysis, const Curve& curve);
/// Sum of squares over its minimum against one parameter, with the 95 % limit.
[[nodiscard]] report::Panel profile_panel(const FvFit& fit, const FittedParameter& parameter);

/// "0.8 [0.7, 0.9]"; of a parameter that is not identifiable only what is known: "< 4.4", "> 0.9",
/// "0.65 .. 3200", "undetermined".
[[nodiscard]] std::string value_text(const FittedParameter& parameter);

/// "Control1 at 10 psi"
[[nodiscard]] std::string title_of(const Curve& curve);

}  // namespace isorig::identify
