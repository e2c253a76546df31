#pragma once
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "calibration/record.hpp"

namespace isorig::calibration {

/// What corrects one channel now.
struct InForce {
  Channel channel = Channel::kPressure;
  Correction correction;           ///< of `record`, or the rig file's
  const Record* record = nullptr;  ///< null: never calibrated, the rig file's numbers
};

/// The records of one rig: a directory of TOML files, one each, that only grows. The newest record of a channel is in
/// force.
class Store {
 public:
  /// Reads what is there; a directory that is missing holds nothing. Throws base::ConfigError for a record that cannot
  /// be read: a correction nobody can vouch for must not be applied, nor silently left out.
  Store(std::filesystem::path directory, std::array<Correction, 3> fallback);

  [[nodiscard]] InForce in_force(Channel channel) const;
  [[nodiscard]] const std::vector<Record>& records() const noexcept { return records_; }  ///< oldest first
  [[nodiscard]] const std::filesystem::path& directory() const noexcept { return directory_; }

  /// Writes a new record and makes it the one in force. Throws std::runtime_error when a record of that name is there,
  /// or it does not follow the one in force, or cannot be written.
  void add(const Record& record);

  /// Ids whose date is over. `today` as date.hpp has it.
  [[nodiscard]] std::vector<std::string> overdue(std::string_view today) const;

  /// All that is in force, as a run's "calibration.toml".
  [[nodiscard]] std::string toml() const;

 private:
  std::filesystem::path directory_;
  std::array<Correction, 3> fallback_;
  std::vector<Record> records_;
};

/// One line for people: "calibration of pressure (20261121-071500-pressure) was due on 2027-11-21".
[[nodiscard]] std::string overdue_text(const Record& record);

}  // namespace isorig::calibration
