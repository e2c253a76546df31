#pragma once
#include <string>
#include <vector>

#include "identify/diagnose/signal/channel_quality.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// Something wrong with the data rather than with the physics.
struct DataFault {
  std::string kind;  ///< outliers, saturation, frozen, dropout, gap, quantisation, clock, hum, tare, ...
  double t_start_s = 0.0;
  double t_end_s = 0.0;
  std::size_t rows = 0;
  std::string text;
};

struct Guarded {
  std::vector<DataFault> faults;
  std::vector<bool> usable;  ///< rows of frame.csv whose force may be believed
};

/// Looks for what instruments do to data before any physics is suspected. The second one measures the quality itself.
[[nodiscard]] Guarded guard_recording(const messages::Recording& recording, const RecordingQuality& quality);
[[nodiscard]] Guarded guard_recording(const messages::Recording& recording);

}  // namespace isorig::identify
