#pragma once
#include <cstdint>

#include "daemon/core/links.hpp"
#include "daemon/io/link_keeper.hpp"

namespace isorig::daemon {

/// The regulator that sets the pressure while the Teensy measures it. A loop that does not tick gets no set-point
/// through: the regulator exhausts.
class RegulatorService : private LinkKeeper {
 public:
  RegulatorService(pressure::Regulator& device, PressureLink& link)
      : LinkKeeper(link.regulator_health), device_(device), link_(link) {}
  /// One turn. Never throws.
  void run_once(std::int64_t now_ns) noexcept;
  /// Exhausts and closes; called on every way out.
  void shut_down() noexcept;

 private:
  void turn(std::int64_t now_ns);
  void drop(std::int64_t now_ns) noexcept override;
  void report_fault(std::int64_t now_ns) noexcept;

  pressure::Regulator& device_;
  PressureLink& link_;
  float sent_psi_ = -1.0F;  ///< below 0: it exhausts
  LoopWatch loop_;
};

}  // namespace isorig::daemon
