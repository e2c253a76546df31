#pragma once
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "drivers/api/frame.hpp"
#include "drivers/config/register_map.hpp"
#include "sim/wire/faults.hpp"

namespace isorig::sim {

/// A frame gateway on the wire: serves a register map round any frame::Device, over Modbus TCP, a
/// pseudo-terminal or a real tty, several at once if wanted, and misbehaves on request.
///
/// One thread owns the backend and the registers. Before each answer it polls the backend, so that the device
/// time in the answer is that of the request: the backend has to bring an exchange with every poll, with no
/// delays of its own, since here the wire makes them. Between requests it polls every 5 ms. Heartbeat and
/// watchdog are the backend's. One TCP client at a time: another waits in the backlog until the first has
/// closed or was silent for `client_silence_ms`, so that two daemons cannot move one frame in turns, and one
/// whose old connection hangs gets in again.
class ModbusServer {
 public:
  struct Options {
    modbus::RegisterMap map;
    bool tcp = true;
    std::string tcp_address = "127.0.0.1";
    std::uint16_t tcp_port = 0;  ///< 0: a free one, see port()
    int client_silence_ms = 1000;
    bool pty = false;      ///< makes a pseudo-terminal, see tty()
    std::string pty_link;  ///< a symbolic link to it, replaced and removed again
    std::string tty;       ///< serves on this serial port too
    int tty_baud = 115200;
    char tty_parity = 'N';
  };

  /// Connects the backend, listens and serves. Throws std::runtime_error or the backend's DeviceError.
  /// `backend` and `faults` outlive the server; nothing else may use the backend meanwhile (or it locks by
  /// itself).
  ModbusServer(Options options, frame::Device& backend, FrameWireFaults& faults);
  ~ModbusServer();
  ModbusServer(const ModbusServer&) = delete;
  ModbusServer& operator=(const ModbusServer&) = delete;

  [[nodiscard]] std::uint16_t port() const noexcept;
  /// Path of the pseudo-terminal for the client to open.
  [[nodiscard]] std::string tty() const;

  [[nodiscard]] std::uint64_t requests() const noexcept;
  [[nodiscard]] std::uint64_t connections() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isorig::sim
