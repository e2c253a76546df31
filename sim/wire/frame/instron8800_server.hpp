#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/api/frame.hpp"
#include "sim/wire/faults.hpp"

namespace isorig::sim {

/// An 8800-type controller on the wire: the ASCII Q/C/P command set, as far as public sources describe it
/// (docs/wire-8800.md), round any frame::Device, over TCP or a pseudo-terminal.
///
/// It answers questions in order and commands not at all; ramps, control mode, watchdog and actuator are its own; the
/// crosshead, its limits and the interlock chain are the backend's. A command from a computer that has no control trips
/// the actuator, as it does on real ones. One thread.
class Instron8800Server {
 public:
  struct Options {
    bool tcp = true;
    std::string tcp_address = "127.0.0.1";
    std::uint16_t tcp_port = 0;  ///< 0: a free one, see port()
    std::string pty_link;        ///< not TCP: a symbolic link to the pseudo-terminal
    int position_channel = 1, force_channel = 2;
    double position_full_scale_mm = 50.0, force_full_scale_N = 250.0;
    double watchdog_s = 3.0;
    int answer_us = 0;  ///< what the controller takes for an answer

    /// Dialects. Nobody has published which one a given controller has.
    enum class Watchdog : std::uint8_t {
      kTwoNumbers,  ///< C904,a,b and Q904 -> "a,b"
      kOneNumber,   ///< C904,a and Q904 -> "a"
      kNotAsked,    ///< C904,a alone: Q904 is not known
    } watchdog = Watchdog::kTwoNumbers;
    bool answers_unknown = false;    ///< what it does not know is answered by a text, a command too
    bool takes_sign = true;          ///< C4 takes targets below zero
    bool ends_ramps = false;         ///< Q1 falls to 0 when a ramp has arrived
    double ramp_of_scale_per_s = 0;  ///< above 0: ramps run at this, whatever C86 says
  };

  /// Connects the backend and serves. Throws std::runtime_error. `backend` and `faults` outlive the server.
  Instron8800Server(const Options& options, frame::Device& backend, Instron8800Faults& faults);
  ~Instron8800Server();
  Instron8800Server(const Instron8800Server&) = delete;
  Instron8800Server& operator=(const Instron8800Server&) = delete;

  [[nodiscard]] std::uint16_t port() const noexcept;
  /// Path of the pseudo-terminal, "" on TCP.
  [[nodiscard]] std::string tty() const;
  [[nodiscard]] std::uint64_t lines() const noexcept;
  [[nodiscard]] std::uint64_t watchdog_trips() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isorig::sim
