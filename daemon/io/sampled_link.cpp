#include "daemon/io/sampled_link.hpp"

namespace isorig::daemon {
namespace {

// Fewer leave the first stamps with a scatter of a whole round trip.
constexpr std::uint64_t kExchangesForReady = 20;

}  // namespace

void SampledLink::note_connected(const std::string& identity, double sample_rate_hz) noexcept {
  LinkKeeper::note_connected(identity);
  health_.sample_rate_hz = static_cast<float>(sample_rate_hz);
  burst_left_ = config_.sync_burst;
  mapper_.set_period_us(sample_rate_hz > 0.0 ? 1e6 / sample_rate_hz : 0.0);
}

void SampledLink::complete(LinkHealth& health) const noexcept {
  health.clock_epoch = static_cast<std::uint32_t>(map_.current().epoch);
  health.clock_rejected = static_cast<std::uint32_t>(map_.rejected());
  health.clock_ready = map_.current().known() && map_.current().exchanges >= kExchangesForReady;
}

}  // namespace isorig::daemon
