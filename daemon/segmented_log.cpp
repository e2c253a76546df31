#include "daemon/segmented_log.hpp"

#include <algorithm>
#include <stdexcept>
#include <system_error>
#include <utility>
#include <vector>

#include "messages/run_log.hpp"

namespace isorig::daemon {
namespace {

using messages::Channel;

RecorderOptions prepare(RecorderOptions o) {
  if (!o.free_bytes) o.free_bytes = [](const std::filesystem::path& p) { return free_bytes(p); };
  std::filesystem::create_directories(o.run_dir);
  return o;
}

}  // namespace

SegmentedLog::SegmentedLog(RecorderOptions options, const RunInfo& info,
                           std::function<void(isorig_msgs::session_mark_t&)> fill)
    : options_(prepare(std::move(options))),
      fill_(std::move(fill)),
      lock_(options_.run_dir),
      reserve_(options_.run_dir / ".reserve", options_.reserve_bytes),
      last_mono_ns_(info.start_mono_ns) {
  free_bytes_ = options_.free_bytes(options_.run_dir);
  if (free_bytes_ < options_.min_free_bytes) {
    throw std::runtime_error(options_.run_dir.string() + ": " + std::to_string(free_bytes_ >> 20U) +
                             " MB free, a recording asks for " +
                             std::to_string(options_.min_free_bytes >> 20U) +
                             " MB; free some, or record elsewhere");
  }
  std::int32_t attempt = 1;
  const auto earlier = messages::list_segments(options_.run_dir);
  for (const auto& file : earlier) {
    segment_ = messages::segment_number(file);
    if (const auto header = messages::read_header(file)) attempt = std::max(attempt, header->attempt + 1);
  }
  if (earlier.empty()) write_inputs(options_.run_dir, info);
  header_ = make_header(info, options_, attempt);
  reserve_.allocate();
  try {
    open_segment();
  } catch (const std::system_error& e) {
    throw std::runtime_error(e.what());
  }
  log_->sync();
}

void SegmentedLog::append(Channel channel, std::int32_t session, std::int64_t mono_ns,
                          std::span<const std::uint8_t> data) {
  if (session > session_) {
    const bool first = session_ < 0;
    if (!first) {
      end_session(true);
      next_segment();
    }
    session_ = session;
    put_mark(isorig_msgs::session_mark_t::BEGIN, false, mono_ns);
    if (on_session) on_session({true, false, session_, mono_ns, log_->path().filename().string()});
  }
  put(channel, mono_ns, data);
}

void SegmentedLog::end_session(bool complete) {
  if (session_ < 0) return;
  put_mark(isorig_msgs::session_mark_t::END, complete, last_mono_ns_);
  if (on_session) on_session({false, complete, session_, last_mono_ns_, log_->path().filename().string()});
}

void SegmentedLog::sync() {
  log_->sync();
  free_bytes_ = options_.free_bytes(options_.run_dir);
  if (reserve_given_up_ && free_bytes_ > options_.min_free_bytes + options_.reserve_bytes) {
    reserve_given_up_ = !reserve_.allocate();
  }
}

void SegmentedLog::roll_if_large() {
  if (log_->size_bytes() < options_.max_segment_bytes || !next_segment()) return;
  if (session_ >= 0) put_mark(isorig_msgs::session_mark_t::CONTINUE, false, last_mono_ns_);
}

DiskCondition SegmentedLog::condition() const {
  if (closed_lost_ + log_->lost_events() > 0) return DiskCondition::kLost;
  if (!log_->error().empty() || !segment_error_.empty()) return DiskCondition::kFailing;
  if (reserve_given_up_) return DiskCondition::kReserve;
  if (free_bytes_ < options_.min_free_bytes) return DiskCondition::kLow;
  return DiskCondition::kOk;
}

void SegmentedLog::describe(RecorderStatus& status) const {
  status.disk = condition();
  status.error = segment_error_.empty() ? log_->error() : segment_error_;
  status.free_bytes = free_bytes_;
  status.held_bytes = log_->held_bytes();
  status.written_bytes = closed_bytes_ + log_->size_bytes() - log_->held_bytes();
  status.lost_messages = closed_lost_ + log_->lost_events();
  status.session = session_;
  status.segment = log_->path().filename().string();
}

void SegmentedLog::open_segment() {
  messages::LogWriter::Options o;
  o.make_room = [this] {
    reserve_given_up_ = reserve_.release() || reserve_given_up_;
    return reserve_given_up_;
  };
  auto next = std::make_unique<messages::LogWriter>(options_.run_dir / messages::segment_name(segment_ + 1),
                                                    std::move(o));
  ++segment_;
  if (log_) {
    closed_bytes_ += log_->size_bytes();
    closed_lost_ += log_->lost_events();
  }
  log_ = std::move(next);
  sync_directory(options_.run_dir);
  put_message(Channel::kHeader, last_mono_ns_, header_);
}

/// False: stays in the present segment, since the disk does not take what it holds or no file can be made.
bool SegmentedLog::next_segment() {
  if (!log_->sync()) return false;
  try {
    open_segment();
    segment_error_.clear();
    return true;
  } catch (const std::system_error& e) {
    segment_error_ = e.what();
    return false;
  }
}

void SegmentedLog::put(Channel channel, std::int64_t mono_ns, std::span<const std::uint8_t> data) {
  last_mono_ns_ = std::max(last_mono_ns_, mono_ns);
  // The log's own time never runs backwards: an average is written after what made it complete.
  last_utime_us_ = std::max(last_utime_us_, header_.epoch_unix_us + mono_ns / 1000);
  log_->append(name_of(channel), last_utime_us_, data);
}

template <typename Message>
void SegmentedLog::put_message(Channel channel, std::int64_t mono_ns, const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  put(channel, mono_ns, bytes);
}

void SegmentedLog::put_mark(std::int8_t kind, bool complete, std::int64_t mono_ns) {
  isorig_msgs::session_mark_t m{};
  m.number = marks_++;
  m.mono_ns = mono_ns;
  m.kind = kind;
  m.complete = complete ? 1 : 0;
  m.attempt = header_.attempt;
  m.session = header_.sessions[static_cast<std::size_t>(session_)];
  fill_(m);
  put_message(Channel::kSession, mono_ns, m);
}

}  // namespace isorig::daemon
