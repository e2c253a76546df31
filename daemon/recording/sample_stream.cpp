#include "daemon/recording/sample_stream.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <type_traits>

namespace isorig::daemon::samples {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie in memory");
constexpr std::size_t kLengthBytes = 4;

template <typename Number>
void put(std::string& out, Number value) {
  static_assert(std::is_arithmetic_v<Number> || std::is_enum_v<Number>);
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

void put_text(std::string& out, std::string_view text) {
  put(out, static_cast<std::uint16_t>(text.size()));
  out.append(text);
}

template <std::size_t size>
std::string_view text_of(const char (&field)[size]) {
  return {field, ::strnlen(field, size)};
}

/// Writes the record's length when its body is whole.
class Framed {
 public:
  Framed(std::string& out, Kind kind) : out_(out), begin_(out.size()) {
    put(out_, std::uint32_t{0});
    put(out_, kind);
  }
  ~Framed() {
    const auto length = static_cast<std::uint32_t>(out_.size() - begin_ - kLengthBytes);
    std::memcpy(out_.data() + begin_, &length, sizeof length);
  }
  Framed(const Framed&) = delete;
  Framed& operator=(const Framed&) = delete;

 private:
  std::string& out_;
  std::size_t begin_;
};

/// Takes numbers off the front of a body; one that is too short throws. What is behind what we know is a later
/// version's, and is left alone.
class Body {
 public:
  explicit Body(std::string_view rest) : rest_(rest) {}

  template <typename Number>
  void take(Number& value) {
    need(sizeof value);
    std::memcpy(&value, rest_.data(), sizeof value);
    rest_.remove_prefix(sizeof value);
  }
  std::string_view take_text() {
    std::uint16_t length = 0;
    take(length);
    need(length);
    const auto text = rest_.substr(0, length);
    rest_.remove_prefix(length);
    return text;
  }
  template <std::size_t size>
  void take_text(char (&field)[size]) {
    const auto text = take_text();
    const auto kept = std::min(text.size(), size - 1);
    std::memcpy(field, text.data(), kept);
    field[kept] = '\0';
  }
  /// An enumerator that we do not know would be taken for whatever its number is here.
  template <typename Enum>
  void take_enum(Enum& value, Enum last) {
    std::uint8_t number = 0;
    take(number);
    if (number > static_cast<std::uint8_t>(last)) {
      throw StreamError("the sample stream has the number " + std::to_string(number) + " where at most " +
                        std::to_string(static_cast<int>(last)) + " means something; are both programs of one version?");
    }
    value = static_cast<Enum>(number);
  }

 private:
  void need(std::size_t bytes) const {
    if (rest_.size() < bytes) throw StreamError("a record of the sample stream is shorter than its kind");
  }
  std::string_view rest_;
};

Hello hello_of(Body body) {
  Hello h;
  body.take(h.version);
  if (h.version != kVersion) {
    throw StreamError("the daemon writes version " + std::to_string(h.version) + " of the sample stream, this reads " +
                      std::to_string(kVersion) + "; install both programs of one version");
  }
  body.take(h.epoch_unix_us);
  h.rig = body.take_text();
  return h;
}

FrameRecord frame_of(Body body) {
  FrameRecord r;
  body.take(r.mono_ns);
  body.take(r.position_mm);
  body.take(r.force_N);
  body.take(r.step);
  body.take(r.sequence);
  body.take(r.bound_ns);
  return r;
}

PressureRecord pressure_of(Body body) {
  PressureRecord r;
  body.take(r.mono_ns);
  body.take(r.pressure_psi);
  body.take(r.step);
  body.take(r.sequence);
  body.take(r.bound_ns);
  body.take(r.temperature_C);
  body.take(r.status);
  return r;
}

ControlRecord control_of(Body body) {
  ControlRecord r;
  body.take(r.mono_ns);
  body.take(r.step);
  body.take_enum(r.state, RunState::kSetup);
  body.take(r.setpoint_psi);
  body.take(r.target_mm);
  body.take(r.velocity_mm_s);
  body.take(r.fill_permille);
  body.take(r.vent_permille);
  body.take(r.ticks);
  body.take(r.overruns);
  body.take(r.worst_wakeup_ns);
  body.take(r.worst_run_ns);
  body.take(r.progress);
  body.take(r.remaining_s);
  return r;
}

EventRecord event_of(Body body) {
  EventRecord r;
  body.take(r.mono_ns);
  body.take(r.step);
  body.take_enum(r.severity, Severity::kSafeState);
  body.take_enum(r.from, RunState::kSetup);
  body.take_enum(r.to, RunState::kSetup);
  body.take(r.value);
  body.take(r.threshold);
  body.take_text(r.code);
  body.take_text(r.text);
  return r;
}

Lost lost_of(Body body) {
  Lost l;
  body.take(l.frame);
  body.take(l.pressure);
  body.take(l.control);
  body.take(l.events);
  body.take(l.before_the_socket);
  return l;
}

}  // namespace

void append(std::string& out, const Hello& hello) {
  const Framed framed(out, Kind::kHello);
  put(out, hello.version);
  put(out, hello.epoch_unix_us);
  put_text(out, std::string_view(hello.rig).substr(0, kMaxRecordBytes / 2));
}

void append(std::string& out, const FrameRecord& r) {
  const Framed framed(out, Kind::kFrame);
  put(out, r.mono_ns);
  put(out, r.position_mm);
  put(out, r.force_N);
  put(out, r.step);
  put(out, r.sequence);
  put(out, r.bound_ns);
}

void append(std::string& out, const PressureRecord& r) {
  const Framed framed(out, Kind::kPressure);
  put(out, r.mono_ns);
  put(out, r.pressure_psi);
  put(out, r.step);
  put(out, r.sequence);
  put(out, r.bound_ns);
  put(out, r.temperature_C);
  put(out, r.status);
}

void append(std::string& out, const ControlRecord& r) {
  const Framed framed(out, Kind::kControl);
  put(out, r.mono_ns);
  put(out, r.step);
  put(out, r.state);
  put(out, r.setpoint_psi);
  put(out, r.target_mm);
  put(out, r.velocity_mm_s);
  put(out, r.fill_permille);
  put(out, r.vent_permille);
  put(out, r.ticks);
  put(out, r.overruns);
  put(out, r.worst_wakeup_ns);
  put(out, r.worst_run_ns);
  put(out, r.progress);
  put(out, r.remaining_s);
}

void append(std::string& out, const EventRecord& r) {
  const Framed framed(out, Kind::kEvent);
  put(out, r.mono_ns);
  put(out, r.step);
  put(out, r.severity);
  put(out, r.from);
  put(out, r.to);
  put(out, r.value);
  put(out, r.threshold);
  put_text(out, text_of(r.code));
  put_text(out, text_of(r.text));
}

void append(std::string& out, const Lost& l) {
  const Framed framed(out, Kind::kLost);
  put(out, l.frame);
  put(out, l.pressure);
  put(out, l.control);
  put(out, l.events);
  put(out, l.before_the_socket);
}

void Reader::feed(std::string_view bytes) {
  buffer_.erase(0, at_);
  at_ = 0;
  buffer_.append(bytes);
}

bool Reader::next(Record& record) {
  for (;;) {
    const auto rest = std::string_view(buffer_).substr(at_);
    std::uint32_t length = 0;
    if (rest.size() < kLengthBytes) return false;
    std::memcpy(&length, rest.data(), sizeof length);
    if (length < 1 || length > kMaxRecordBytes - kLengthBytes) {
      throw StreamError("a record of the sample stream says that it has " + std::to_string(length) +
                        " bytes; is this the socket that ends in .samples?");
    }
    if (rest.size() < kLengthBytes + length) return false;
    at_ += kLengthBytes + length;
    const auto kind = static_cast<Kind>(rest[kLengthBytes]);
    const Body body(rest.substr(kLengthBytes + 1, length - 1));
    if (!greeted_ && kind != Kind::kHello) throw StreamError("the sample stream does not begin with its version");
    switch (kind) {
      case Kind::kHello:
        greeted_ = true;
        return record = hello_of(body), true;
      case Kind::kFrame:
        return record = frame_of(body), true;
      case Kind::kPressure:
        return record = pressure_of(body), true;
      case Kind::kControl:
        return record = control_of(body), true;
      case Kind::kEvent:
        return record = event_of(body), true;
      case Kind::kLost:
        return record = lost_of(body), true;
    }
  }
}

}  // namespace isorig::daemon::samples
