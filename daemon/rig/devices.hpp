#pragma once
#include <memory>
#include <vector>

#include "daemon/rig/config.hpp"
#include "daemon/rig/device_claim.hpp"
#include "drivers/api/clock.hpp"
#include "drivers/api/frame.hpp"
#include "drivers/api/interlock.hpp"
#include "drivers/api/pressure.hpp"
#include "drivers/api/regulator.hpp"
#include "sim/rig.hpp"

namespace isorig::daemon {

/// The rig's devices as its file names them: drivers, or the simulated rig in process. Not connected yet.
struct Devices {
  std::vector<DeviceClaim> claims;  ///< of the real ones; given back after the drivers are gone
  std::unique_ptr<sim::Rig> rig;    ///< when simulated; owns the devices below
  std::unique_ptr<frame::Device> owned_frame;
  std::unique_ptr<pressure::Device> owned_pressure;
  std::unique_ptr<interlock::Device> owned_interlock;
  std::unique_ptr<pressure::Regulator> regulator;  ///< nothing where valves set the pressure
  frame::Device* frame = nullptr;
  pressure::Device* pressure = nullptr;
  interlock::Device* interlock = nullptr;
};

/// Throws std::runtime_error when another program drives one of them. For real time: the simulated rig follows `clock`
/// and may be called from several threads.
[[nodiscard]] Devices open_devices(const RigConfig& rig, clock::Clock& clock);

}  // namespace isorig::daemon
