#pragma once
#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::daemon {

/// What a rig file sets in the tables that keep people and specimens safe: "limits.force_max_N" -> "120". Comments,
/// order and ways of writing a number make no difference; what is not set is not there. Throws when it is not TOML.
[[nodiscard]] std::map<std::string, std::string> safety_keys(std::string_view rig_toml);

struct RigChange {
  std::string key, before, now;  ///< "(not set)" where there is nothing
  [[nodiscard]] std::string text() const { return key + ": " + before + " -> " + now; }
};

/// Who accepted a rig's file as it is, and what has changed in it since. Kept in RUNS/accepted/NAME.jsonl, a line for
/// each acceptance, the last one in force; nothing is ever taken out.
class RigAcceptance {
 public:
  /// Reads what was accepted last. Throws std::runtime_error when it cannot be read.
  RigAcceptance(std::string rig_name, std::string_view rig_toml, const std::filesystem::path& runs_root);

  [[nodiscard]] bool ever() const noexcept { return !operator_.empty(); }
  [[nodiscard]] const std::string& operator_name() const noexcept { return operator_; }
  [[nodiscard]] uid_t uid() const noexcept { return uid_; }
  [[nodiscard]] const std::string& when_utc() const noexcept { return when_utc_; }
  /// Since it was accepted; empty, too, when it never was.
  [[nodiscard]] const std::vector<RigChange>& changes() const noexcept { return changes_; }
  [[nodiscard]] bool in_force() const noexcept { return ever() && changes_.empty(); }
  /// In words, for a log, a refusal, a screen: a line each, at most `most` changes.
  [[nodiscard]] std::string summary(std::size_t most = 8) const;

  /// The file as the daemon has read it is accepted from now on; on the disk when this returns. Throws
  /// std::runtime_error, and nothing is accepted then.
  void accept(const std::string& operator_name, uid_t uid, std::int64_t unix_s);

 private:
  std::filesystem::path path_;
  std::string rig_;
  std::map<std::string, std::string> keys_;
  std::string operator_, when_utc_;
  uid_t uid_ = 0;
  std::vector<RigChange> changes_;
};

}  // namespace isorig::daemon
