#include "drivers/clock_map/remap.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/quantile.hpp"

namespace isorig::clock {
namespace {

/// The exchanges of each life of the device's clock, sorted out by the online rules.
std::vector<std::vector<Exchange>> epochs_of(std::span<const Exchange> exchanges, const MapOptions& options) {
  std::vector<std::vector<Exchange>> epochs;
  DeviceClockMap map(options);
  const Exchange* held = nullptr;
  for (const auto& e : exchanges) {
    const auto verdict = map.add(e);
    if (verdict == ExchangeVerdict::kHeld) held = &e;
    if (verdict == ExchangeVerdict::kRestarted) {
      epochs.emplace_back();
      if (map.current().exchanges > 1) epochs.back().push_back(*held);
      epochs.back().push_back(e);
    }
    if (verdict == ExchangeVerdict::kAccepted) {
      if (epochs.empty()) epochs.emplace_back();
      epochs.back().push_back(e);
    }
  }
  return epochs;
}

class Epoch {
 public:
  Epoch(const std::vector<Exchange>& exchanges, const MapOptions& options) : options_(options) {
    host_origin_ns_ = exchanges.front().host_recv_ns;
    device_origin_us_ = exchanges.front().device_tx_us;
    for (const auto& e : exchanges) {
      const double rx_us = e.device_rx_us - device_origin_us_, tx_us = e.device_tx_us - device_origin_us_;
      const double send_us =
          static_cast<double>(e.host_send_ns - host_origin_ns_) * 1e-3 - options_.device_resolution_us;
      intervals_.push_back({rx_us * 1e-6, send_us - rx_us, tx_us * 1e-6,
                            static_cast<double>(e.host_recv_ns - host_origin_ns_) * 1e-3 - tx_us});
    }
    run_filters();
    run_envelopes();
  }

  MappedTime map(double device_us) const {
    const double s = (device_us - device_origin_us_) * 1e-6;
    auto [offset_us, variance_us2] = estimate(s);
    const auto [low_us, high_us] = allowed(s);
    offset_us = std::clamp(offset_us, low_us, high_us);
    const double resolution = options_.device_resolution_us;
    return {host_origin_ns_ + std::llround((s * 1e6 + offset_us + 0.5 * resolution) * 1e3),
            1e3 * (std::max(high_us - offset_us, offset_us - low_us) + 0.5 * resolution),
            1e3 * std::sqrt(variance_us2 + resolution * resolution / 12.0)};
  }

 private:
  struct Node {
    double s;
    Envelope envelope;
  };

  void run_filters() {
    DelayFilter forward(options_.wander), backward(options_.wander);
    forward_.reserve(intervals_.size());
    for (const auto& i : intervals_) {
      forward.add(i);
      forward_.push_back(forward.state());
    }
    // Seen backwards in time, replies are requests and host minus device time changes its sign.
    backward_.resize(intervals_.size());
    for (std::size_t k = intervals_.size(); k-- > 0;) {
      const auto& i = intervals_[k];
      backward.add({-i.high_seconds, -i.high_us, -i.low_seconds, -i.low_us});
      auto state = backward.state();
      state.device_s = -state.device_s;
      state.mean[0] = -state.mean[0];  // the slope keeps its sign: both axes turn
      const Eigen::Vector3d turn(-1.0, 1.0, 1.0);
      state.covariance = turn.asDiagonal() * state.covariance * turn.asDiagonal();
      backward_[k] = state;
    }
  }

  void run_envelopes() {
    // One a second is as fine as the bound changes; tighter spacing only costs time.
    double next_s = -std::numeric_limits<double>::infinity();
    std::size_t from = 0, to = 0;
    std::vector<Interval> relative;
    for (const auto& centre : intervals_) {
      if (centre.high_seconds < next_s) continue;
      next_s = centre.high_seconds + 1.0;
      const double half_s = 0.5 * options_.window_s;
      while (from < intervals_.size() && intervals_[from].high_seconds < centre.high_seconds - half_s) ++from;
      while (to < intervals_.size() && intervals_[to].high_seconds <= centre.high_seconds + half_s) ++to;
      const std::size_t spare = to - from < options_.window_least ? options_.window_least : 0;
      const std::size_t first = from - std::min(from, spare), last = std::min(to + spare, intervals_.size());
      relative.assign(intervals_.begin() + static_cast<std::ptrdiff_t>(first),
                      intervals_.begin() + static_cast<std::ptrdiff_t>(last));
      for (auto& i : relative) {
        i.low_seconds -= centre.high_seconds;
        i.high_seconds -= centre.high_seconds;
      }
      nodes_.push_back(
          {centre.high_seconds, envelope(relative, options_.wander, options_.bound_sigmas, options_.rate_limit_ppm)});
      if (!nodes_.back().envelope.consistent) nodes_.pop_back();
    }
  }

  struct Estimate {
    double offset_us;
    double variance_us2;
  };
  Estimate estimate(double s) const {
    const auto after = std::upper_bound(intervals_.begin(), intervals_.end(), s,
                                        [](double at, const Interval& i) { return at < i.high_seconds; });
    const auto k = static_cast<std::size_t>(after - intervals_.begin());
    if (k == 0) return marginal(predicted(backward_.front(), s, options_.wander));
    const auto f = predicted(forward_[k - 1], s, options_.wander);
    if (k == intervals_.size()) return marginal(f);
    const auto b = predicted(backward_[k], s, options_.wander);
    // P = (Pf^-1 + Pb^-1)^-1 = Pf (Pf + Pb)^-1 Pb, which needs no inverse of a nearly singular matrix.
    const Eigen::Matrix3d gain = f.covariance * (f.covariance + b.covariance).inverse();
    const Eigen::Vector3d mean = f.mean + gain * (b.mean - f.mean);
    return {mean[0], (gain * b.covariance)(0, 0)};
  }
  static Estimate marginal(const FilterState& state) { return {state.mean[0], state.covariance(0, 0)}; }

  std::pair<double, double> allowed(double s) const {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    double low = -kInfinity, high = kInfinity;
    const auto after =
        std::upper_bound(nodes_.begin(), nodes_.end(), s, [](double at, const Node& n) { return at < n.s; });
    // What either neighbour allows has to hold.
    for (auto node = after == nodes_.begin() ? after : after - 1; node != nodes_.end() && node <= after; ++node) {
      const double away = s - node->s;
      const double spread = options_.bound_sigmas * options_.wander.departure_us(away);
      const auto& e = node->envelope;
      low = std::max(low, e.low_us + std::min(e.rate_low_ppm * away, e.rate_high_ppm * away) - spread);
      high = std::min(high, e.high_us + std::max(e.rate_low_ppm * away, e.rate_high_ppm * away) + spread);
    }
    return low <= high ? std::pair{low, high} : std::pair{-kInfinity, kInfinity};
  }

  MapOptions options_;
  std::int64_t host_origin_ns_ = 0;
  double device_origin_us_ = 0.0;
  std::vector<Interval> intervals_;    // absolute: seconds and us from the origins
  std::vector<FilterState> forward_;   // after exchange k, from it and all before
  std::vector<FilterState> backward_;  // at exchange k, from it and all after
  std::vector<Node> nodes_;
};

/// Later device times get later host times.
void make_monotone(std::span<const DeviceStamp> stamps, std::span<const std::size_t> epoch_of,
                   std::vector<MappedTime>& out) {
  // The estimate of two stamps a few us apart on either side of an exchange may differ by about as much.
  std::vector<std::size_t> order(stamps.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::pair(epoch_of[a], stamps[a].device_us) < std::pair(epoch_of[b], stamps[b].device_us);
  });
  for (std::size_t k = 1; k < order.size(); ++k) {
    const auto before = order[k - 1], now = order[k];
    if (epoch_of[before] != epoch_of[now]) continue;
    const auto least_ns = out[before].mono_ns + (stamps[now].device_us > stamps[before].device_us ? 1 : 0);
    if (out[now].mono_ns < least_ns) {
      out[now].bound_ns += static_cast<double>(least_ns - out[now].mono_ns);
      out[now].mono_ns = least_ns;
    }
  }
}

}  // namespace

std::vector<MappedTime> remap_offline(std::span<const Exchange> exchanges, std::span<const DeviceStamp> stamps,
                                      const MapOptions& options) {
  std::vector<Epoch> epochs;
  for (const auto& e : epochs_of(exchanges, options)) epochs.emplace_back(e, options);
  std::vector<MappedTime> out(stamps.size());
  std::vector<std::size_t> epoch_of(stamps.size(), 0);
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    out[i].mono_ns = stamps[i].near_ns;
    auto nearest_ns = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < epochs.size(); ++e) {
      const auto mapped = epochs[e].map(stamps[i].device_us);
      const double away_ns = std::abs(static_cast<double>(mapped.mono_ns - stamps[i].near_ns));
      if (away_ns < nearest_ns) {
        nearest_ns = away_ns;
        out[i] = mapped;
        epoch_of[i] = e;
      }
    }
  }
  if (!epochs.empty()) make_monotone(stamps, epoch_of, out);
  return out;
}

std::vector<MappedTime> remap_offline_stretch(std::span<const Exchange> exchanges, std::span<const DeviceStamp> stamps,
                                              const MapOptions& options) {
  std::vector<MappedTime> best(stamps.size());
  for (std::size_t i = 0; i < stamps.size(); ++i) best[i].mono_ns = stamps[i].near_ns;
  auto nearest_ns = std::numeric_limits<double>::infinity();
  for (const auto& e : epochs_of(exchanges, options)) {
    const Epoch epoch(e, options);
    std::vector<MappedTime> mapped;
    std::vector<double> away_ns;
    mapped.reserve(stamps.size());
    away_ns.reserve(stamps.size());
    for (const auto& s : stamps) {
      mapped.push_back(epoch.map(s.device_us));
      away_ns.push_back(std::abs(static_cast<double>(mapped.back().mono_ns - s.near_ns)));
    }
    if (away_ns.empty()) break;
    const double median_ns = base::quantile_in_place(away_ns, 0.5);
    if (median_ns >= nearest_ns) continue;
    nearest_ns = median_ns;
    best = std::move(mapped);
  }
  if (std::isfinite(nearest_ns)) make_monotone(stamps, std::vector<std::size_t>(stamps.size(), 0), best);
  return best;
}

}  // namespace isorig::clock
