#include "messages/run_log.hpp"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <utility>

namespace isorig::messages {
namespace {

/// A whole event may still hold nonsense; generated decoders then return -1, or throw on a length that is
/// negative or absurd.
template <typename Message>
bool decode(const LogEvent& event, Message& message) {
  try {
    return message.decode(event.data.data(), 0, static_cast<int>(event.data.size())) ==
           static_cast<int>(event.data.size());
  } catch (const std::exception&) {
    return false;
  }
}

std::optional<Channel> channel_of(std::string_view name) {
  const auto found = std::find(kChannelNames.begin(), kChannelNames.end(), name);
  if (found == kChannelNames.end()) return {};
  return static_cast<Channel>(found - kChannelNames.begin());
}

class Dispatch {
 public:
  Dispatch(RunVisitor& visitor, ReadReport& report) : visitor_(visitor), report_(report) {}

  void take(const LogEvent& event) {
    const auto channel = channel_of(event.channel);
    if (!channel) {
      ++report_.foreign;
      return;
    }
    switch (*channel) {
      case Channel::kHeader:
        return header(event);
      case Channel::kSession:
        return pass(event, *channel, session_, &RunVisitor::session);
      case Channel::kFrame:
        return pass(event, *channel, frame_, &RunVisitor::frame);
      case Channel::kPressure:
        return pass(event, *channel, pressure_, &RunVisitor::pressure);
      case Channel::kFrameAverage:
        return pass(event, *channel, frame_average_, &RunVisitor::frame_average);
      case Channel::kPressureAverage:
        return pass(event, *channel, pressure_average_, &RunVisitor::pressure_average);
      case Channel::kState:
        return pass(event, *channel, control_, &RunVisitor::control);
      case Channel::kEvent:
        return pass(event, *channel, event_, &RunVisitor::event);
      case Channel::kClock:
        return pass(event, *channel, exchanges_, &RunVisitor::exchanges);
      case Channel::kSync:
        return pass(event, *channel, sync_, &RunVisitor::sync);
      case Channel::kProgress:
        return;
    }
  }

 private:
  void header(const LogEvent& event) {
    isorig_msgs::run_header_t h;
    if (!decode(event, h) || h.format != kLogFormat) {
      ++report_.undecodable;
      return;
    }
    if (std::exchange(attempt_, h.attempt) != h.attempt) gaps_ = {};  // numbers begin again
    visitor_.header(h);
  }

  template <typename Message>
  void pass(const LogEvent& event, Channel channel, Message& message,
            void (RunVisitor::*to)(const Message&)) {
    if (!decode(event, message)) {
      ++report_.undecodable;
      return;
    }
    const auto i = static_cast<std::size_t>(channel);
    report_.missing[i] += gaps_[i].next(message.number);
    (visitor_.*to)(message);
  }

  RunVisitor& visitor_;
  ReadReport& report_;
  std::array<GapCounter, kChannels> gaps_{};
  std::int32_t attempt_ = 0;
  // Kept, so that their vectors are allocated once.
  isorig_msgs::session_mark_t session_;
  isorig_msgs::frame_batch_t frame_;
  isorig_msgs::pressure_batch_t pressure_;
  isorig_msgs::frame_average_batch_t frame_average_;
  isorig_msgs::pressure_average_batch_t pressure_average_;
  isorig_msgs::control_batch_t control_;
  isorig_msgs::event_t event_;
  isorig_msgs::exchange_batch_t exchanges_;
  isorig_msgs::sync_check_t sync_;
};

}  // namespace

std::string segment_name(int number) {
  char text[32];
  std::snprintf(text, sizeof text, "segment-%04d.lcm", number);
  return text;
}

int segment_number(const std::filesystem::path& segment) {
  const auto name = segment.filename().string();
  constexpr std::string_view before = "segment-";
  constexpr std::string_view after = ".lcm";
  if (!name.starts_with(before) || !name.ends_with(after)) return 0;
  int number = 0;
  const char* end = name.data() + name.size() - after.size();
  const auto [stop, error] = std::from_chars(name.data() + before.size(), end, number);
  return error == std::errc{} && stop == end && number > 0 ? number : 0;
}

std::vector<std::filesystem::path> list_segments(const std::filesystem::path& run_dir) {
  std::vector<std::filesystem::path> found;
  if (!std::filesystem::is_directory(run_dir)) return found;
  for (const auto& entry : std::filesystem::directory_iterator(run_dir)) {
    if (segment_number(entry.path()) > 0) found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end(),
            [](const auto& a, const auto& b) { return segment_number(a) < segment_number(b); });
  return found;
}

std::optional<isorig_msgs::run_header_t> read_header(const std::filesystem::path& segment) {
  LogReader reader(segment);
  const auto event = reader.next();
  isorig_msgs::run_header_t header;
  if (!event || event->channel != name_of(Channel::kHeader) || !decode(*event, header)) return {};
  return header;
}

bool ReadReport::whole() const noexcept {
  return damage.empty() && undecodable == 0 &&
         std::all_of(missing.begin(), missing.end(), [](std::uint64_t n) { return n == 0; });
}

std::vector<std::string> ReadReport::complaints() const {
  std::vector<std::string> lines;
  for (const auto& d : damage) {
    lines.push_back(
        d.file.string() + ": " + std::to_string(d.bytes) + " bytes at " + std::to_string(d.offset) +
        (d.at_end ? " are no whole message: the writer was interrupted" : " are damaged and were skipped"));
  }
  for (std::size_t i = 0; i < kChannels; ++i) {
    if (missing[i] > 0) {
      lines.push_back(std::to_string(missing[i]) + " messages are missing on " +
                      std::string(kChannelNames[i]));
    }
  }
  if (undecodable > 0) {
    lines.push_back(std::to_string(undecodable) +
                    " messages could not be decoded: damaged, or of another version");
  }
  return lines;
}

ReadReport read_run(const std::filesystem::path& run_dir, RunVisitor& visitor) {
  const auto segments = list_segments(run_dir);
  if (segments.empty()) {
    throw std::runtime_error(run_dir.string() +
                             " holds no recording (no segment-0001.lcm); `isorig runs` lists "
                             "what there is");
  }
  ReadReport report;
  Dispatch dispatch(visitor, report);
  for (const auto& path : segments) {
    LogReader reader(path);
    visitor.segment(path);
    while (const auto event = reader.next()) {
      ++report.events;
      dispatch.take(*event);
    }
    ++report.segments;
    report.bytes += reader.size_bytes();
    report.damage.insert(report.damage.end(), reader.damage().begin(), reader.damage().end());
  }
  return report;
}

}  // namespace isorig::messages
