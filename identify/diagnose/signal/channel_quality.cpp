#include "identify/diagnose/signal/channel_quality.hpp"

#include "identify/diagnose/signal/noise_level.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

ChannelQuality channel_quality(std::span<const double> t_s, std::span<const double> reading) {
  return {white_noise(t_s, reading), quantisation(reading)};
}

RecordingQuality recording_quality(const messages::Recording& recording) {
  const auto& frame = recording.frame;
  RecordingQuality out{channel_quality(frame.t_s, frame.position_mm), channel_quality(frame.t_s, frame.force_N), {}};
  if (recording.pressure) out.pressure = channel_quality(recording.pressure->t_s, recording.pressure->pressure_psi);
  return out;
}

}  // namespace isorig::identify
