#pragma once
#include <cmath>
#include <cstdint>
#include <string>

#include "base/number_text.hpp"
#include "base/toml_reader.hpp"
#include "daemon/rig/config_checks.hpp"
#include "drivers/frame/instron8800_times.hpp"

namespace isorig::daemon {

/// One table of the rig; faults of a table that is not there stand at the document's begin, since its defaults count.
class Keys {
 public:
  Keys(const base::TomlTable& root, const char* name)
      : table_(root.table_if(name).value_or(root)), present_(root.has(name)) {}

  [[nodiscard]] bool has(const char* key) const { return present_ && table_.has(key); }

  /// `value` is what the reader made of `key`. A key that is not there has its default, which is right. Nothing is said
  /// of a key that the reader did not accept, nor by a range that such a key leaves empty.
  void range(const char* key, double value, double low, double high, const char* unit, const std::string& why) const {
    if (!has(key) || (value >= low && value <= high) || !(low < high)) return;
    fault(key, value, "from " + base::number_text(low) + " to " + base::number_text(high) + " " + unit, why);
  }
  /// The same where the default may be wrong too, beside other keys.
  void at_most(const char* key, double value, double high, const char* unit, const std::string& why) const {
    if (!(value <= high) && !std::isnan(high))
      fault(key, value, "at most " + base::number_text(high) + " " + unit, why);
  }
  void at_least(const char* key, double value, double low, const char* unit, const std::string& why) const {
    if (!(value >= low) && !std::isnan(low)) fault(key, value, "at least " + base::number_text(low) + " " + unit, why);
  }
  void wrong(const char* key, const std::string& why) const {
    table_.error(present_ ? key : "", "`" + std::string(key) + "`: " + why);
  }

 private:
  void fault(const char* key, double value, const std::string& allowed, const std::string& why) const {
    if (present_ && table_.is_wrong(key)) return;
    table_.error(present_ ? key : "", "`" + std::string(key) + "` = " + base::number_text(value) +
                                          (has(key) ? "" : " (by default)") + "; it has to be " + allowed + ": " + why);
  }

  base::TomlTable table_;
  bool present_;
};

/// From the request of a stop in mid-ramp until the samples have said that the crosshead stands, at most: by what the
/// driver asks on this line, and the samples that the daemon then waits for. Infinite: never.
[[nodiscard]] double stop_confirmed_s(const frame::Instron8800Times& line) noexcept;

/// Limits beyond the frame's own could not trip.
void check_full_scale(const RigConfig& rig, const Keys& limits);
/// Time-outs of the frame's driver against the supervisor's ages, what its line takes for a stop, and the frame's
/// watchdog.
void check_frame(const RigConfig& rig, const Keys& frame, const Keys& supervisor, const Watchdogs& dogs);

}  // namespace isorig::daemon
