#pragma once
#include <cstdint>
#include <cstdlib>
#include <optional>

namespace isorig::interlock {

/// Which clock the kernel stamps edges with. CLOCK_MONOTONIC since Linux 5.7, CLOCK_REALTIME before (kernel commit
/// 26d060e47e25), and a driver may stamp in hardware with a clock of its own. Found by comparing the first stamp with
/// both, since no interface of libgpiod 1.6 tells.
class StampClock {
 public:
  enum class Kind : std::uint8_t { kUnknown, kMonotonic, kRealtime, kForeign };

  /// The stamp on CLOCK_MONOTONIC; nothing when it is of neither clock. `mono_ns` and `realtime_ns` are both now.
  [[nodiscard]] std::optional<std::int64_t> to_mono(std::int64_t stamp_ns, std::int64_t mono_ns,
                                                    std::int64_t realtime_ns) noexcept {
    if (kind_ == Kind::kUnknown) {
      // Closer than this to both: a machine without a clock chip, just booted. Monotonic it is, being the newer.
      const auto near = [&](std::int64_t clock_ns) {
        const std::int64_t age_ns = clock_ns - stamp_ns;
        return age_ns > -kMargin_ns && age_ns < kOldest_ns;
      };
      kind_ = near(mono_ns) ? Kind::kMonotonic : near(realtime_ns) ? Kind::kRealtime : Kind::kForeign;
    }
    switch (kind_) {
      case Kind::kMonotonic:
        return stamp_ns;
      case Kind::kRealtime:
        return stamp_ns - realtime_ns + mono_ns;
      case Kind::kUnknown:
      case Kind::kForeign:
        break;
    }
    return std::nullopt;
  }

  [[nodiscard]] Kind kind() const noexcept { return kind_; }

 private:
  static constexpr std::int64_t kMargin_ns = 1'000'000;       // both clocks are not read at the same instant
  static constexpr std::int64_t kOldest_ns = 10'000'000'000;  // an edge that waited for a stalled thread

  Kind kind_ = Kind::kUnknown;
};

}  // namespace isorig::interlock
