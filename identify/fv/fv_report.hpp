#pragma once
#include <filesystem>

#include "identify/fv/fv_analysis.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify {

/// fv-report.html of an analysis, with its figures in `folder`/figures. Throws what report::Page::write()
/// throws.
void write_fv_report(const FvAnalysis& analysis, const std::filesystem::path& folder,
                     const report::DrawOptions& options = {});

/// The figure of one curve: points with +-1 SD (or their standard error), and the fit. Abscissa as in the
/// paper: shortening velocity, the negative of the extension strain rate.
[[nodiscard]] report::Panel curve_panel(const Curve& curve);
/// The points alone, shortening and lengthening apart: nothing joins them through zero, where the curve
/// jumps.
[[nodiscard]] report::Series measured_points(const Curve& curve);
/// Largest |strain rate| of the points.
[[nodiscard]] double fastest_per_s(const Curve& curve);
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
