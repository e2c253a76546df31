#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// What the rig is doing, as far as it matters for what a limit calls for.
enum class Phase : std::uint8_t {
  kMoving,   ///< a run is open and the frame executes a segment of it
  kHolding,  ///< a run is open (running, paused, held by a fault), the crosshead at rest
  kAfter,    ///< stopping, or faulted with the run over
  kBetween,  ///< idle or ready
};

/// What each cause calls for, in each phase. kInfo: nothing by itself (in kBetween it keeps the rig from being ready,
/// where `Supervisor::healthy` says so). docs/states.md has the same table for people.
struct TripRule {
  const char* code;
  Severity moving, holding, after, between;
  [[nodiscard]] constexpr Severity in(Phase phase) const noexcept {
    switch (phase) {
      case Phase::kMoving:
        return moving;
      case Phase::kHolding:
        return holding;
      case Phase::kAfter:
        return after;
      case Phase::kBetween:
        break;
    }
    return between;
  }
};
[[nodiscard]] std::span<const TripRule> trip_rules() noexcept;
/// A code that has no rule is the safe state in every phase.
[[nodiscard]] Severity severity_of(std::string_view code, Phase phase) noexcept;

/// A limit that was broken: which one, what was measured, what it was compared with.
struct Trip {
  Severity severity = Severity::kInfo;  ///< kWarning, kProgramStop or kSafeState; kInfo: nothing happened
  const char* code = "";                ///< stable, e.g. "limit.force"
  const char* what = "";                ///< for people, with what to do
  double value = 0.0;
  double threshold = 0.0;
  [[nodiscard]] explicit operator bool() const noexcept { return severity != Severity::kInfo; }
};

/// What was found in one tick, each code once (with its worst severity), in the order in which it was found.
class TripList {
 public:
  TripList() = default;
  TripList(const TripList& other) noexcept { *this = other; }
  /// Copies what is held, not the room for more: it is done once a tick, nearly always of nothing.
  TripList& operator=(const TripList& other) noexcept {
    count_ = other.count_;
    for (std::size_t i = 0; i < count_; ++i) items_[i] = other.items_[i];
    return *this;
  }

  void note(const Trip& trip) noexcept;
  void clear() noexcept { count_ = 0; }
  [[nodiscard]] const Trip* begin() const noexcept { return items_.data(); }
  [[nodiscard]] const Trip* end() const noexcept { return items_.data() + count_; }
  /// The first of the worst severity; an empty Trip when there is none.
  [[nodiscard]] Trip worst() const noexcept;
  /// The one of this code; an empty Trip when it is not there.
  [[nodiscard]] Trip of(std::string_view code) const noexcept;

 private:
  std::array<Trip, 24> items_{};
  std::size_t count_ = 0;
};

}  // namespace isorig::daemon
