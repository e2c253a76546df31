#pragma once
#include <string_view>
#include <vector>

#include "messages/recording.hpp"
#include "proof/generator/random.hpp"
#include "proof/generator/rig.hpp"

/// What the instruments do to the signals of a rig, whichever generator moved it.
namespace isorig::proof {

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
  kMainsHum,          ///< sampled, hence folded
};
[[nodiscard]] std::string_view name_of(Trap trap);

struct Instruments {
  double force_noise_N = 0.03;
  double coloured_noise_N = 0.0;
  double coloured_time_s = 1.0;
  /// Above 0 the coloured noise forgets by readings and not by time, as behind a filter that takes one step for each
  /// reading of a logger with two rates: e-fold after so many.
  double coloured_readings = 0.0;
  double position_noise_mm = 0.4e-3;
  double position_step_mm = 1e-5;
  double force_step_N = 5e-3;
  double pressure_noise_psi = 0.01;
  double pressure_step_psi = 0.0023;
  double pressure_clock_s = 0.0;
  double warming = 0.0;  ///< share by which the noise has grown at the end
  int outliers = 0;
  double outlier_N = 1.0;  ///< half to five times as much
  double hum_N = 0.0;
  double mains_Hz = 50.0;
  int gaps = 0;
  bool pressure_recorded = true;
};

struct MadeRecording {
  messages::Recording recording;
  std::vector<double> truth_N;  ///< noise-free force, one for each row of the frame
};
/// `duration_s` is the session's; the metadata's lengths are rounded to what a caliper reads.
[[nodiscard]] MadeRecording measure(const Trace& trace, const Instruments& instruments, double duration_s,
                                    messages::RecordingMetadata metadata, Random& random);

}  // namespace isorig::proof
