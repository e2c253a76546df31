#include "identify/twin/live_motion.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/motion/corner_motion.hpp"
#include "identify/diagnose/motion/pressure_reconstruction.hpp"
#include "identify/diagnose/motion/reconstruction.hpp"
#include "identify/diagnose/signal/spikes.hpp"

namespace isorig::identify::twin {
namespace {

/// A window holds so many readings at most: a device that stamps a thousand samples alike must not fill the memory.
constexpr std::size_t kMost = 8192;
/// Least readings that a motion is told from.
constexpr std::size_t kFewest = 8;

}  // namespace

std::size_t LiveMotion::bytes() const {
  return readings_.size() * sizeof(Reading) + gauge_.size() * sizeof(Gauge);
}

void LiveMotion::pressure(std::int64_t mono_ns, double psi) {
  if (!gauge_.empty() && mono_ns <= gauge_.back().mono_ns) return;
  gauge_.push_back({mono_ns, psi});
  if (gauge_.size() > kMost) gauge_.pop_front();
}

std::vector<LiveMotion::Row> LiveMotion::frame(const Reading& reading) {
  if (!origin_ns_) origin_ns_ = reading.mono_ns;
  if (!readings_.empty() && reading.mono_ns <= readings_.back().mono_ns) return {};
  readings_.push_back(reading);
  const double open_s = seconds(reading.mono_ns) - seconds(readings_[given_].mono_ns);
  if (readings_.size() < kFewest) return {};
  if (open_s < kHop_s + kAhead_s && readings_.size() < kMost) return {};
  return window();
}

std::vector<double> LiveMotion::pressure_at(const std::vector<double>& t_s, const std::vector<double>& position_mm) {
  if (gauge_.empty()) return {};
  noise_.has_pressure = true;
  messages::PressureSamples gauge;
  for (const Gauge& each : gauge_) {
    gauge.t_s.push_back(seconds(each.mono_ns));
    gauge.pressure_psi.push_back(each.psi);
  }
  ReconstructedPressure out =
      reconstruct_pressure(gauge, channel_quality(gauge.t_s, gauge.pressure_psi), t_s, position_mm);
  noise_.pressure_psi = std::max(noise_.pressure_psi, out.noise_psi);
  return std::move(out.pressure_psi);
}

std::vector<LiveMotion::Row> LiveMotion::window() {
  std::vector<double> t_s, reading_mm;
  for (const Reading& each : readings_) {
    t_s.push_back(seconds(each.mono_ns));
    reading_mm.push_back(each.position_mm);
  }
  const Despiked position = without_spikes(t_s, reading_mm, channel_quality(t_s, reading_mm));
  Motion motion = smooth_motion(t_s, position.reading_mm, position.quality);
  smooth_corners(t_s, position.reading_mm, motion);
  const std::vector<double> psi = pressure_at(t_s, motion.position_mm);
  // A window in which nothing moves says best what the noise is; one that turns all the time, worst.
  const double noise_mm = std::max(motion.noise_mm, motion.quantisation_mm);
  noise_.position_mm = begun_ ? noise_.position_mm + 0.1 * (noise_mm - noise_.position_mm) : noise_mm;

  std::vector<Row> out;
  const double until_s = readings_.size() < kMost ? t_s.back() - kAhead_s : t_s.back();
  for (; given_ < readings_.size() && t_s[given_] <= until_s; ++given_) {
    const std::size_t k = given_;
    model::Instant now;
    now.t_s = t_s[k];
    now.position_mm = motion.position_mm[k];
    now.elongation_mm = now.position_mm + reference_.elongation_at_zero_mm;
    now.velocity_mm_s = motion.velocity_mm_s[k];
    now.acceleration_mm_s2 = motion.acceleration_mm_s2[k];
    now.excess_pressure_psi = psi.empty() ? 0.0 : psi[k] - reference_.nominal_pressure_psi;
    if (!begun_) {
      slid_mm_ = last_mm_ = now.position_mm;
      now.slide_mm = 0.0;
    } else {
      now.dt_s = now.t_s - last_s_;
      now.step_mm = now.position_mm - last_mm_;
      constexpr double kNoises = 5.0;  // as reconstruct_excitation has it
      const double ahead_mm = now.position_mm - slid_mm_, least_mm = kNoises * noise_.position_mm;
      if (direction_ * ahead_mm > 0.0 || std::fabs(ahead_mm) > least_mm) {
        now.slide_mm = ahead_mm;
        direction_ = ahead_mm > 0.0 ? 1 : -1;
        slid_mm_ = now.position_mm;
      } else {
        now.slide_mm = 0.0;
      }
    }
    begun_ = true;
    last_s_ = now.t_s;
    last_mm_ = now.position_mm;
    out.push_back({readings_[k], now});
  }
  // What is needed of the past to tell the motion at the next window's beginning.
  const double keep_s = (given_ < t_s.size() ? t_s[given_] : t_s.back()) - kBehind_s;
  const std::size_t from = readings_.size() < kMost ? 0 : given_;
  std::size_t drop = from;
  while (drop < given_ && t_s[drop] < keep_s) ++drop;
  readings_.erase(readings_.begin(), readings_.begin() + static_cast<std::ptrdiff_t>(drop));
  given_ -= drop;
  while (gauge_.size() > 1 && seconds(gauge_[1].mono_ns) < keep_s) gauge_.pop_front();
  return out;
}

}  // namespace isorig::identify::twin
