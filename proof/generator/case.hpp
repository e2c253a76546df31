#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "messages/recording.hpp"
#include "proof/generator/effects.hpp"

namespace isorig::proof {

/// What a case is there to show.
enum class Category {
  kNull,            ///< nothing concealed; sometimes a trap in the data
  kSingle,          ///< one named effect
  kPair,            ///< two that differ
  kConfusable,      ///< two of one cluster: they look alike, or cancel
  kOutOfCatalogue,  ///< one that no catalogue has
  kBackground,      ///< one named effect over a faint error of the nominal model that nobody models
};
[[nodiscard]] std::string_view name_of(Category category);

/// Faults of the data, not of the physics.
enum class Trap {
  kNone,
  kColouredNoise,
  kOutliers,
  kCoarseQuantisation,
  kPressureClock,  ///< the pressure recorder's clock is off
  kWarmingNoise,   ///< the amplifier's noise doubles as it warms
  kNoisyPosition,
  kNoPressure,        ///< no pressure.csv
  kSwingingPressure,  ///< the pressure varies visibly and the force does not care
  kGaps,              ///< the recorder lost seconds
};
[[nodiscard]] std::string_view name_of(Trap trap);

struct Instruments {
  double force_noise_N = 0.03;
  double coloured_noise_N = 0.0;
  double coloured_time_s = 1.0;
  double position_noise_mm = 0.4e-3;
  double position_step_mm = 1e-5;
  double force_step_N = 5e-3;
  double pressure_noise_psi = 0.01;
  double pressure_step_psi = 0.0023;
  double pressure_clock_s = 0.0;
  double warming = 0.0;  ///< share by which the noise has grown at the end
  int outliers = 0;
  int gaps = 0;
  bool pressure_recorded = true;
};

struct CasePlan {
  Category category = Category::kNull;
  Trap trap = Trap::kNone;
  std::vector<std::string> effects;
  double size = 1.0;
};

struct Case {
  std::string name;
  CasePlan plan;
  std::string nominal;  ///< slse1 or slse2
  RigParameters clean;
  RigParameters rig;
  Instruments instruments;
  PaperProtocol train_protocol;
  HeldoutProtocol heldout_protocol;
  std::vector<ConcealedEffect> effects;
  double residual_over_noise = 0.0;
  double background_over_noise = 0.0;
};

/// Which cases a study of `count` holds: every kind in its share, every effect as often as every other.
[[nodiscard]] std::vector<CasePlan> plan_study(std::uint64_t seed, std::size_t count);

/// Draws specimen, rig, instruments and effects, and finds the strengths.
[[nodiscard]] Case draw_case(std::uint64_t seed, std::size_t number, const CasePlan& plan);

enum class Part { kTrain, kHeldout };
struct MadeRecording {
  messages::Recording recording;
  std::vector<double> truth_N;  ///< noise-free force, one for each row of the frame
};
/// The recording with everything its instruments do to it. A slip belongs to training alone: heldout is a
/// recording of its own, mounted anew.
[[nodiscard]] MadeRecording record(const Case& drawn, Part part, std::uint64_t seed);

}  // namespace isorig::proof
