#include "drivers/clock_map/mapping.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::clock {
namespace {

constexpr double kOutOfOrder_us = 1e6;  // no stream delivers its samples a second out of order

bool possible(const Exchange& e, double resolution_us) noexcept {
  if (!std::isfinite(e.device_rx_us) || !std::isfinite(e.device_tx_us)) return false;
  const double host_us = static_cast<double>(e.host_recv_ns - e.host_send_ns) * 1e-3;
  const double device_us = e.device_tx_us - e.device_rx_us;
  // The device's part is not longer than the whole, but for 1000 ppm and the rounding of its stamps.
  return host_us > 0.0 && device_us >= 0.0 && device_us <= host_us * 1.001 + resolution_us + 2.0;
}

/// A bin of the window each, and one at either end.
std::size_t most_remembered(const MapOptions& options) {
  const double bins = std::clamp(options.window_s / options.bin_s, 0.0, 1e5);
  return std::max(options.window_least, static_cast<std::size_t>(bins)) + 2;
}

}  // namespace

DeviceClockMap::DeviceClockMap(const MapOptions& options)
    : options_(options),
      filter_(options.wander),
      most_remembered_(most_remembered(options)),
      room_(most_remembered_ + 1) {
  window_.reserve(most_remembered_);
  relative_.reserve(most_remembered_ + 1);
}

ExchangeVerdict DeviceClockMap::add(const Exchange& exchange) {
  if (!possible(exchange, options_.device_resolution_us)) {
    ++rejected_;
    return ExchangeVerdict::kRejected;
  }
  if (!filter_.started()) {
    begin(exchange);
    return ExchangeVerdict::kAccepted;
  }
  if (take(exchange)) {
    if (held_) ++rejected_;  // it was the held one that was wrong
    held_.reset();
    held_in_a_row_ = 0;
    ++version_;
    return ExchangeVerdict::kAccepted;
  }
  if (!held_) {
    hold(exchange);
    return ExchangeVerdict::kHeld;
  }
  if (agree(*held_, exchange)) {
    begin(Exchange{*held_});
    if (take(exchange)) ++version_;
    return ExchangeVerdict::kRestarted;
  }
  ++rejected_;  // at most one of the two is right
  if (held_in_a_row_ < kMostHeld) {
    hold(exchange);
    return ExchangeVerdict::kHeld;
  }
  begin(exchange);
  return ExchangeVerdict::kRestarted;
}

bool DeviceClockMap::agree(const Exchange& first, const Exchange& second) {
  const auto interval = [&](const Exchange& e) {
    const auto us = [&](std::int64_t ns) { return static_cast<double>(ns - second.host_recv_ns) * 1e-3; };
    const double rx_us = e.device_rx_us - second.device_tx_us, tx_us = e.device_tx_us - second.device_tx_us;
    return Interval{rx_us * 1e-6, us(e.host_send_ns) - options_.device_resolution_us - rx_us, tx_us * 1e-6,
                    us(e.host_recv_ns) - tx_us};
  };
  const std::array<Interval, 2> both{interval(first), interval(second)};
  return second.device_tx_us >= first.device_tx_us &&
         envelope(both, options_.wander, options_.bound_sigmas, options_.rate_limit_ppm, room_).consistent;
}

bool DeviceClockMap::agrees(const Exchange& exchange) const noexcept {
  if (!current_.known() || !possible(exchange, options_.device_resolution_us)) return true;
  const auto rx = current_.map(exchange.device_rx_us), tx = current_.map(exchange.device_tx_us);
  const double slack_ns = 1e3 * (options_.device_resolution_us + 1.0);
  return static_cast<double>(rx.mono_ns - exchange.host_send_ns) >= -rx.bound_ns - slack_ns &&
         static_cast<double>(tx.mono_ns - exchange.host_recv_ns) <= tx.bound_ns + slack_ns;
}

/// Either the exchange is wrong, and stamps are within the bound as it was, or the clock has stepped, and they are off
/// by as much as the exchange is.
void DeviceClockMap::hold(const Exchange& exchange) {
  held_ = exchange;
  ++held_in_a_row_;
  if (current_.in_doubt == 0) settled_bound_us_ = current_.bound_us;
  const auto rx = current_.map(exchange.device_rx_us), tx = current_.map(exchange.device_tx_us);
  const double off_us = 1e-3 * std::max(std::abs(static_cast<double>(tx.mono_ns - exchange.host_recv_ns)),
                                        std::abs(static_cast<double>(rx.mono_ns - exchange.host_send_ns)));
  current_.bound_us = settled_bound_us_ + off_us + options_.device_resolution_us;
  current_.in_doubt = 1;
  ++version_;
}

void DeviceClockMap::restart() {
  filter_ = DelayFilter(options_.wander);
  window_.clear();
  held_.reset();
  held_in_a_row_ = 0;
  current_.bound_us = MappedTime::kUnknown;
  current_.in_doubt = 0;
  ++version_;
}

void DeviceClockMap::begin(const Exchange& first) {
  filter_ = DelayFilter(options_.wander);
  window_.clear();
  held_.reset();
  held_in_a_row_ = 0;
  host_origin_ns_ = first.host_recv_ns;
  device_origin_us_ = first.device_tx_us;
  ++current_.epoch;
  current_.exchanges = 0;
  take(first);
  ++version_;
}

Interval DeviceClockMap::absolute(const Exchange& e) const noexcept {
  const double rx_us = e.device_rx_us - device_origin_us_, tx_us = e.device_tx_us - device_origin_us_;
  // Stamps are rounded down. That makes `high` later by up to the resolution, which is safe, and `low` as
  // well.
  const double send_us = static_cast<double>(e.host_send_ns - host_origin_ns_) * 1e-3 - options_.device_resolution_us;
  return {rx_us * 1e-6, send_us - rx_us, tx_us * 1e-6,
          static_cast<double>(e.host_recv_ns - host_origin_ns_) * 1e-3 - tx_us};
}

void DeviceClockMap::remember(const Interval& now) {
  const double rate_ppm = filter_.started() ? filter_.state().mean[1] : 0.0;
  const auto bin = [this](const Interval& i) { return std::floor(i.high_seconds / options_.bin_s); };
  if (!window_.empty() && bin(now) == bin(window_.back())) {
    // Leaving a constraint out never makes the bound wrong, only wider; the tightest of each side stays.
    auto& last = window_.back();
    if (now.low_us - rate_ppm * (now.low_seconds - last.low_seconds) > last.low_us) {
      last.low_us = now.low_us;
      last.low_seconds = now.low_seconds;
    }
    if (now.high_us - rate_ppm * (now.high_seconds - last.high_seconds) < last.high_us) {
      last.high_us = now.high_us;
      last.high_seconds = now.high_seconds;
    }
  } else {
    if (window_.size() == most_remembered_) window_.erase(window_.begin());
    window_.push_back(now);
  }
  std::size_t old = 0;
  while (window_.size() - old > options_.window_least &&
         now.high_seconds - window_[old].high_seconds > options_.window_s) {
    ++old;
  }
  window_.erase(window_.begin(), window_.begin() + static_cast<std::ptrdiff_t>(old));
}

bool DeviceClockMap::take(const Exchange& exchange) {
  const Interval now = absolute(exchange);
  // A clock that runs backwards by more than its resolution has been restarted.
  if (filter_.started() && now.low_seconds < filter_.state().device_s - options_.device_resolution_us * 1e-6) {
    return false;
  }
  relative_.assign(window_.begin(), window_.end());
  relative_.push_back(now);
  for (auto& i : relative_) {
    i.low_seconds -= now.high_seconds;
    i.high_seconds -= now.high_seconds;
  }
  const auto allowed = envelope(relative_, options_.wander, options_.bound_sigmas, options_.rate_limit_ppm, room_);
  if (!allowed.consistent) return false;

  filter_.add(now);
  remember(now);
  const auto& state = filter_.state();
  const double offset_us = std::clamp(state.mean[0], allowed.low_us, allowed.high_us);
  const double rate_ppm = std::clamp(state.mean[1], allowed.rate_low_ppm, allowed.rate_high_ppm);
  // A sample's stamp is rounded down like the exchange's: on average it is half the resolution later than it
  // says.
  const double resolution_us = options_.device_resolution_us;
  current_.host_reference_ns =
      host_origin_ns_ +
      std::llround((exchange.device_tx_us - device_origin_us_ + offset_us + 0.5 * resolution_us) * 1e3);
  current_.device_reference_us = exchange.device_tx_us;
  current_.rate_ppm = rate_ppm;
  current_.bound_us = std::max(allowed.high_us - offset_us, offset_us - allowed.low_us) + 0.5 * resolution_us;
  current_.bound_slope_ppm = std::max(allowed.rate_high_ppm - rate_ppm, rate_ppm - allowed.rate_low_ppm);
  current_.bound_wander_us_per_s15 = options_.bound_sigmas * options_.wander.largest_departure_us(1.0);
  const auto& p = state.covariance;
  current_.variance_us2 = p(0, 0) + resolution_us * resolution_us / 12.0;
  current_.variance_slope_us2_per_s = 2.0 * p(0, 1);
  current_.variance_curvature_ppm2 = p(1, 1);
  current_.variance_wander_us2_per_s3 = options_.wander.diffusion_ppm2_per_s() / 3.0;
  ++current_.exchanges;
  current_.in_doubt = 0;
  return true;
}

void StreamMapper::renew() noexcept {
  version_ = map_->version();
  const MapSnapshot& fresh = map_->current();
  const bool same_clock = fresh.epoch == snapshot_.epoch;
  const bool told = fresh.in_doubt == 0 && fresh.host_reference_ns > alone_since_ns_;
  if (alone_ && (!same_clock || told)) {
    alone_ = false;
    lead_ns_ = static_cast<double>(last_mono_ns_ - fresh.map(last_device_us_).mono_ns);
  } else if (started_ && same_clock) {
    // Go on from where the last stamp was put.
    lead_ns_ += static_cast<double>(snapshot_.map(last_device_us_).mono_ns - fresh.map(last_device_us_).mono_ns);
  }
  if (!same_clock) {
    lead_ns_ = 0.0;
    started_ = false;
  }
  snapshot_ = fresh;
}

/// Whether the stamp is not where the count puts it. Learns, from those that are, how far stamps stray.
bool StreamMapper::has_stepped(double device_us, std::int64_t advance) noexcept {
  constexpr int kLearnt = 64;
  constexpr double kLeast_us = 300.0, kMost_us = 5000.0;
  const double expected_us = static_cast<double>(advance) * period_us_;
  const double off_us = std::abs(device_us - last_device_us_ - expected_us);
  allowed_us_ =
      (steady_ < kLearnt ? kMost_us : std::clamp(20.0 * jitter_us_, kLeast_us, kMost_us)) + 1e-3 * expected_us;
  if (off_us > allowed_us_) return true;
  steady_ = std::min(steady_ + 1, kLearnt);
  const double departure_us = off_us - jitter_us_;
  // kLearnt is a power of two: the product is the quotient, to the last bit.
  jitter_us_ += steady_ < kLearnt ? departure_us / static_cast<double>(steady_) : departure_us * (1.0 / kLearnt);
  return false;
}

/// `counted_us`: since the last stamp by the count; below 0: nobody counts. Over a jump neither clock nor count can be
/// believed more than that they did not both run ahead; between jumps the device's clock is right again.
MappedTime StreamMapper::map_alone(double device_us, std::int64_t arrival_ns, double counted_us, bool jumped) noexcept {
  constexpr double kRate = 500e-6;
  const double latest_ns =
      arrival_ns == kNoArrival ? MappedTime::kUnknown : static_cast<double>(arrival_ns - last_mono_ns_);
  double passed_ns = 1e3 * (device_us - last_device_us_);
  if (!alone_) {
    alone_ = true;
    alone_since_ns_ = arrival_ns == kNoArrival ? last_mono_ns_ : arrival_ns;
    low_ns_ = -last_bound_ns_;
    high_ns_ = last_bound_ns_;
  }
  jumped = jumped || low_ns_ + passed_ns > latest_ns;
  if (jumped) {
    low_ns_ += std::max(
        0.0, counted_us < 0.0 ? 0.0 : std::min(passed_ns, 1e3 * counted_us) * (1.0 - kRate) - 1e3 * allowed_us_);
    high_ns_ = std::max(latest_ns, low_ns_);
    passed_ns = counted_us < 0.0 ? latest_ns : 1e3 * counted_us;
  } else {
    passed_ns = std::max(passed_ns, 0.0);
    low_ns_ += passed_ns * (1.0 - kRate);
    high_ns_ = std::max(std::min(high_ns_ + passed_ns * (1.0 + kRate), latest_ns), low_ns_);
  }
  const double offset_ns = std::max(std::min(passed_ns, latest_ns), 1.0);
  if (offset_ns < MappedTime::kUnknown) {
    last_mono_ns_ += std::llround(offset_ns);
    low_ns_ -= offset_ns;  // now from the stamp that is given out
    high_ns_ -= offset_ns;
  }
  last_device_us_ = device_us;
  last_bound_ns_ = std::max({-low_ns_, high_ns_, 1.0});
  return {last_mono_ns_, last_bound_ns_, last_bound_ns_};
}

MappedTime StreamMapper::map(double device_us, std::int64_t arrival_ns, std::uint32_t sequence, bool counted) noexcept {
  if (map_->version() != version_) renew();
  MappedTime out = snapshot_.map(device_us);
  if (snapshot_.epoch == 0) [[unlikely]] {
    // No exchange yet: all that is known is that the sample is not from the future.
    out = {std::max(arrival_ns == kNoArrival ? 0 : arrival_ns, last_mono_ns_), MappedTime::kUnknown,
           MappedTime::kUnknown};
    last_mono_ns_ = out.mono_ns;
    return out;
  }
  const std::int64_t advance = counted ? std::int64_t{static_cast<std::int32_t>(sequence - last_sequence_)} : 0;
  const bool follows = counted && started_ && advance > 0;
  if (counted) last_sequence_ = sequence;
  const bool future = arrival_ns != kNoArrival && static_cast<double>(out.mono_ns - arrival_ns) > out.bound_ns;
  const bool past = started_ && device_us < last_device_us_ - kOutOfOrder_us;
  const bool stepped = follows && has_stepped(device_us, advance);
  if (started_ && (alone_ || future || past || stepped)) {
    const double counted_us = follows ? static_cast<double>(advance) * period_us_ : -1.0;
    return map_alone(device_us, arrival_ns, counted_us, stepped || past || (future && !alone_));
  }
  if (future) {
    last_mono_ns_ = std::max(arrival_ns, last_mono_ns_ + 1);
    return {last_mono_ns_, MappedTime::kUnknown, MappedTime::kUnknown};
  }
  double lead_ns = lead_ns_;
  const bool newer = !started_ || device_us > last_device_us_;
  if (started_ && newer && lead_ns != 0.0) {
    constexpr double kDecay_ns = 20e6;
    const double passed_ns = (device_us - last_device_us_) * 1e3;
    const double wanted = lead_ns * std::min(1.0, passed_ns / kDecay_ns);
    lead_ns -= std::clamp(wanted, -0.5 * passed_ns, 0.5 * passed_ns);
    if (std::abs(lead_ns) < 0.5) lead_ns = 0.0;
  }
  std::int64_t mono_ns = out.mono_ns + base::rounded(lead_ns);
  if (newer) {
    mono_ns = std::max(std::min(mono_ns, arrival_ns), last_mono_ns_ + 1);
    last_mono_ns_ = mono_ns;
    last_device_us_ = device_us;
    lead_ns_ = static_cast<double>(mono_ns - out.mono_ns);
    started_ = true;
  }
  // Coming down to the arrival time only ever comes nearer to the truth; anything else adds to the error.
  const auto moved_ns = static_cast<double>(mono_ns - std::min(out.mono_ns, arrival_ns));
  out.mono_ns = mono_ns;
  if (moved_ns != 0.0) {
    out.bound_ns += std::abs(moved_ns);
    // Neither is so large or so small that std::hypot's care would be needed.
    out.repeatability_ns = std::sqrt(out.repeatability_ns * out.repeatability_ns + moved_ns * moved_ns);
  }
  if (newer) last_bound_ns_ = out.bound_ns;
  return out;
}

}  // namespace isorig::clock
