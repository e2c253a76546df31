#include "daemon/io/regulator_service.hpp"

#include <cmath>
#include <exception>

namespace isorig::daemon {
namespace {

// A step of the set-point finer than this is the trim's; it goes out once several of them have added up.
constexpr float kSetpointStepPsi = 0.005F;
constexpr float kSetpointLostPsi = 0.05F;

}  // namespace

void RegulatorService::run_once(std::int64_t now_ns) noexcept {
  keep(now_ns, [&] { turn(now_ns); });
}

void RegulatorService::turn(std::int64_t now_ns) {
  if (!health_.connected) {
    if (!may_connect(now_ns)) return;
    note_connected(device_.connect());
    report_health(now_ns, true);
    // It exhausts now. A run that counted on it is over, however short the break was.
    if (sent_psi_ >= 0.0F) report_fault(now_ns);
    sent_psi_ = -1.0F;
  }
  const bool loop_alive = loop_.alive(link_.loop_beat.load(std::memory_order_acquire), now_ns);
  const auto command = link_.get_command();
  const bool regulate = loop_alive && command.vent_permille == 0 && command.regulator_psi > 0.0F;
  if (!regulate) {
    if (sent_psi_ >= 0.0F) device_.exhaust();
    sent_psi_ = -1.0F;
  } else if (sent_psi_ < 0.0F || std::abs(command.regulator_psi - sent_psi_) >= kSetpointStepPsi) {
    device_.regulate(command.regulator_psi);
    sent_psi_ = command.regulator_psi;
  }
  const auto state = device_.read();
  // What is no number is not what was sent.
  const bool is_kept = std::abs(state.setpoint_psi - sent_psi_) <= kSetpointLostPsi;
  if (sent_psi_ >= 0.0F && (state.exhausting || !is_kept)) {
    report_fault(now_ns);
    device_.exhaust();
    throw drivers::DeviceError(drivers::Fault::kRefused,
                               "the regulator no longer has the set-point it was given; is somebody "
                               "at its panel, or was it without power?");
  }
  link_.regulator_reports.push({state, now_ns});
  note_answer();
}

void RegulatorService::report_fault(std::int64_t now_ns) noexcept {
  pressure::RegulatorState lost;
  lost.faulty = true;
  link_.regulator_reports.push({lost, now_ns});
}

void RegulatorService::drop(std::int64_t /*now_ns*/) noexcept {
  try {
    device_.exhaust();
  } catch (const std::exception&) {
    // Supply and vent valve are the Teensy's: the pressure goes without it.
  }
  device_.disconnect();
}

void RegulatorService::shut_down() noexcept {
  try {
    if (health_.connected) device_.exhaust();
  } catch (const std::exception&) {
  }
  device_.disconnect();
  health_.connected = false;
}

}  // namespace isorig::daemon
