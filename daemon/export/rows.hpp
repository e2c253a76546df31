#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "daemon/export/table.hpp"
#include "daemon/export/times.hpp"
#include "daemon/export/writer.hpp"
#include "messages/run_log.hpp"

/// The messages of a log as rows of an export's streams.
namespace isorig::daemon {

/// Values in the order of the stream's columns. Of a full sample minimum and maximum are NaN, and `samples` is 1.
struct Row : TimedRow {
  std::array<double, 6> value{};
  std::int32_t step = -1;
  std::int32_t samples = 1;
  bool averaged = false;
};

/// Where a row of a log without sessions belongs (a logger's file of the live channels): between which events its time
/// lies.
struct LiveSession {
  std::int64_t from_ns = 0;
  std::int64_t until_ns = std::numeric_limits<std::int64_t>::max();
  std::int32_t repetition = 0;  ///< 0: the log does not say
  double pressure_psi = std::numeric_limits<double>::quiet_NaN();
  bool ended = false;
};

/// Calls row() for every sample or interval of the streams, in the order of the log.
class RowSource : public messages::RunVisitor {
 public:
  void frame(const isorig_msgs::frame_batch_t& m) final;
  void frame_average(const isorig_msgs::frame_average_batch_t& m) final;
  void pressure(const isorig_msgs::pressure_batch_t& m) final;
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) final;
  void control(const isorig_msgs::control_batch_t& m) final;

 protected:
  virtual void row(Stream stream, std::int32_t session, const Row& row) = 0;
  /// Pressure samples that are no measurement: stale or faulty words.
  virtual void not_measured(std::int32_t, std::size_t) {}
  /// For a log without a header; empty: the messages say it.
  void set_live(const std::vector<LiveSession>* live) noexcept { live_ = live; }
  [[nodiscard]] std::int32_t session_of(std::int32_t said, std::int64_t mono_ns) const noexcept;

 private:
  const std::vector<LiveSession>* live_ = nullptr;
};

/// Brings rows that are at most `lateness_ns` late into the order of their time, each at least 2 ns behind the one
/// before: a recording's times increase by 1 ns or more, in seconds as they are rounded. A row that is moved for that
/// has a bound wider by as much. Rows of one time keep their order. Memory: what comes within `lateness_ns`.
class RowOrder {
 public:
  explicit RowOrder(std::int64_t lateness_ns) : lateness_ns_(lateness_ns) {}
  void add(const Row& row);
  /// Those that nothing can precede any more; `all`: the rest as well.
  void take(bool all, const std::function<void(const Row&)>& to);
  [[nodiscard]] bool due() const noexcept { return waiting_.size() >= due_; }
  [[nodiscard]] std::size_t moved() const noexcept { return moved_; }

 private:
  std::int64_t lateness_ns_;
  std::int64_t newest_ns_ = std::numeric_limits<std::int64_t>::min();
  std::int64_t last_ns_ = std::numeric_limits<std::int64_t>::min();
  std::vector<Row> waiting_;
  std::size_t due_ = kBlockRows;
  std::size_t moved_ = 0;
};

/// The stable sort by time that RowOrder does, of all rows at once; returns how many were put behind the one before.
std::size_t order_rows(std::vector<Row>& rows);

}  // namespace isorig::daemon
