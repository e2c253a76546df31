#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "identify/fv/fv_analysis.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify {

/// The paper's campaign: control actuators and sheathed ones of several diameters at several pressures, and
/// what its text says of them. Specimens are named as in the paper's table: a material and a number, the
/// number standing for the mesh ("Control1", "Urethane1": 6 mm); "Control<n>" is the control of all
/// "<material><n>".

/// One claim of the paper's text and how these data stand to it.
struct Trend {
  std::string claim;     ///< as the paper has it, shortened
  std::string measured;  ///< what was found, with numbers
  int holds = 0;         ///< in so many
  int of = 0;            ///< of so many comparisons; 0: not testable with what there is
};

/// A recording that could not be read.
struct LeftOutRecording {
  std::string path;
  std::string why;  ///< with the path and the line
};

struct Campaign {
  FvAnalysis controls;  ///< 1-SLSE
  FvAnalysis sheaths;   ///< 2-SLSE, each with its own control held
  double r_squared_mean = 0.0;
  double r_squared_sd = 0.0;
  std::size_t fits = 0;
  std::vector<Trend> trends;
  std::vector<LeftOutRecording> left_out;  ///< for the page and campaign.json to say
};

/// "Urethane1" -> material "Urethane", number "1".
struct SpecimenName {
  std::string material;
  std::string number;
};
[[nodiscard]] SpecimenName parse_specimen(const std::string& specimen);

/// Throws std::invalid_argument when there is no specimen whose name begins with "Control".
[[nodiscard]] Campaign analyse_campaign(std::vector<RecordingResult> recordings);

/// Response of a curve: mean of |F/F0 - 1| over the given direction (+1 extension, -1 shortening, 0 both);
/// NaN without points.
[[nodiscard]] double mean_response(const Curve& curve, int direction);

/// campaign-report.html with figures after the paper's 3, 4, 5 and 6 and its tables. `simulated` says what is
/// simulated; it stands on top of the page. Tables beside it: campaign.json, fv-controls/, fv-sheaths/.
void write_campaign_report(const Campaign& campaign, const std::filesystem::path& folder, const std::string& simulated,
                           const report::Made& made = {});

/// The parameter sweeps of the paper's figure 3, from the closed forms: (a) to (e).
[[nodiscard]] report::Figure parameter_sweeps();

}  // namespace isorig::identify
