#include "messages/run_log.hpp"

#include <algorithm>
#include <exception>
#include <map>
#include <set>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "messages/counted.hpp"
#include "messages/log_event.hpp"
#include "messages/segment_chain.hpp"

namespace isorig::messages {
namespace {

constexpr std::uint64_t kToldBytes = std::uint64_t{1} << 20U;

/// A whole event may still hold nonsense; generated decoders then return -1, or throw on a length that is
/// negative or absurd. Times and counters beyond any clock's are nonsense too.
template <typename Message>
bool decode(const LogEvent& event, Message& message) {
  try {
    const auto used = message.decode(event.data.data(), 0, static_cast<int>(event.data.size()));
    const auto size = static_cast<int>(event.data.size());
    // A log that lcm-logger made of a recording that was played has the recording's checksums behind its messages.
    return (used == size || used + static_cast<int>(kLogChecksumBytes) == size) && is_counted_message(message);
  } catch (const std::exception&) {
    return false;
  }
}

/// The format stands in front of everything else in the header of any version (docs/formats/run-log.md), so that it can
/// be read where the rest cannot; empty where no text stands there.
std::string_view format_of(const LogEvent& header) {
  constexpr std::size_t kLengthAt = 8, kTextAt = 12;  // behind the type's fingerprint; the length counts a final zero
  const auto data = header.data;
  if (data.size() < kTextAt) return {};
  const auto length = big_endian(data.data() + kLengthAt, kTextAt - kLengthAt);
  if (length == 0 || length > data.size() - kTextAt) return {};
  return {reinterpret_cast<const char*>(data.data()) + kTextAt, static_cast<std::size_t>(length - 1)};
}

/// Without a checksum a version that is not known may as well be a damaged one that is.
void refuse_unknown_version(const LogEvent& header, const std::filesystem::path& segment, bool has_checksums) {
  const auto format = format_of(header);
  if (!has_checksums || !format.starts_with(kLogFormatName) || format == kLogFormat || format == kOldLogFormat) return;
  throw UnknownLogVersion(segment, format);
}

std::optional<Channel> channel_of(std::string_view name) {
  const auto found = std::find(kChannelNames.begin(), kChannelNames.end(), name);
  if (found == kChannelNames.end()) return {};
  return static_cast<Channel>(found - kChannelNames.begin());
}

/// Where a recording's segments stand: what the chain says against what is there.
class Reading {
 public:
  Reading(RunVisitor& visitor, bool lone) : visitor_(visitor), lone_(lone) {
    report_.lone_segment = lone;
    begin_numbers();
  }

  /// `read` is told the bytes of this segment that have been read, about once per MiB.
  void segment(const std::filesystem::path& path, const std::function<void(std::uint64_t)>& read) {
    const int number = segment_number(path);
    if (!lone_) {
      if (const int gone = number - number_ - 1; gone > 0) {
        const auto first = segment_name(number_ + 1);
        report_.contradictions.push_back(gone == 1 ? first + " is missing"
                                                   : first + " to " + segment_name(number - 1) + " are missing");
        before_.reset();
      }
    }
    number_ = number;
    file_ = path;
    if (!lone_ && report_.segments == 0) checksums_ = checksums_of_first(path);
    LogReader reader(path, checksums_);
    visitor_.segment(path);
    continues_ = false;
    events_due_ = 0;
    bool jumped = false;
    checked_ = reader.has_checksums();
    if (checked_) checksums_ = Checksums::kAlways;
    std::uint64_t told = 0;
    while (const auto event = reader.next()) {
      if (read && reader.read_bytes() >= told + kToldBytes) read(told = reader.read_bytes());
      ++report_.events;
      jumped = jumped || (checked_ && event->number != events_due_);
      events_due_ = is_counted(event->number) ? event->number + 1 : 0;
      dispatch(*event);
    }
    ++report_.segments;
    report_.bytes += reader.size_bytes();
    // What holds no whole message does not show whether it has any.
    report_.has_checksums = report_.has_checksums && (checked_ || reader.tally().events == 0);
    settle_torn();
    const bool altered =
        std::any_of(reader.damage().begin(), reader.damage().end(), [](const auto& d) { return !d.at_end; });
    // Behind the message that closes a segment nothing was written any more.
    const bool closed = checked_ && (continues_ || ended_);
    for (auto d : reader.damage()) {
      d.at_end = d.at_end && (d.begun || !closed);
      (d.at_end ? torn_ : report_.damage).push_back(d);
    }
    if (reader.size_bytes() == 0) torn_.push_back({path, 0, 0, true, false});
    if (jumped && !altered) {
      report_.contradictions.push_back(path.filename().string() + " has lost messages inside, or its first ones");
    }
    before_ = SegmentBefore{path, reader.tally(), altered || jumped};
  }

  ReadReport finish() {
    settle_torn();
    settle_attempt();
    if (!lone_ && continues_) {
      report_.contradictions.push_back(segment_name(number_ + 1) + " is missing, in which the recording goes on");
    }
    report_.sessions_planned = sessions_.size();
    if (!lone_) {
      for (const auto& [index, s] : sessions_) {
        if (complete_.contains(index)) continue;
        report_.unfinished.push_back(base::formatted("repetition %d at %g psi", s.repetition, s.pressure_psi));
      }
    }
    report_.ended = ended_;
    return std::move(report_);
  }

 private:
  /// A torn end belongs to the last segment, or to one whose successor counted what was whole in it.
  void settle_torn() {
    report_.damage.insert(report_.damage.end(), torn_.begin(), torn_.end());
    torn_.clear();
  }

  void dispatch(const LogEvent& event) {
    const auto channel = channel_of(event.channel);
    if (!channel) {
      ++report_.foreign;
      return;
    }
    if (*channel != Channel::kHeader && *channel != Channel::kChain) {
      ++seen_[static_cast<std::size_t>(*channel)];
      continues_ = false;
      if (checked_ && std::exchange(ended_, false)) {
        report_.contradictions.push_back(file_.filename().string() + " goes on behind the recording's end");
      }
    }
    switch (*channel) {
      case Channel::kHeader:
        return header(event);
      case Channel::kChain:
        return chain(event);
      case Channel::kSession:
        return pass(event, *channel, session_, &Reading::session);
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

  void header(const LogEvent& event) {
    refuse_unknown_version(event, file_, checked_);
    isorig_msgs::run_header_t h;
    if (!decode(event, h) || (h.format != kLogFormat && h.format != kOldLogFormat)) {
      ++report_.undecodable;
      return;
    }
    report_.has_header = true;
    attempt(h.attempt);
    ++seen_[static_cast<std::size_t>(Channel::kHeader)];
    for (const auto& s : h.sessions) sessions_[s.session] = s;
    visitor_.header(h);
  }

  /// Numbers begin again with each attempt.
  void attempt(std::int32_t number) {
    if (number == attempt_) return;
    if (attempt_ != 0) {
      settle_attempt();
      if (!ended_)
        report_.notes.push_back("attempt " + std::to_string(attempt_) + " was interrupted; a further one followed");
    }
    if (!lone_ && number != attempt_ + 1) {
      report_.contradictions.push_back(file_.filename().string() + " belongs to attempt " + std::to_string(number) +
                                       ", and attempt " + std::to_string(attempt_) + " is before it");
    }
    attempt_ = number;
    ended_ = false;
  }

  void chain(const LogEvent& event) {
    isorig_msgs::chain_t m;
    if (!decode(event, m)) {
      ++report_.undecodable;
      return;
    }
    attempt(m.attempt);
    ++seen_[static_cast<std::size_t>(Channel::kChain)];
    numbers_[static_cast<std::size_t>(Channel::kChain)].take(m.number);
    if (m.kind == isorig_msgs::chain_t::BEGINS) {
      ended_ = false;
      begins(m);
    } else if (m.kind == isorig_msgs::chain_t::CONTINUES) {
      continues_ = true;
    } else {
      ends(m);
    }
  }

  void begins(const isorig_msgs::chain_t& m) {
    const auto name = file_.filename().string();
    if (!lone_ && m.segment != number_) {
      report_.contradictions.push_back(name + " was written as " + segment_name(m.segment));
    }
    if (lone_ || !before_) return;
    compare_with_before(m, *before_, name, torn_, report_);
  }

  void ends(const isorig_msgs::chain_t& m) {
    ended_ = true;
    end_ = m;
    if (lone_) return;
    for (std::size_t k = 0; k < m.channels.size() && k < m.messages.size(); ++k) {
      const auto channel = channel_of(m.channels[k]);
      if (!channel) continue;
      const auto i = static_cast<std::size_t>(*channel);
      const auto due = static_cast<std::uint64_t>(std::max<std::int64_t>(0, m.messages[k]));
      short_[i] = due > seen_[i] ? due - seen_[i] : 0;
    }
  }

  void session(const isorig_msgs::session_mark_t& m) {
    if (m.kind == isorig_msgs::session_mark_t::END) {
      if (m.complete != 0) complete_.insert(m.session.session);
      if (!checked_) ended_ = true;  // before format 2 nothing else says so
    } else if (!checked_) {
      ended_ = false;
    }
    visitor_.session(m);
  }

  void begin_numbers() {
    numbers_ = {};
    seen_ = {};
    short_ = {};
    if (lone_) {
      for (auto& n : numbers_) n.begin_anywhere();
    }
  }

  void settle_attempt() {
    report_.dropped_records += static_cast<std::uint64_t>(std::max<std::int64_t>(0, end_.dropped_records));
    report_.lost_messages += static_cast<std::uint64_t>(std::max<std::int64_t>(0, end_.lost_messages));
    if (!end_.fault.empty()) report_.faults.push_back(end_.fault);
    end_ = {};
    for (std::size_t i = 0; i < kChannels; ++i) {
      report_.missing[i] += std::max(numbers_[i].missing(), short_[i]);
      report_.repeated += numbers_[i].repeated();
    }
    begin_numbers();
  }

  template <typename Message, typename Target>
  void pass(const LogEvent& event, Channel channel, Message& message, void (Target::*to)(const Message&)) {
    if (!decode(event, message)) {
      ++report_.undecodable;
      return;
    }
    if (!numbers_[static_cast<std::size_t>(channel)].take(message.number)) return;
    if constexpr (std::is_same_v<Target, Reading>) {
      (this->*to)(message);
    } else {
      (visitor_.*to)(message);
    }
  }

  RunVisitor& visitor_;
  const bool lone_;
  ReadReport report_;
  std::filesystem::path file_;
  int number_ = 0;
  bool checked_ = false;  // the present segment has checksums
  Checksums checksums_ = Checksums::kAsFound;
  bool continues_ = false;  // the present segment was closed, the recording goes on in the next
  std::int64_t events_due_ = 0;
  std::optional<SegmentBefore> before_;
  std::vector<LogDamage> torn_;
  std::int32_t attempt_ = 0;
  bool ended_ = false;
  isorig_msgs::chain_t end_{};  // of this attempt
  std::array<NumberCheck, kChannels> numbers_{};
  std::array<std::uint64_t, kChannels> seen_{};
  std::array<std::uint64_t, kChannels> short_{};
  std::map<std::int32_t, isorig_msgs::session_t> sessions_;
  std::set<std::int32_t> complete_;
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

UnknownLogVersion::UnknownLogVersion(const std::filesystem::path& segment, std::string_view format)
    : std::runtime_error(segment.string() + ": format \"" + base::printable(format) +
                         "\", this program reads 1 and 2; read it with the isorig that recorded it, or a newer one") {}

Checksums checksums_of_first(const std::filesystem::path& segment) {
  LogReader reader(segment);
  if (reader.has_checksums() || reader.size_bytes() == 0) return Checksums::kAsFound;
  const auto first = reader.next();
  // The format lies within 512 bytes of the sync word: a sector has both or neither.
  const bool header = first && reader.damage().empty() && first->channel == name_of(Channel::kHeader);
  const auto format = header ? format_of(*first) : std::string_view();
  return format.empty() || format == kLogFormat ? Checksums::kAlways : Checksums::kAsFound;
}

Checksums checksums_behind(const std::filesystem::path& segment, Checksums its) {
  return LogReader(segment, its).has_checksums() ? Checksums::kAlways : Checksums::kAsFound;
}

std::optional<isorig_msgs::run_header_t> read_header(const std::filesystem::path& segment, Checksums checksums) {
  LogReader reader(segment, checksums);
  const auto event = reader.next();
  isorig_msgs::run_header_t header;
  if (!event || event->channel != name_of(Channel::kHeader)) return {};
  refuse_unknown_version(*event, segment, reader.has_checksums());
  if (!decode(*event, header)) return {};
  return header;
}

ReadReport read_run(const std::filesystem::path& run_dir, RunVisitor& visitor,
                    const std::function<void(double)>& on_progress) {
  const auto segments = list_segments(run_dir);
  if (segments.empty()) {
    throw std::runtime_error(run_dir.string() +
                             " holds no recording (no segment-0001.lcm); `isorig runs` lists "
                             "what there is");
  }
  Reading reading(visitor, std::filesystem::is_regular_file(run_dir));
  const auto size_of = [](const std::filesystem::path& path) {
    std::error_code gone;
    const auto size = std::filesystem::file_size(path, gone);
    return gone ? 0.0 : static_cast<double>(size);
  };
  double all = 0.0, before = 0.0;
  for (const auto& path : segments) all += size_of(path);
  std::function<void(std::uint64_t)> read;
  if (on_progress && all > 0.0) {
    read = [&](std::uint64_t bytes) { on_progress(std::min(1.0, (before + static_cast<double>(bytes)) / all)); };
  }
  for (const auto& path : segments) {
    if (read) read(0);
    reading.segment(path, read);
    before += size_of(path);
  }
  if (on_progress) on_progress(1.0);
  return reading.finish();
}

}  // namespace isorig::messages
