#pragma once
#include <span>
#include <vector>

#include "identify/diagnose/signal/channel_quality.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// Random-walk smoothing of a slow signal (pressure), its two variances by maximum likelihood.
struct SlowSignal {
  std::vector<double> value;
  double noise = 0.0;
  double walk = 0.0;  ///< growth of its standard deviation in a second
};
[[nodiscard]] SlowSignal smooth_slow(std::span<const double> t_s, std::span<const double> reading,
                                     const ChannelQuality& quality);

/// The pressure at the rows of the frame. Gauges are read some times a second, a ramp lasts less than that:
/// in between, the regulator gives way to the motion, which is known. The pressure is taken as a slow signal
/// plus h times the position through a high-pass (time constant tau: the regulator's recovery), where that
/// explains the readings clearly better; its delay against the frame is the error of the gauge's clock.
struct ReconstructedPressure {
  std::vector<double> pressure_psi;  ///< one per row of the frame
  double noise_psi = 0.0;
  double droop_psi_mm = 0.0;  ///< h; 0: no response to the motion was seen
  double recovery_s = 0.0;    ///< tau
  double clock_s = 0.0;
  double clock_error_s = 0.0;
};
[[nodiscard]] ReconstructedPressure reconstruct_pressure(const messages::PressureSamples& gauge,
                                                         const ChannelQuality& quality, std::span<const double> t_s,
                                                         std::span<const double> position_mm);

}  // namespace isorig::identify
