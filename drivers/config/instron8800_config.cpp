#include "drivers/config/instron8800_config.hpp"

namespace isorig::frame {

std::string Instron8800Config::where() const {
  return tcp ? "tcp " + host + ":" + std::to_string(port) : "tty " + tty;
}

Instron8800Config read_instron8800_config(const base::TomlTable& t) {
  Instron8800Config c;
  if (t.choice("transport", {"tcp", "tty"}) == "tcp") {
    c.host = t.string("host");
    c.port = static_cast<std::uint16_t>(t.integer("port", {1.0, 65535.0}));
  } else {
    c.tcp = false;
    c.tty = t.string("tty");
    c.baud = static_cast<int>(t.integer("baud", {1200.0, 921600.0}));
    const auto parity = t.choice_or("parity", "none", {"none", "even", "odd"});
    c.parity = parity == "even" ? 'E' : parity == "odd" ? 'O' : 'N';
    c.stop_bits = static_cast<int>(t.integer_or("stop_bits", c.stop_bits, {1.0, 2.0}));
  }
  const auto integer = [&](std::string_view key, int& value, base::Range range) {
    value = static_cast<int>(t.integer_or(key, value, range));
  };
  integer("connect_timeout_ms", c.connect_timeout_ms, {1.0, 10'000.0});
  integer("response_timeout_ms", c.response_timeout_ms, {5.0, 60'000.0});
  integer("give_up_ms", c.give_up_ms, {100.0, 600'000.0});
  integer("gap_us", c.gap_us, {0.0, 1'000'000.0});
  c.answer_ms = t.number_or("answer_ms", c.answer_ms, {0.0, 1000.0});
  integer("quiet_ms", c.quiet_ms, {1.0, 5'000.0});
  integer("position_channel", c.position_channel, {1.0, 8.0});
  integer("force_channel", c.force_channel, {1.0, 8.0});
  c.position_full_scale_mm = t.number_or("position_full_scale_mm", 0.0, base::kNonNegative);
  c.force_full_scale_N = t.number_or("force_full_scale_N", 0.0, base::kNonNegative);
  c.reading_age_max_ms = t.number_or("reading_age_max_ms", c.reading_age_max_ms, {0.0, 1000.0});
  c.in_position_mm = t.number_or("in_position_mm", c.in_position_mm, base::kPositive);
  integer("in_position_ms", c.in_position_ms, {0.0, 10'000.0});
  integer("start_confirm_ms", c.start_confirm_ms, {1.0, 10'000.0});
  integer("stop_confirm_ms", c.stop_confirm_ms, {10.0, 10'000.0});
  integer("heartbeat_timeout_ms", c.heartbeat_timeout_ms, {50.0, 10'000.0});
  c.watchdog_command = t.string_or("watchdog_command", c.watchdog_command);
  integer("watchdog_on", c.watchdog_on, {1.0, 9.0});
  integer("watchdog_feed_ms", c.watchdog_feed_ms, {50.0, 10'000.0});
  c.watchdog_tested = t.boolean_or("watchdog_tested", c.watchdog_tested);
  if (!c.watchdog_command.empty() &&
      (!c.watchdog_command.starts_with("C904,") || c.watchdog_command.starts_with("C904,0"))) {
    t.error("watchdog_command", "`watchdog_command` has to be a C904 command that switches the watchdog on");
  }
  if (c.position_channel == c.force_channel) {
    t.error("force_channel", "`force_channel` and `position_channel` are the same channel");
  }
  if (c.give_up_ms < c.response_timeout_ms) {
    t.error("give_up_ms", "`give_up_ms` is below `response_timeout_ms`");
  }
  return c;
}

}  // namespace isorig::frame
