#pragma once
#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "calibration/record.hpp"
#include "daemon/host/paths.hpp"

/// What the operator of `isorig calibrate` says: options, answers, values of the reference.
namespace isorig::cli {

inline constexpr double kStandardGravity_m_s2 = 9.80665;

struct CalibrateOptions {
  std::string what;
  std::string mode = "adjust";
  std::vector<double> points;
  std::vector<double> drive;
  std::string reference_command;
  std::string operator_name, reference, certificate, reference_due, due, note;
  double reference_uncertainty = -1.0;
  int interval_days = 365;
  std::string unit;
  double gravity_m_s2 = kStandardGravity_m_s2;
  double window_s = 2.0, settle_s = 30.0, drift_max = -1.0;
  bool yes = false, dry_run = false, json = false, allow_expired = false;
  std::string socket = daemon::default_socket().string();
};

/// Wrong words on the command line: nothing was read, nothing moved.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// From --unit to the channel's unit. Throws UsageError.
[[nodiscard]] double factor_of(const CalibrateOptions& o, calibration::Channel channel);

/// Where the reference's values come from: --point in their order, a command's output, or the operator.
class References {
 public:
  References(const CalibrateOptions& options, double factor, const char* unit)
      : options_(options), factor_(factor), unit_(unit) {}

  /// In the channel's unit; nothing: no more points. `what` says what the operator should do.
  std::optional<double> next(const std::string& what);

 private:
  const CalibrateOptions& options_;
  double factor_;
  std::string unit_;
  std::size_t used_ = 0;
};

/// Who, against what: asked for at a terminal, so that `isorig calibrate pressure` is enough; in a script all that is
/// missing is said at once.
void complete(CalibrateOptions& o);

/// Throws UsageError on options that do not go together, std::runtime_error on a certificate that has ended.
void check_words(const CalibrateOptions& o, calibration::Channel channel, calibration::Mode mode);

/// Throws std::runtime_error on a value, in the channel's unit, that this rig cannot have shown: the unit is wrong
/// then.
void check_reference(calibration::Channel channel, double value, const nlohmann::json& limits);

}  // namespace isorig::cli
