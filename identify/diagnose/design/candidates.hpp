#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "protocol/limits.hpp"
#include "protocol/plan.hpp"

namespace isorig::identify {

/// What experiments may be made of.
struct CandidateLimits {
  protocol::Limits rig;           ///< whoever states none gets what the recordings have shown
  double stroke_mm = 2.0;         ///< farthest from the rest length that is asked for, both ways
  double nominal_psi = 0.0;       ///< at which the specimen was tested
  bool pressure_matters = false;  ///< then the pressure is stepped, too
  double longest_s = 1800.0;      ///< of one experiment
};

/// A protocol in the rig's language and what it does, compiled within the limits.
struct CandidateExperiment {
  std::string name;  ///< "sine 1 Hz, 1 mm, 10 times"
  std::string body;  ///< its steps, one a line, without the filling and the rests round them
  std::string protocol;
  protocol::Plan plan;
  double duration_s = 0.0;  ///< with the time that the frame takes to turn
};

/// The time a frame needs at a target before the next segment may begin: measured on the simulated rig, where
/// it lies within 2 um of the target for 20 ms after 0.2 s.
inline constexpr double kTurn_s = 0.2;

/// Everything worth trying that keeps the limits: sines of 0.5 to 4 Hz (triangles where the link to the frame
/// is too slow for chords), triangles from a few micrometres to the whole stroke, ramps faster and slower than
/// the recorded ones, long holds, steps of the pressure at a standstill. Shortest first.
[[nodiscard]] std::vector<CandidateExperiment> candidate_experiments(const CandidateLimits& limits);

/// One after the other in one session.
[[nodiscard]] CandidateExperiment joined(const CandidateExperiment& first, const CandidateExperiment& second,
                                         const CandidateLimits& limits);

/// A session of its own with these steps. Throws base::ConfigError when it breaks the limits.
[[nodiscard]] CandidateExperiment session_of(std::string name, std::string body, const CandidateLimits& limits);

/// The same protocol under the name it is stored and run by.
[[nodiscard]] std::string protocol_text(const CandidateExperiment& item, const CandidateLimits& limits,
                                        std::string_view name, std::string_view description);

/// The paper's ramps as they are: out at `velocity_mm_s` both ways, 30 s, back at 0.01 mm/s.
[[nodiscard]] std::string paper_ramps(double stroke_mm, double velocity_mm_s, double return_mm_s);

}  // namespace isorig::identify
