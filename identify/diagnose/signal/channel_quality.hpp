#pragma once
#include <cmath>
#include <span>

namespace isorig::messages {
struct Recording;
}

namespace isorig::identify {

/// How well a channel was read. Measured once for each channel (prepare.cpp), again only where readings were replaced
/// (spikes, hum), and handed on: both numbers need a pass over the whole recording, one of them a sort.
struct ChannelQuality {
  double noise = 0.0;  ///< rms of the white noise: white_noise()
  double step =
      0.0;  ///< between neighbouring values that the channel can show, 0 if finer than the noise: quantisation()

  /// rms error by rounding to these values: uniform within a step.
  [[nodiscard]] double rounding() const noexcept { return step / std::sqrt(12.0); }
};
[[nodiscard]] ChannelQuality channel_quality(std::span<const double> t_s, std::span<const double> reading);

/// Of the channels that a diagnosis reads, the force's where it was alive; zeros for a pressure that was not recorded.
struct RecordingQuality {
  ChannelQuality position, force, pressure;
};
[[nodiscard]] RecordingQuality recording_quality(const messages::Recording& recording);

}  // namespace isorig::identify
