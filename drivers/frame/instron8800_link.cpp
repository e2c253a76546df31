#include "drivers/frame/instron8800_link.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "drivers/error.hpp"

namespace isorig::frame {
namespace {

using drivers::DeviceError;
using drivers::Fault;

constexpr std::int64_t kMs = 1'000'000;
constexpr int kProbeRounds = 3;
// The second number of Q307.
constexpr std::string_view kPositionType = "3", kForceType = "2";

LineStream::Options stream_options(const Instron8800Config& c) {
  return {c.tcp, c.host, c.port, c.connect_timeout_ms, c.tty, c.baud, c.parity, c.stop_bits, "frame at " + c.where()};
}

std::string in_quotes(std::string_view text) { return "\"" + std::string(text.substr(0, 40)) + "\""; }

}  // namespace

std::vector<double> parse_numbers(std::string_view question, std::string_view answer, std::size_t at_least) {
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
      if (numbers.size() < at_least) break;
      return numbers;
    }
    if (*at++ != ',') break;
  }
  throw DeviceError(Fault::kProtocol, std::string(question) + " was answered by " + in_quotes(answer) + ", which is not " +
                                          (at_least == 1 ? "a number" : std::to_string(at_least) + " numbers"));
}

Instron8800Link::Instron8800Link(const Instron8800Config& config, clock::Clock& clock)
    : config_(config), clock_(clock), stream_(stream_options(config), clock) {}

void Instron8800Link::open() {
  stream_.open();
  pending_ = false;
  in_doubt_ = true;  // an answer to whoever asked before us may be under way
  last_line_ns_ = 0;
}

void Instron8800Link::close() noexcept {
  stream_.close();
  pending_ = false;
}

void Instron8800Link::doubt() noexcept {
  in_doubt_ = true;
  last_doubt_ns_ = clock_.now_ns();
}

void Instron8800Link::wait_for_gap() { clock_.sleep_until_ns(last_line_ns_ + std::int64_t{config_.gap_us} * 1000); }

void Instron8800Link::send(std::string_view line) {
  wait_for_gap();
  last_line_ns_ = clock_.now_ns();
  stream_.write_line(line);
}

void Instron8800Link::tell(std::string_view command) {
  send(command);
  ++statistics_.commands;
}

void Instron8800Link::begin(std::string_view question) {
  if (pending_) throw std::logic_error("a question is out already");
  if (!in_doubt_ && stream_.discard_input()) doubt();  // a line nobody asked for
  if (in_doubt_) get_in_step();
  send(question);
  ++statistics_.questions;
  question_ = question;
  pending_ = true;
  sent_ns_ = last_line_ns_;
  next_complaint_ns_ = sent_ns_ + config_.response_timeout_ms * kMs;
}

std::optional<Instron8800Link::Answer> Instron8800Link::finish(std::int64_t until_ns) {
  std::optional<LineStream::Line> line;
  try {
    line = stream_.read_line(std::min(until_ns, next_complaint_ns_));
  } catch (const DeviceError& error) {
    doubt();
    pending_ = error.fault() != Fault::kDisconnected && error.fault() != Fault::kProtocol;
    throw;
  }
  const std::int64_t now_ns = clock_.now_ns();
  const auto age = [&](std::int64_t ns) { return std::to_string((ns - sent_ns_) / kMs) + " ms"; };
  if (line) {
    pending_ = false;
    last_line_ns_ = line->received_ns;
    if (line->received_ns - sent_ns_ <= config_.response_timeout_ms * kMs) return Answer{line->text, sent_ns_, line->received_ns};
    doubt();
    ++statistics_.late;
    throw DeviceError(Fault::kTimeout, "frame at " + config_.where() + ": " + question_ + " was answered after " +
                                           age(line->received_ns) + "; the answer was thrown away");
  }
  if (now_ns - sent_ns_ > config_.give_up_ms * kMs) {
    doubt();
    close();
    throw DeviceError(Fault::kDisconnected, "frame at " + config_.where() + ": " + question_ + " has no answer since " +
                                                age(now_ns) + "; the controller hangs, its watchdog stops the actuator");
  }
  if (now_ns >= next_complaint_ns_) {
    doubt();
    next_complaint_ns_ = now_ns + config_.response_timeout_ms * kMs;
    throw DeviceError(Fault::kTimeout, "frame at " + config_.where() + ": " + question_ + " has no answer since " +
                                           age(now_ns) + "; nothing else is asked until it comes");
  }
  return std::nullopt;
}

void Instron8800Link::drop_pending() {
  while (pending_) {
    if (finish(clock_.now_ns() + config_.response_timeout_ms * kMs)) return;
  }
}

Instron8800Link::Answer Instron8800Link::ask(std::string_view question) {
  drop_pending();
  begin(question);
  for (;;) {
    if (auto answer = finish(next_complaint_ns_)) return *answer;
  }
}

bool Instron8800Link::line_is_quiet() { return !stream_.read_line(clock_.now_ns() + config_.quiet_ms * kMs).has_value(); }

/// Asks for a channel's type until the answer is one. Others on the way are of questions long ago.
void Instron8800Link::await_type(int channel, std::string_view type) {
  const std::string question = "Q307," + std::to_string(channel);
  send(question);
  ++statistics_.questions;
  question_ = question;
  pending_ = true;
  sent_ns_ = last_line_ns_;
  next_complaint_ns_ = sent_ns_ + config_.response_timeout_ms * kMs;
  std::string last = "nothing";
  for (;;) {
    const auto line = stream_.read_line(next_complaint_ns_);
    if (!line) {
      next_complaint_ns_ = clock_.now_ns() + config_.response_timeout_ms * kMs;
      throw DeviceError(last.find(',') == std::string::npos ? Fault::kTimeout : Fault::kIdentity,
                        "frame at " + config_.where() + ": " + question + " has to be answered by \"0," + std::string(type) +
                            "\" and got " + last + "; is the controller on, is it this channel, and does nobody else talk to it?");
    }
    last_line_ns_ = line->received_ns;
    const auto comma = line->text.find(',');
    if (comma != std::string::npos) {
      auto second = std::string_view(line->text).substr(comma + 1);
      while (!second.empty() && second.front() == ' ') second.remove_prefix(1);
      if (second == type) break;
    }
    last = in_quotes(line->text);
  }
  pending_ = false;
}

void Instron8800Link::get_in_step() {
  ++statistics_.resyncs;
  for (int round = 0; round < kProbeRounds; ++round) {
    stream_.discard_input();
    if (!line_is_quiet()) continue;
    await_type(config_.position_channel, kPositionType);
    await_type(config_.force_channel, kForceType);
    if (!line_is_quiet()) continue;
    in_doubt_ = false;
    return;
  }
  throw DeviceError(Fault::kProtocol, "frame at " + config_.where() +
                                          ": lines keep coming that nobody asked for; somebody else talks to the controller, or "
                                          "the line is noisy");
}

}  // namespace isorig::frame
