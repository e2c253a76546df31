#pragma once
#include <string>
#include <vector>

#include "calibration/fit.hpp"

/// One calibration as it is kept: who, when, against what, what was found, what was left. A TOML file that is written
/// once and never changed; a later record of the channel supersedes it.
namespace isorig::calibration {

struct Reference {
  std::string id;               ///< its serial or inventory number
  std::string certificate;      ///< of its own calibration
  std::string certificate_due;  ///< "2027-05-01"
  double uncertainty = 0.0;     ///< k = 2, in the channel's unit
};

struct Record {
  std::string id;  ///< "20261121-071500-pressure": the file's name
  std::string rig;
  Channel channel = Channel::kPressure;
  Mode mode = Mode::kAdjust;
  std::string made_utc;  ///< "2026-11-21T07:15:00Z"
  std::string due;       ///< "2027-11-21"
  std::string operator_name;
  std::string note;
  std::string evidence_run;    ///< the run that held the points, if the rig was driven
  std::string supersedes;      ///< id of the record it follows, "" for the first
  double temperature_C = 0.0;  ///< of the pressure sensor; 0 when it was not read
  Reference reference;
  Correction before;
  std::vector<Point> points;
  Result result;

  [[nodiscard]] bool overdue(std::string_view today) const { return today > due; }
};

[[nodiscard]] std::string to_toml(const Record& record);
/// Throws base::ConfigError with everything that is wrong.
[[nodiscard]] Record parse_record(const std::string& text, const std::string& name);

/// "20261121-071500-pressure" from its time and channel.
[[nodiscard]] std::string record_id(const std::string& made_utc, Channel channel);

}  // namespace isorig::calibration
