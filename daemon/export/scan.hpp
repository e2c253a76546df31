#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "daemon/export/rows.hpp"
#include "daemon/recording/session_marks.hpp"
#include "messages/run_log.hpp"

/// The first of an export's two passes over a log: what each attempt at each session holds, so that the second can
/// write row after row without keeping any.
namespace isorig::daemon {

/// Of one stream in one attempt at one session.
struct Extent {
  std::size_t rows = 0;
  std::int64_t first_ns = std::numeric_limits<std::int64_t>::max();
  std::int64_t newest_ns = std::numeric_limits<std::int64_t>::min();
  std::int64_t lateness_ns = 0;  ///< how far a row's time was behind the newest before it, at most

  void take(std::int64_t mono_ns) noexcept;
};

/// What the controller said first in a step.
struct StepTargets {
  double target_mm = 0.0, velocity_mm_s = 0.0, setpoint_psi = 0.0;
};

struct ScannedSession {
  std::int32_t attempt = 0;
  bool complete = false;
  std::array<Extent, kStreams> stream;
  std::size_t not_measured = 0;
  std::int64_t end_ns = 0;  ///< of its end mark or event; 0 without
  SessionMarks marks;
  std::map<std::int32_t, StepTargets> targets;  ///< by step
};

/// The smallest step between neighbouring readings: what one digit of the device is worth after calibration.
class ReadingStep {
 public:
  void take(double reading) noexcept;
  /// 0 when no reading ever differed from the one before.
  [[nodiscard]] double value() const noexcept;

 private:
  double last_ = std::numeric_limits<double>::quiet_NaN();
  double smallest_ = std::numeric_limits<double>::infinity();
  double largest_ = 0.0;
};

class Scan : public RowSource {
 public:
  Scan() = default;
  /// Again, of a log that has no header: with the sessions that its events tell.
  explicit Scan(const std::vector<LiveSession>& live) { set_live(&live); }

  void header(const isorig_msgs::run_header_t& h) override;
  void session(const isorig_msgs::session_mark_t& m) override;
  void event(const isorig_msgs::event_t& m) override;
  void exchanges(const isorig_msgs::exchange_batch_t& m) override;

  /// By attempt.
  std::map<std::int32_t, isorig_msgs::run_header_t> headers;
  std::map<std::int32_t, std::array<std::vector<clock::Exchange>, 2>> exchanges_of;
  /// By session, the attempts in their order.
  std::map<std::int32_t, std::vector<ScannedSession>> sessions;
  ReadingStep position_step, force_step, pressure_step;
  /// What the events `session.start` and `session.end` tell; one that is open at both ends when there are none.
  [[nodiscard]] std::vector<LiveSession> live_sessions() const;

  /// A log without session marks says by an event that a session came to its end.
  void set_ended(std::int32_t session, const LiveSession& live);

  /// Of several attempts the last that has frame samples, unless only an earlier one is complete; null without any.
  [[nodiscard]] const ScannedSession* chosen(std::int32_t session) const;

 protected:
  void row(Stream stream, std::int32_t session, const Row& row) override;
  void not_measured(std::int32_t session, std::size_t samples) override;

 private:
  ScannedSession& at(std::int32_t session);

  std::int32_t attempt_ = 0;
  MissingCounts missing_;
  std::vector<LiveSession> live_;
};

}  // namespace isorig::daemon
