#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/clock/clock.hpp"
#include "drivers/frame/instron8800_config.hpp"
#include "drivers/frame/line_stream.hpp"

namespace isorig::frame {

/// Questions and answers with a controller whose answers say nothing of their question.
///
/// Each Q line has one answer line, in order; C and P lines have none. So there is never more than one question out.
/// One that is not answered in time stays out: nothing else is asked until its answer came (and was thrown away) or
/// give_up_ms passed, and then the connection is given up. After any doubt - a late answer, a line nobody asked for, a
/// fresh connection - two questions whose answers differ from each other and from any number (the channels' types,
/// "0,3" and "0,2") are asked in turn until the right answers come in the right order and silence follows.
///
/// Commands need no answer, so a stop goes out at any time, also while the controller hangs.
class Instron8800Link {
 public:
  struct Answer {
    std::string text;
    std::int64_t sent_ns = 0, received_ns = 0;
  };
  struct Statistics {
    std::uint64_t questions = 0, commands = 0;
    std::uint64_t late = 0;     ///< answers that were thrown away
    std::uint64_t resyncs = 0;  ///< times the line was in doubt and brought back in step
  };

  Instron8800Link(const Instron8800Config& config, clock::Clock& clock);

  /// Throws DeviceError. The line is in doubt then: the first question gets it in step.
  void open();
  void close() noexcept;
  [[nodiscard]] bool is_open() const noexcept { return stream_.is_open(); }

  /// A line without an answer.
  void tell(std::string_view command);
  /// Asks and waits at most response_timeout_ms (and as long for a question that is still out, whose answer is dropped).
  Answer ask(std::string_view question);

  /// The same in two parts, for a caller that has to look after other things while it waits.
  void begin(std::string_view question);
  /// The answer, if it comes by `until_ns`. Throws kTimeout when it came too late (and was thrown away), and every
  /// response_timeout_ms that it is missing; kDisconnected when it is given up.
  std::optional<Answer> finish(std::int64_t until_ns);
  [[nodiscard]] bool pending() const noexcept { return pending_; }
  /// Waits for what is out and drops it. Throws as finish() does.
  void drop_pending();

  /// An answer made no sense: the next question gets in step first.
  void doubt() noexcept;
  /// When the line was last in doubt.
  [[nodiscard]] std::int64_t last_doubt_ns() const noexcept { return last_doubt_ns_; }
  [[nodiscard]] const Statistics& statistics() const noexcept { return statistics_; }

 private:
  void wait_for_gap();
  void send(std::string_view line);
  void get_in_step();
  [[nodiscard]] bool line_is_quiet();
  void await_type(int channel, std::string_view type);

  const Instron8800Config config_;
  clock::Clock& clock_;
  LineStream stream_;
  bool in_doubt_ = false;
  std::int64_t last_doubt_ns_ = -1;
  std::int64_t last_line_ns_ = 0;
  bool pending_ = false;
  std::string question_;
  std::int64_t sent_ns_ = 0;
  std::int64_t next_complaint_ns_ = 0;
  Statistics statistics_;
};

/// The numbers of an answer, separated by commas. Throws kProtocol when it is anything else or has another count.
[[nodiscard]] std::vector<double> parse_numbers(std::string_view question, std::string_view answer, std::size_t at_least);

}  // namespace isorig::frame
