#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/api/frame.hpp"
#include "sim/wire/faults.hpp"
#include "sim/wire/frame/instron8800_server.hpp"

namespace isorig::sim {

/// What the emulated controller makes of a line; no wire. Time is what it is passed.
class Instron8800Controller {
 public:
  Instron8800Controller(const Instron8800Server::Options& options, frame::Device& backend, Instron8800Faults& faults);

  /// The answer of a question; nothing for a command or what is neither, unless it answers what it does not know.
  std::optional<std::string> execute(std::string_view line, std::int64_t now_ns);
  /// Watchdog, interlock chain and the backend's samples and heartbeat; at 50 Hz or more.
  void advance(std::int64_t now_ns);
  /// Off and on again: at rest, nothing set, no watchdog, the panel in control.
  void restart();

  [[nodiscard]] std::uint64_t watchdog_trips() const noexcept { return watchdog_trips_; }

 private:
  static constexpr std::size_t kChannels = 9;  // numbered from 1
  struct Channel {
    double amplitude = 0.0;  // of full scale
    double time_s = 1.0;
    int ramp = 0;
  };

  std::string answer(int code, const std::vector<double>& arguments);
  /// False for what this controller does not know.
  bool command(int code, const std::vector<double>& arguments, std::int64_t now_ns);
  [[nodiscard]] std::optional<std::string> unknown() const;
  [[nodiscard]] std::string feedback(int channel);
  [[nodiscard]] unsigned status_code() const noexcept;
  void read_backend();
  void start_ramp();
  void stop_backend();
  void trip_actuator();

  const Instron8800Server::Options options_;
  frame::Device& backend_;
  Instron8800Faults& faults_;
  std::array<Channel, kChannels> channels_{};
  std::vector<frame::Sample> samples_;
  frame::Sample newest_;
  frame::State state_;
  int movement_ = 0;
  int control_channel_;
  int waveform_ = 0;
  long quarter_counts_ = 0;
  std::int64_t fed_ns_ = 0;
  std::int64_t next_beat_ns_ = 0;
  std::uint16_t beat_ = 0;
  std::uint16_t segment_ = 0;
  std::uint64_t watchdog_trips_ = 0;
};

}  // namespace isorig::sim
