#pragma once
#include <memory>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "drivers/frame/modbus_frame.hpp"
#include "fake_frame.hpp"
#include "sim/wire/frame/modbus_server.hpp"
#include "tree.hpp"

namespace isorig::sim {

enum class Line { kTcp, kRtu };

inline void PrintTo(Line line, std::ostream* out) {
  *out << (line == Line::kTcp ? "TCP" : "RTU");
}

/// A fake frame, the emulator round it, and the driver at the other end of a real socket or pseudo-terminal.
struct FakeWire {
  /// A time-out that no answer misses because the machine stood still.
  static constexpr int kPatience_ms = 10'000;

  explicit FakeWire(Line line, const std::string& map_file = "isorig-gateway.toml", int timeout_ms = kPatience_ms)
      : FakeWire(line, modbus::read_register_map(test::source_path("/config/frames/") + map_file), timeout_ms) {}

  FakeWire(Line line, const modbus::RegisterMap& map, int timeout_ms = kPatience_ms) : fake(map.sample_rate_Hz) {
    ModbusServer::Options options;
    options.map = map;
    options.tcp = line == Line::kTcp;
    options.client_silence_ms = kSilence_ms;
    options.pty = line == Line::kRtu;
    server = std::make_unique<ModbusServer>(options, fake, faults);
    config.map = map;
    config.transport = line == Line::kTcp ? modbus::ModbusTransport::kTcp : modbus::ModbusTransport::kRtu;
    config.port = server->port();
    config.tty = server->tty();
    config.response_timeout_ms = timeout_ms;
    driver = std::make_unique<frame::ModbusFrame>(config, fake.clock());
  }

  /// Polls until nothing new comes, and returns what came.
  std::vector<frame::Sample> drain(std::size_t at_once = 4096) {
    std::vector<frame::Sample> all, part(at_once);
    for (;;) {
      last = driver->poll(part);
      lost += last.lost;
      all.insert(all.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(last.samples));
      if (last.samples == 0) return all;
    }
  }

  static constexpr int kSilence_ms = 1500;
  FakeFrame fake;
  FrameWireFaults faults;
  std::unique_ptr<ModbusServer> server;
  modbus::ModbusConfig config;
  std::unique_ptr<frame::ModbusFrame> driver;
  frame::Poll last;
  std::uint64_t lost = 0;
};

}  // namespace isorig::sim
