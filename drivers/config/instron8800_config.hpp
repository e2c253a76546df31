#pragma once
#include <cstdint>
#include <string>

#include "base/toml_reader.hpp"

namespace isorig::frame {

/// A controller that speaks the ASCII Q/C/P command set of Instron's 8800/FastTrack family, and how to reach it
/// (docs/wire-8800.md has every key, and what has to be checked at the machine before it is relied on).
struct Instron8800Config {
  bool tcp = true;
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;

  std::string tty;
  int baud = 9600;
  char parity = 'N';
  int stop_bits = 1;

  int connect_timeout_ms = 1000;
  /// An answer that comes later is thrown away, and the link gets in step before the next question.
  int response_timeout_ms = 500;
  /// So long without a single line, then the connection is given up.
  int give_up_ms = 15'000;
  /// Silence between an answer or a command and the next line: these controllers are known to fall into an invalid
  /// state when they are sent commands too quickly.
  int gap_us = 5'000;
  /// What this controller takes for an answer, for what `isorig check` reckons of the line; measured at every connect.
  double answer_ms = 0.0;
  /// After a doubt: so long nothing may come before the line counts as quiet.
  int quiet_ms = 50;

  int position_channel = 1, force_channel = 2;
  /// What Q308 has to say of the channels, in mm and N; 0 takes any. The only identity there is, and the only check of
  /// units.
  double position_full_scale_mm = 0.0, force_full_scale_N = 0.0;
  /// How old a value may be in the controller when it answers.
  double reading_age_max_ms = 5.0;

  double in_position_mm = 0.01;
  int in_position_ms = 20;
  int start_confirm_ms = 500;
  /// A stop of a moving crosshead that is not confirmed within this is followed by "actuator off".
  int stop_confirm_ms = 1000;
  /// Without a sign of life from the loop for so long the driver stops the crosshead itself.
  int heartbeat_timeout_ms = 500;

  /// What switches the controller's watchdog on and feeds it; empty: "C904,1,0" where Q904 has two numbers for an
  /// answer, "C904,1" elsewhere. And the first number Q904 then answers.
  std::string watchdog_command;
  int watchdog_on = 1;
  /// Somebody has seen this controller's watchdog stop the crosshead (docs/wire-8800.md). Without that a controller
  /// which cannot be asked for its watchdog is not connected to.
  bool watchdog_tested = false;
  int watchdog_feed_ms = 500;

  /// "tcp 127.0.0.1:5025" or "tty /dev/ttyS0", for messages.
  [[nodiscard]] std::string where() const;
};

/// Reads a rig's [frame] table; what is wrong in it is noted in its document (finish() it).
[[nodiscard]] Instron8800Config read_instron8800_config(const base::TomlTable& frame);

}  // namespace isorig::frame
