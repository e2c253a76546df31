#pragma once
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/api/clock.hpp"
#include "drivers/config/instron8800_config.hpp"
#include "drivers/frame/line_stream.hpp"

namespace isorig::frame {

/// Questions and answers with a controller whose answers say nothing of their question.
///
/// Each Q line has one answer line, in order; C and P lines have none. So there is never more than one question out.
/// A lost, late, damaged or superfluous line shifts every answer after it by one. Two things find and mend that:
///
///  - The *check*: Q307 of the position and of the force channel in turn, whose answers ("0,3", "0,2") differ from
///    each other and from every number. Answers are believed only when the check that was asked after them got its
///    right answer.
///  - After no answer in time, a malformed answer, a line without a question, or a new connection the line is in
///    doubt, and recover() gets it in step: silence, both checks in order, silence. While the controller is silent one
///    check is unanswered, and is sent again after 2, 4, 8 ... response time-outs; a late answer is thrown away
///    meanwhile.
///
/// What no check can find: an answer that is damaged into another number.
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
    std::uint64_t late = 0;     ///< lines that were thrown away
    std::uint64_t resyncs = 0;  ///< times the line was in doubt and brought back in step
  };

  Instron8800Link(const Instron8800Config& config, clock::Clock& clock);

  /// Throws DeviceError. The line is in doubt then.
  void open();
  void close() noexcept;
  [[nodiscard]] bool is_open() const noexcept { return stream_.is_open(); }

  /// A line without an answer; at once, whatever is out or in doubt.
  void tell(std::string_view command);
  /// The same, and the line that comes within quiet_ms after all: some controllers answer what they do not know.
  std::optional<std::string> tell_and_listen(std::string_view command, std::int64_t until_ns);

  [[nodiscard]] bool in_step() const noexcept { return !in_doubt_; }
  /// An answer made no sense: nothing is asked until recover() has succeeded.
  void doubt() noexcept;
  /// Goes on getting in step until `until_ns`; true when it is. Throws every response_timeout_ms that it takes:
  /// kTimeout, or kProtocol when lines keep coming, or kIdentity when the check has another answer; kDisconnected after
  /// give_up_ms without a single line.
  bool recover(std::int64_t until_ns);

  /// Sends a question; false, with the line in doubt, when there was a line that nobody had asked for. In step only.
  bool begin(std::string_view question);
  /// The answer, if it comes by `until_ns`. Throws kTimeout, with the line in doubt, after response_timeout_ms.
  std::optional<Answer> finish(std::int64_t until_ns);
  [[nodiscard]] bool pending() const noexcept { return pending_; }

  /// What the next check asks, and whether that is its answer; each check is of the other channel than the last.
  [[nodiscard]] std::string check_question() const;
  [[nodiscard]] bool passes_check(std::string_view answer) noexcept;

  /// Asks all of them, then the check; gets in step first, and once more when the check fails. Throws kTimeout when
  /// that takes longer than `until_ns`.
  std::vector<Answer> ask(std::initializer_list<std::string_view> questions, std::int64_t until_ns);

  /// When the controller last answered again after a second or more without an answer: long enough for its watchdog.
  [[nodiscard]] std::int64_t last_silence_ns() const noexcept { return last_silence_ns_; }
  /// What to add to a complaint about an answer: the commands that went out before it, which may have been answered.
  [[nodiscard]] std::string suspects() const;
  [[nodiscard]] const Statistics& statistics() const noexcept { return statistics_; }

 private:
  enum class Phase : std::uint8_t { kSettle, kFirst, kSecond, kSettled };

  void send(std::string_view line);
  void ask_type(int which);
  void note_line(const LineStream::Line& line) noexcept;
  [[noreturn]] void complain();
  void get_in_step(std::int64_t until_ns);
  Answer ask_one(std::string_view question, std::int64_t until_ns);
  [[nodiscard]] std::string at() const { return "frame at " + config_.where() + ": "; }

  const Instron8800Config config_;
  clock::Clock& clock_;
  LineStream stream_;
  std::int64_t last_line_ns_ = 0;   // sent or received
  std::int64_t last_heard_ns_ = 0;  // received, or opened
  std::int64_t last_silence_ns_ = -1;
  int check_ = 0;                  // 0: of the position channel
  std::vector<std::string> told_;  // since the last answer

  bool pending_ = false;
  std::string question_;
  std::int64_t sent_ns_ = 0;

  bool in_doubt_ = false;
  Phase phase_ = Phase::kSettle;
  std::int64_t quiet_from_ns_ = 0;
  std::int64_t next_probe_ns_ = 0, probe_interval_ns_ = 0;
  std::int64_t next_complaint_ns_ = 0;
  std::int64_t doubt_ns_ = 0;
  std::uint64_t thrown_away_ = 0;  // lines in this doubt
  std::string last_thrown_;        // the last of them
  bool wrong_type_ = false;        // one of them looked like the answer of a check, of another channel type
  Statistics statistics_;
};

/// The numbers of an answer, separated by commas. Throws kProtocol when it is anything else or has not `least` to
/// `most`.
[[nodiscard]] std::vector<double> parse_numbers(std::string_view question, std::string_view answer, std::size_t least,
                                                std::size_t most);
[[nodiscard]] inline std::vector<double> parse_numbers(std::string_view question, std::string_view answer,
                                                       std::size_t count) {
  return parse_numbers(question, answer, count, count);
}

}  // namespace isorig::frame
