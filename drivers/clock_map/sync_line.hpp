#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/clock_map/mapping.hpp"
#include "drivers/clock_map/sync_check.hpp"

namespace isorig::clock {

/// Pairs the edges that the device announces with those that the kernel saw, and measures the mapping by them. One
/// thread. Edges come in any order between the two sides; each side's own in order.
///
/// An edge of the line is looked for within `window_ns` of where the mapping puts it, far wider than the bound: a
/// mapping that is wrong has to show as an error, not as a missing edge. Where that leaves a choice there is no pair:
/// the nearest edge would always agree best with the mapping that is to be judged.
class SyncLine {
 public:
  struct Options {
    std::int64_t window_ns = 50'000'000;   ///< pulses have to be at least twice this apart
    std::int64_t settle_ns = 250'000'000;  ///< by then an edge has come from either side, or will not
  };

  SyncLine() : SyncLine(Options()) {}
  explicit SyncLine(const Options& options);

  void line_edge(std::int64_t mono_ns, bool rising);
  /// `mapped`: where the mapping put this edge when it was announced.
  void device_edge(double device_us, bool rising, const MappedTime& mapped);
  /// Decides on what is due; call it again until it returns nothing.
  [[nodiscard]] std::optional<SyncCheck> next(std::int64_t now_ns);
  /// Either side was away: what waits has no counterpart any more.
  void forget() noexcept;

  [[nodiscard]] const SyncCounts& counts() const noexcept { return counts_; }

 private:
  struct LineEdge {
    std::int64_t mono_ns = 0;
    bool rising = false;
  };
  struct DeviceEdge {
    double device_us = 0.0;
    bool rising = false;
    MappedTime mapped;
  };

  [[nodiscard]] std::optional<SyncCheck> decide(const DeviceEdge& edge);
  [[nodiscard]] bool is_crowded(const DeviceEdge& edge) const noexcept;
  void drop_unannounced(std::int64_t before_ns) noexcept;
  SyncCheck pair(const DeviceEdge& edge, std::int64_t mono_ns) noexcept;

  Options options_;
  std::vector<LineEdge> line_;  // a few, or as many as may wait: without an allocation
  std::vector<DeviceEdge> device_;
  std::optional<DeviceEdge> decided_;  // the last one
  bool has_begun_ = false;             // edges of the line before the device's first are nobody's
  int opposite_in_a_row_ = 0;
  SyncCounts counts_;
};

}  // namespace isorig::clock
