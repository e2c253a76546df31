#include "identify/diagnose/signal/channel_quality.hpp"

#include <algorithm>
#include <vector>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/signal/noise_level.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {
namespace {

/// The readings without those that repeat the last one for `flat_readings` or more, but for the first of each such run.
struct Alive {
  std::vector<double> t_s, reading;
};
Alive alive(std::span<const double> t_s, std::span<const double> reading) {
  Alive out;
  for (std::size_t k = 0; k < reading.size();) {
    std::size_t end = k + 1;
    while (end < reading.size() && reading[end] == reading[k]) ++end;
    const bool dead = static_cast<double>(end - k) >= deciding().flat_readings;
    for (std::size_t j = k; j < (dead ? k + 1 : end); ++j) {
      out.t_s.push_back(t_s[j]);
      out.reading.push_back(reading[j]);
    }
    k = end;
  }
  return out;
}

/// A load cell that was dead for half of a recording showed no noise at all there, and none in the median. One that is
/// read in coarse steps repeats itself alive, and one that is held for most readings was read that seldom. Of a
/// position nothing of the kind is concluded: an encoder at rest repeats itself.
ChannelQuality quality_where_alive(std::span<const double> t_s, std::span<const double> force_N) {
  const ChannelQuality all = channel_quality(t_s, force_N);
  constexpr std::size_t kFewest = 20;
  const Alive living = alive(t_s, force_N);
  if (living.reading.size() == force_N.size() || living.reading.size() < std::max(kFewest, force_N.size() / 4))
    return all;
  const double noise = white_noise(living.t_s, living.reading);
  return all.step < noise ? ChannelQuality{noise, all.step} : all;
}

}  // namespace

ChannelQuality channel_quality(std::span<const double> t_s, std::span<const double> reading) {
  return {white_noise(t_s, reading), quantisation(reading)};
}

RecordingQuality recording_quality(const messages::Recording& recording) {
  const auto& frame = recording.frame;
  RecordingQuality out{
      channel_quality(frame.t_s, frame.position_mm), quality_where_alive(frame.t_s, frame.force_N), {}};
  if (recording.pressure) out.pressure = channel_quality(recording.pressure->t_s, recording.pressure->pressure_psi);
  return out;
}

}  // namespace isorig::identify
