#pragma once
#include <functional>
#include <string>
#include <vector>

#include "identify/fv/campaign.hpp"
#include "identify/fv/fv_analysis.hpp"

/// What `fv` and `campaign` begin with.
namespace isorig::cli {

struct AnalysedRecordings {
  std::vector<identify::RecordingResult> results;
  int exit_code = 0;  ///< an ExitCode: kOk, or what the command returns, having said why
  std::vector<identify::LeftOutRecording> left_out{};
};

/// What becomes of a recording that cannot be read; which one and why is said in either case.
enum class Unreadable {
  kRefuse,    ///< nothing is made of the others
  kLeaveOut,  ///< the others are enough, as long as there is one
};

/// Throws std::invalid_argument for a recording that the command does not take.
using CheckRecording = std::function<void(const messages::Recording&, const std::string& path)>;

/// Reads and analyses every recording before anything is written: all that is wrong is said at once, and so is a
/// recording that is there twice. `read_share`: of the time that a long recording takes, for the progress.
[[nodiscard]] AnalysedRecordings analyse_recordings(const std::string& command, const std::vector<std::string>& paths,
                                                    double read_share, identify::FvOptions options,
                                                    const CheckRecording& check = {},
                                                    Unreadable unreadable = Unreadable::kRefuse);

}  // namespace isorig::cli
