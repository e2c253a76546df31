#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "sim/rig.hpp"
#include "sim/wire/faults.hpp"

namespace isorig::sim {

/// A dual-valve pressure regulator in the plant, with an Alicat-style register map on Modbus RTU (pseudo-terminal) or
/// TCP. Its own implementation of both framings. It regulates by its own sensor, and goes on with its last set-point
/// when nobody speaks to it any more. One thread.
class RegulatorServer {
 public:
  struct Options {
    bool tcp = false;
    std::string tcp_address = "127.0.0.1";
    std::uint16_t tcp_port = 0;  ///< 0: a free one, see port()
    std::string pty_link;
    std::uint8_t unit_id = 1;
    double full_scale_psi = 30.0;
  };

  /// Throws std::runtime_error. `rig` and `faults` outlive the server.
  RegulatorServer(const Options& options, Rig& rig, RegulatorFaults& faults);
  ~RegulatorServer();
  RegulatorServer(const RegulatorServer&) = delete;
  RegulatorServer& operator=(const RegulatorServer&) = delete;

  [[nodiscard]] std::uint16_t port() const noexcept;
  [[nodiscard]] double setpoint_psi() const noexcept;
  [[nodiscard]] bool exhausting() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isorig::sim
