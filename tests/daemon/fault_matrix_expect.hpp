#pragma once
#include <initializer_list>
#include <string>
#include <vector>

#include "fault_matrix_faults.hpp"
#include "fault_matrix_rig.hpp"

/// What each fault has to lead to in each situation: the table that docs/faults.md shows and that fault_matrix_test
/// holds the rig to.
namespace isorig::daemon::test {

struct Expected {
  enum class Kind : std::uint8_t {
    kTrips,       ///< faulted, with one of the codes as the first cause
    kNotReady,    ///< between runs: not ready, and the reason has these words; no fault
    kStandsDown,  ///< back to rest without a fault: ready again, or it will be
    kRides,       ///< goes on as if nothing had been
    kUnseen,      ///< goes on, and `why` says why it cannot be seen, or need not be yet
    kImpossible,  ///< not played: `why`
  } kind = Kind::kRides;
  std::vector<std::string> codes;  ///< of kTrips; of kNotReady one element: words of the reason
  double within_s = 0.0;           ///< until the trip
  std::string why;
};
[[nodiscard]] const char* to_text(Expected::Kind kind);

[[nodiscard]] const Expected& expected(const Fault& fault, At at);

/// A frame that is told and obeys is confirmed to stand 0.28 s after the stop from 10 mm/s.
inline constexpr double kStands_s = 0.3;  ///< from the trip
/// One that is not reached, or does not obey, stands by its own watchdog of 0.5 s without a heartbeat, and 0.25 s for
/// its brake; two polls.
inline constexpr double kStandsByItself_s = 0.02 + 0.5 + 0.25 + 0.05;  ///< from the strike

/// What follows from the trip, in s; the derivation stands in docs/faults.md.
struct Bounds {
  bool by_itself = false;  ///< the frame stops, nobody can tell it to
  double vents_s = 0.0;    ///< from the trip, where it is a safe state
  double rest_psi = 1.0;   ///< and to this pressure
  double watch_s = 8.0;    ///< so long is looked
};
[[nodiscard]] Bounds bounds(const Fault& fault, const Expected& expected);

[[nodiscard]] Losses losses(const Fault& fault);

/// docs/faults.md.
[[nodiscard]] std::string faults_page();

}  // namespace isorig::daemon::test
