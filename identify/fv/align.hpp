#pragma once
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "identify/fv/ramps.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// Two streams that were recorded apart, each on its own clock, as the paper had them (frame by the testing
/// machine, pressure by the microcontroller): offset and skew from what both contain.
///
///     t_frame = t_reference + offset + (1 + skew) (t_pressure - t_reference)
///
/// A stroke changes the volume of the actuator, so the pressure jumps and the regulator brings it back:
///     p(t) = level + drift + A s(t),   ds/dt = dx/dt - gamma s
/// with A (either sign) and gamma unknown. The response to the measured position is searched in the pressure
/// at all lags and skews, then offset, skew, gamma and A are fitted together in windows round the strokes.
///
/// What it cannot know: a dead time between motion and pressure reading (tubing, sensor) counts as clock
/// offset.
///
/// Refuses when the pressure shows no response (below 8 of its own standard deviations over all lags), when
/// another lag explains it nearly as well (periodic protocols), or when offset or skew come out too
/// uncertain.

struct AlignOptions {
  double largest_skew = 300e-6;   ///< crystals are within 100 ppm, and 300 ppm is a broken one
  double largest_error_s = 0.25;  ///< of the mapping anywhere in the record (1 sigma); more is no alignment
  /// Told now and then which part is done, by the time that the search and the fit take of long streams.
  std::function<void(double fraction)> on_progress{};
};

struct AlignedEvent {
  double t_frame_s = 0.0;
  Estimate shift_s;  ///< what this stroke alone would shift the fitted mapping by
};

struct Alignment {
  double reference_s = 0.0;     ///< middle of the strokes, on the pressure clock; errors are independent there
  Estimate offset_s;            ///< at the reference
  Estimate skew;                ///< 1; frame seconds per pressure second, minus 1
  bool skew_known = false;      ///< false: fewer than 3 strokes or a short record, skew taken as 0 +- largest_skew
  double worst_error_s = 0.0;   ///< 1 sigma, over the pressure record
  double response = 0.0;        ///< A in psi/mm
  double recovery_per_s = 0.0;  ///< gamma
  double significance = 0.0;    ///< response at the best lag over the scatter at all others
  std::vector<AlignedEvent> events;
  [[nodiscard]] double frame_time_s(double t_pressure_s) const noexcept {
    return reference_s + offset_s.value + (1.0 + skew.value) * (t_pressure_s - reference_s);
  }
};

struct AlignResult {
  bool aligned = false;
  Alignment alignment;
  std::string refusal;
};

[[nodiscard]] AlignResult align(const messages::FrameSamples& frame, const messages::PressureSamples& pressure,
                                const AlignOptions& options = {});

}  // namespace isorig::identify
