#pragma once
#include <string>

#include "drivers/api/regulator.hpp"
#include "drivers/config/regulator_config.hpp"
#include "drivers/modbus/modbus_link.hpp"

namespace isorig::pressure {

/// A pressure regulator with an Alicat-style register map over Modbus RTU or TCP (docs/wire-regulator.md).
///
/// A write is answered with what was sent, not with what became of it: every set-point is read back. A regulator keeps
/// its last set-point when nobody speaks to it any more; what vents then is not here but in the plumbing.
class AlicatRegulator final : public Regulator {
 public:
  explicit AlicatRegulator(RegulatorConfig config);

  std::string connect() override;
  void disconnect() noexcept override;
  void regulate(float setpoint_psi) override;
  void exhaust() override;
  RegulatorState read() override;

 private:
  [[nodiscard]] std::string at() const { return "regulator at " + config_.line.where() + ": "; }
  double read_float(std::uint16_t address);
  void write_setpoint(double psi);
  void valve(std::uint16_t argument);
  void check_known();

  const RegulatorConfig config_;
  modbus::ModbusLink link_;
  bool exhausting_ = false;
};

}  // namespace isorig::pressure
