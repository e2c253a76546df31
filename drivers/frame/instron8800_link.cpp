#include "drivers/frame/instron8800_link.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "drivers/api/error.hpp"
#include "drivers/frame/instron8800_words.hpp"

namespace isorig::frame {
namespace {

using drivers::DeviceError;
using drivers::Fault;

constexpr std::int64_t kSilence_ns = 1000 * kMs;
/// The second number of Q307, for the position and for the force channel.
constexpr std::array<std::string_view, 2> kTypes{"3", "2"};
/// So many lines in one doubt are no late answers any more.
constexpr std::uint64_t kNoise = 10;
constexpr std::size_t kSuspects = 3;

LineStream::Options stream_options(const Instron8800Config& c) {
  return {c.tcp, c.host, c.port, c.connect_timeout_ms, c.tty, c.baud, c.parity, c.stop_bits, "frame at " + c.where()};
}

/// What stands behind the comma of "0,3"; empty for anything that is not of this form.
std::string_view type_in(std::string_view answer) {
  const auto comma = answer.find(',');
  if (comma == std::string_view::npos) return {};
  auto second = answer.substr(comma + 1);
  while (!second.empty() && second.front() == ' ') second.remove_prefix(1);
  return second;
}

}  // namespace

std::vector<double> parse_numbers(std::string_view question, std::string_view answer, std::size_t least,
                                  std::size_t most) {
  std::vector<double> numbers;
  const char* at = answer.data();
  const char* const end = at + answer.size();
  const auto skip_blanks = [&] {
    while (at != end && *at == ' ') ++at;
  };
  for (;;) {
    skip_blanks();
    if (at != end && *at == '+') ++at;
    double value = 0.0;
    const auto [rest, error] = std::from_chars(at, end, value);
    if (error != std::errc{} || !std::isfinite(value)) break;
    numbers.push_back(value);
    at = rest;
    skip_blanks();
    if (at == end) {
      if (numbers.size() < least || numbers.size() > most) break;
      return numbers;
    }
    if (*at++ != ',') break;
  }
  throw DeviceError(Fault::kProtocol, std::string(question) + " was answered by " + in_quotes(answer) +
                                          ", which is not " +
                                          (most == 1 ? "a number" : std::to_string(least) + " numbers"));
}

Instron8800Link::Instron8800Link(const Instron8800Config& config, clock::Clock& clock)
    : config_(config), clock_(clock), stream_(stream_options(config), clock) {}

void Instron8800Link::open() {
  stream_.open();
  pending_ = false;
  told_.clear();
  last_line_ns_ = 0;
  last_heard_ns_ = clock_.now_ns();
  in_doubt_ = false;
  doubt();  // an answer to whoever asked before us may be under way
}

void Instron8800Link::close() noexcept {
  stream_.close();
  pending_ = false;
}

void Instron8800Link::doubt() noexcept {
  pending_ = false;  // its answer, if it comes, is thrown away on the way back in step
  if (in_doubt_) return;
  in_doubt_ = true;
  phase_ = Phase::kSettle;
  doubt_ns_ = quiet_from_ns_ = clock_.now_ns();
  next_complaint_ns_ = doubt_ns_ + config_.response_timeout_ms * kMs;
  thrown_away_ = 0;
  last_thrown_.clear();
  wrong_type_ = false;
}

void Instron8800Link::send(std::string_view line) {
  clock_.sleep_until_ns(last_line_ns_ + std::int64_t{config_.gap_us} * 1000);
  last_line_ns_ = clock_.now_ns();
  stream_.write_line(line);
}

void Instron8800Link::note_line(const LineStream::Line& line) noexcept {
  if (line.received_ns - last_heard_ns_ > kSilence_ns) last_silence_ns_ = line.received_ns;
  last_line_ns_ = last_heard_ns_ = line.received_ns;
}

// ---- commands
// -------------------------------------------------------------------------------------------------

void Instron8800Link::tell(std::string_view command) {
  send(command);
  ++statistics_.commands;
  if (told_.size() == kSuspects) told_.erase(told_.begin());
  told_.emplace_back(command);
}

std::optional<std::string> Instron8800Link::tell_and_listen(std::string_view command, std::int64_t until_ns) {
  get_in_step(until_ns);
  if (stream_.discard_input()) {
    doubt();
    get_in_step(until_ns);
  }
  tell(command);
  const auto line = stream_.read_line(clock_.now_ns() + config_.quiet_ms * kMs);
  if (!line) {
    told_.pop_back();
    return std::nullopt;
  }
  note_line(*line);
  return line->text;
}

std::string Instron8800Link::suspects() const {
  if (told_.empty()) return {};
  std::string all;
  for (const auto& command : told_) all += (all.empty() ? "" : ", ") + command;
  return "; before it went out " + all +
         ": the line may be what the controller has to say of that, if it answers what it does not know";
}

// ---- one question
// ---------------------------------------------------------------------------------------------

bool Instron8800Link::begin(std::string_view question) {
  if (pending_ || in_doubt_) throw std::logic_error("a question is out already, or the line is in doubt");
  if (stream_.discard_input()) {
    doubt();
    ++thrown_away_;
    ++statistics_.late;
    return false;
  }
  send(question);
  ++statistics_.questions;
  question_ = question;
  pending_ = true;
  sent_ns_ = last_line_ns_;
  return true;
}

std::optional<Instron8800Link::Answer> Instron8800Link::finish(std::int64_t until_ns) {
  const std::int64_t in_time_ns = sent_ns_ + config_.response_timeout_ms * kMs;
  std::optional<LineStream::Line> line;
  try {
    line = stream_.read_line(std::min(until_ns, in_time_ns));
  } catch (const DeviceError&) {
    doubt();
    throw;
  }
  if (line && line->received_ns <= in_time_ns) {
    pending_ = false;
    note_line(*line);
    return Answer{line->text, sent_ns_, line->received_ns};
  }
  if (!line && clock_.now_ns() < in_time_ns) return std::nullopt;
  doubt();
  std::string how = " has no answer within " + std::to_string(config_.response_timeout_ms) + " ms";
  if (line) {
    note_line(*line);
    ++thrown_away_;
    ++statistics_.late;
    how = " was answered after " + std::to_string((line->received_ns - sent_ns_) / kMs) +
          " ms; the answer was thrown away";
  }
  throw DeviceError(Fault::kTimeout, at() + question_ + how);
}

// ---- in step
// --------------------------------------------------------------------------------------------------

std::string Instron8800Link::check_question() const {
  return "Q307," + std::to_string(check_ == 0 ? config_.position_channel : config_.force_channel);
}

bool Instron8800Link::passes_check(std::string_view answer) noexcept {
  const bool right = type_in(answer) == kTypes[static_cast<std::size_t>(check_)];
  check_ = 1 - check_;
  if (right) told_.clear();
  return right;
}

void Instron8800Link::ask_type(int which) {
  check_ = which;
  send(check_question());
  ++statistics_.questions;
}

void Instron8800Link::complain() {
  const std::int64_t now_ns = clock_.now_ns();
  next_complaint_ns_ = now_ns + config_.response_timeout_ms * kMs;
  const std::string since = std::to_string((now_ns - std::max(doubt_ns_, last_heard_ns_)) / kMs) + " ms";
  if (wrong_type_) {
    throw DeviceError(Fault::kIdentity, at() + check_question() + " has to be answered by \"0," +
                                            std::string(kTypes[static_cast<std::size_t>(check_)]) + "\" and got " +
                                            in_quotes(last_thrown_) +
                                            "; is it this channel, and does nobody else talk to it?");
  }
  if (thrown_away_ >= kNoise) {
    throw DeviceError(Fault::kProtocol, at() + "lines keep coming that nobody asked for, the last " +
                                            in_quotes(last_thrown_) +
                                            "; somebody else talks to the controller, or the line is noisy");
  }
  if (!last_thrown_.empty()) {
    throw DeviceError(Fault::kTimeout, at() + check_question() + " has to be answered by \"0," +
                                           std::string(kTypes[static_cast<std::size_t>(check_)]) + "\" and got " +
                                           in_quotes(last_thrown_) + suspects());
  }
  throw DeviceError(Fault::kTimeout, at() + "nothing comes since " + since + ", asked for the channel's type (" +
                                         check_question() + "); is the controller on, and the cable in?");
}

bool Instron8800Link::recover(std::int64_t until_ns) {
  if (!in_doubt_) return true;
  const auto throw_away = [&](const LineStream::Line& line) {
    note_line(line);
    ++thrown_away_;
    ++statistics_.late;
    last_thrown_ = line.text;
  };
  const auto settle = [&](Phase phase) {
    phase_ = phase;
    quiet_from_ns_ = clock_.now_ns();
  };
  const auto probe = [&](Phase phase) {
    phase_ = phase;
    ask_type(phase == Phase::kFirst ? 0 : 1);
    probe_interval_ns_ = 2 * config_.response_timeout_ms * kMs;
    next_probe_ns_ = clock_.now_ns() + probe_interval_ns_;
  };
  for (;;) {
    const bool settling = phase_ == Phase::kSettle || phase_ == Phase::kSettled;
    const std::int64_t quiet_ns = quiet_from_ns_ + config_.quiet_ms * kMs;
    if (const auto line =
            stream_.read_line(std::min({until_ns, next_complaint_ns_, settling ? quiet_ns : next_probe_ns_}))) {
      const bool expected = !settling && type_in(line->text) == kTypes[static_cast<std::size_t>(check_)];
      if (expected) {
        note_line(*line);
        if (phase_ == Phase::kFirst) {
          probe(Phase::kSecond);
        } else {
          settle(Phase::kSettled);
        }
      } else {
        throw_away(*line);
        const auto type = type_in(line->text);
        // The other channel's is the answer of a check that was sent again.
        wrong_type_ = !settling && !type.empty() && type != kTypes[0] && type != kTypes[1] && type.size() == 1;
        if (settling) settle(Phase::kSettle);
      }
    } else if (settling && clock_.now_ns() >= quiet_ns) {
      stream_.discard_input();  // half a line
      if (phase_ == Phase::kSettled) {
        in_doubt_ = false;
        if (clock_.now_ns() - doubt_ns_ > kSilence_ns) last_silence_ns_ = clock_.now_ns();
        check_ = 0;
        told_.clear();
        ++statistics_.resyncs;
        return true;
      }
      probe(Phase::kFirst);
    } else if (!settling && clock_.now_ns() >= next_probe_ns_) {
      ask_type(check_);
      probe_interval_ns_ *= 2;
      next_probe_ns_ = clock_.now_ns() + probe_interval_ns_;
    }
    const std::int64_t now_ns = clock_.now_ns();
    if (now_ns - std::max(doubt_ns_, last_heard_ns_) > config_.give_up_ms * kMs) {
      close();
      throw DeviceError(Fault::kDisconnected, at() + "no line since " +
                                                  std::to_string((now_ns - last_heard_ns_) / kMs) +
                                                  " ms; the controller hangs, its watchdog stops the actuator");
    }
    if (now_ns >= next_complaint_ns_) complain();
    if (now_ns >= until_ns) return false;
  }
}

void Instron8800Link::get_in_step(std::int64_t until_ns) {
  if (pending_) {  // in order: its answer comes before any other
    while (!finish(until_ns)) {
      if (clock_.now_ns() >= until_ns) break;
    }
    if (pending_) doubt();
  }
  if (recover(until_ns)) return;
  next_complaint_ns_ = 0;
  complain();
}

Instron8800Link::Answer Instron8800Link::ask_one(std::string_view question, std::int64_t until_ns) {
  get_in_step(until_ns);
  if (!begin(question)) {
    get_in_step(until_ns);
    if (!begin(question)) throw DeviceError(Fault::kProtocol, at() + "lines keep coming that nobody asked for");
  }
  for (;;) {
    if (auto answer = finish(until_ns)) return *answer;
    if (clock_.now_ns() < until_ns) continue;
    doubt();
    throw DeviceError(Fault::kTimeout,
                      at() + std::string(question) + " is not answered in the time that is left for it");
  }
}

std::vector<Instron8800Link::Answer> Instron8800Link::ask(std::initializer_list<std::string_view> questions,
                                                          std::int64_t until_ns) {
  std::string last;
  for (int attempt = 0; attempt < 2; ++attempt) {
    try {
      std::vector<Answer> answers;
      get_in_step(until_ns);
      const auto resyncs = statistics_.resyncs;
      for (const auto question : questions) answers.push_back(ask_one(question, until_ns));
      const auto answer = ask_one(check_question(), until_ns);
      // Answers from before the line was in doubt may be of other questions.
      if (passes_check(answer.text) && statistics_.resyncs == resyncs) return answers;
      last = answer.text;
      doubt();
    } catch (const DeviceError& error) {
      const bool again = attempt == 0 && is_open() && clock_.now_ns() < until_ns;
      if (!again || (error.fault() != Fault::kTimeout && error.fault() != Fault::kProtocol)) throw;
    }
  }
  throw DeviceError(Fault::kProtocol, at() + "answers are out of step: the check after " +
                                          std::string(*questions.begin()) + " was answered by " + in_quotes(last) +
                                          suspects());
}

}  // namespace isorig::frame
