#include "daemon/recording/segmented_log.hpp"

#include <algorithm>
#include <exception>
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

/// The segments of earlier attempts. A power cut between a segment's name and the message before it that names it
/// leaves an empty file behind a torn one. The new segment takes its place, so that it follows the torn one and states
/// how that ended: behind an empty file nothing would, and the torn end would count as a loss for ever.
std::vector<std::filesystem::path> earlier_segments(const std::filesystem::path& run_dir) {
  auto found = messages::list_segments(run_dir);
  while (found.size() > 1 && std::filesystem::is_empty(found.back())) {
    std::filesystem::remove(found.back());
    found.pop_back();
  }
  return found;
}

}  // namespace

SegmentedLog::SegmentedLog(RecorderOptions options, const RunInfo& info,
                           std::function<void(isorig_msgs::session_mark_t&)> fill)
    : options_(prepare(std::move(options))),
      fill_(std::move(fill)),
      lock_(options_.run_dir),
      reserve_(options_.run_dir / kReserveName, options_.reserve_bytes),
      last_mono_ns_(info.start_mono_ns) {
  free_bytes_ = options_.free_bytes(options_.run_dir);
  if (free_bytes_ < options_.min_free_bytes) {
    throw std::runtime_error(options_.run_dir.string() + ": " + std::to_string(free_bytes_ >> 20U) +
                             " MB free, a recording asks for " + std::to_string(options_.min_free_bytes >> 20U) +
                             " MB; free some, or record elsewhere");
  }
  std::int32_t attempt = 1;
  const auto earlier = earlier_segments(options_.run_dir);
  auto of_last = messages::Checksums::kAsFound;
  auto checksums = earlier.empty() ? of_last : messages::checksums_of_first(earlier.front());
  for (const auto& file : earlier) {
    segment_ = messages::segment_number(file);
    if (const auto header = messages::read_header(file, checksums)) attempt = std::max(attempt, header->attempt + 1);
    of_last = std::exchange(checksums, messages::checksums_behind(file, checksums));
  }
  if (!earlier.empty()) {
    before_ = messages::tally_of(earlier.back(), of_last);
    before_path_ = earlier.back();
  }
  if (earlier.empty()) write_inputs(options_.run_dir, info);
  header_ = make_header(info, options_, attempt);
  reserve_.allocate();
  try {
    begin_segment(create_segment());
  } catch (const std::system_error& e) {
    throw std::runtime_error(e.what());
  }
  if (!log_->sync()) throw std::runtime_error(log_->error() + ": the recording cannot be begun");
  sync_directory(options_.run_dir);
  sync_directory(options_.run_dir.parent_path());
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
    session_lossless_ = true;
    put_mark(isorig_msgs::session_mark_t::BEGIN, false, mono_ns);
    changes_.push_back({{true, false, session_, mono_ns, log_->path().filename().string()}, true});
  }
  put(channel, mono_ns, data);
}

void SegmentedLog::end_session(bool complete) {
  if (session_ < 0) return;
  const bool whole = complete && session_lossless_ && closed_lost_ + log_->lost_events() == 0;
  put_mark(isorig_msgs::session_mark_t::END, whole, last_mono_ns_);
  changes_.push_back({{false, whole, session_, last_mono_ns_, log_->path().filename().string()}, false});
}

void SegmentedLog::end_attempt(bool complete, std::uint64_t dropped_records) {
  ended_ = true;
  ended_complete_ = complete;
  dropped_records_ = dropped_records;
  put_chain(isorig_msgs::chain_t::ENDS, log_->tally());
}

void SegmentedLog::sync() {
  if (!log_->sync() && log_->condemned() && leave_condemned()) log_->sync();
  if (synced()) {
    for (auto& c : changes_) c.on_disk = true;
  }
  look_at_space();
}

void SegmentedLog::tell_sessions() {
  while (!changes_.empty() && changes_.front().on_disk) {
    try {
      if (on_session) on_session(changes_.front().change);
    } catch (const std::exception& e) {
      catalogue_error_ = e.what();
      return;
    }
    changes_.pop_front();
  }
  catalogue_error_.clear();
}

void SegmentedLog::look_at_space() {
  try {
    free_bytes_ = options_.free_bytes(options_.run_dir);
    space_error_.clear();
  } catch (const std::exception& e) {
    space_error_ = e.what();
    return;
  }
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
  if (!fault_.empty()) return DiskCondition::kUnvouched;
  if (!log_->error().empty() || !segment_error_.empty() || !space_error_.empty()) return DiskCondition::kFailing;
  if (reserve_given_up_) return DiskCondition::kReserve;
  if (free_bytes_ < options_.min_free_bytes) return DiskCondition::kLow;
  return DiskCondition::kOk;
}

void SegmentedLog::describe(RecorderStatus& status) const {
  status.disk = condition();
  status.error = !segment_error_.empty() ? segment_error_ : !log_->error().empty() ? log_->error() : space_error_;
  status.catalogue_error = catalogue_error_;
  status.fault = fault_;
  status.free_bytes = free_bytes_;
  status.held_bytes = log_->held_bytes();
  status.written_bytes = closed_bytes_ + log_->size_bytes() - log_->held_bytes();
  status.lost_messages = closed_lost_ + log_->lost_events();
  status.session = session_;
  status.segment = log_->path().filename().string();
}

std::unique_ptr<messages::LogWriter> SegmentedLog::create_segment() {
  messages::LogWriter::Options o;
  o.make_room = [this] {
    reserve_given_up_ = reserve_.release() || reserve_given_up_;
    return reserve_given_up_;
  };
  return std::make_unique<messages::LogWriter>(options_.run_dir / messages::segment_name(segment_ + 1), std::move(o));
}

void SegmentedLog::begin_segment(std::unique_ptr<messages::LogWriter> next) {
  if (log_) {
    before_ = log_->written_tally();
    before_path_ = log_->path();
    closed_bytes_ += log_->size_bytes() - log_->held_bytes();
    closed_lost_ += log_->lost_events();
  }
  auto old = std::exchange(log_, std::move(next));
  ++segment_;
  segment_error_.clear();
  sync_directory(options_.run_dir);
  put_message(Channel::kHeader, last_mono_ns_, header_);
  put_chain(isorig_msgs::chain_t::BEGINS, before_);
  if (!old) return;
  old->hand_over([this](std::string_view channel, std::int64_t utime_us, std::span<const std::uint8_t> data) {
    log_->append(channel, utime_us, data);
  });
}

/// False: stays in the present segment, since the disk does not take what it holds or no file can be made.
bool SegmentedLog::next_segment() {
  if (!log_->sync()) return log_->condemned() && leave_condemned();
  try {
    // Made, its name on the disk, before the present one says that there is a next: a writer killed in between, or a
    // power cut, leaves an empty segment, not one that seems to have been removed.
    auto next = create_segment();
    sync_directory(options_.run_dir);
    put_chain(isorig_msgs::chain_t::CONTINUES, log_->tally());
    if (!log_->sync() && !log_->condemned()) {
      std::error_code ignored;
      std::filesystem::remove(next->path(), ignored);
      return false;
    }
    if (log_->condemned()) note_condemned();
    for (auto& c : changes_) c.on_disk = c.on_disk || !log_->condemned();
    begin_segment(std::move(next));
    return true;
  } catch (const std::system_error& e) {
    segment_error_ = e.what();
    return false;
  }
}

void SegmentedLog::note_condemned() {
  if (fault_.empty()) {
    fault_ = log_->error() + "; of what was written there, all behind byte " + std::to_string(log_->synced_bytes()) +
             " may not be on the disk";
  }
  session_lossless_ = false;
  for (auto& c : changes_) c.change.complete = c.change.complete && c.on_disk;
}

/// Goes on in a new segment, with what the condemned one still held. False when none can be made yet.
bool SegmentedLog::leave_condemned() {
  note_condemned();
  try {
    begin_segment(create_segment());
  } catch (const std::system_error& e) {
    segment_error_ = e.what();
    return false;
  }
  if (ended_) {
    put_chain(isorig_msgs::chain_t::ENDS, log_->tally());
  } else if (session_ >= 0) {
    put_mark(isorig_msgs::session_mark_t::CONTINUE, false, last_mono_ns_);
  }
  return true;
}

void SegmentedLog::put(Channel channel, std::int64_t mono_ns, std::span<const std::uint8_t> data) {
  last_mono_ns_ = std::max(last_mono_ns_, mono_ns);
  // The log's own time never runs backwards: an average is written after what made it complete.
  last_utime_us_ = std::max(last_utime_us_, header_.epoch_unix_us + mono_ns / 1000);
  if (log_->append(name_of(channel), last_utime_us_, data)) ++written_[static_cast<std::size_t>(channel)];
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

void SegmentedLog::put_chain(std::int8_t kind, const messages::LogTally& tally) {
  isorig_msgs::chain_t m{};
  m.number = chain_++;
  m.mono_ns = last_mono_ns_;
  m.kind = kind;
  m.attempt = header_.attempt;
  m.segment = segment_;
  m.events = tally.events;
  m.bytes = tally.bytes;
  m.checksum = static_cast<std::int32_t>(tally.checksum);
  if (kind == isorig_msgs::chain_t::BEGINS && !before_path_.empty()) {
    std::error_code gone;  // said by the reader, who misses it
    const auto bytes = static_cast<std::int64_t>(std::filesystem::file_size(before_path_, gone));
    if (!gone) {
      m.channels.emplace_back(messages::kTornBytes);
      m.messages.push_back(std::max<std::int64_t>(0, bytes - tally.bytes));
    }
  } else if (kind == isorig_msgs::chain_t::ENDS) {
    m.complete = ended_complete_ && fault_.empty() ? 1 : 0;
    m.dropped_records = static_cast<std::int64_t>(dropped_records_);
    m.lost_messages = static_cast<std::int64_t>(closed_lost_ + log_->lost_events());
    m.fault = fault_;
    for (std::size_t i = 0; i < messages::kChannels; ++i) {
      if (written_[i] == 0) continue;
      m.channels.emplace_back(messages::kChannelNames[i]);
      m.messages.push_back(written_[i]);
    }
  }
  m.channel_count = static_cast<std::int32_t>(m.channels.size());
  put_message(Channel::kChain, last_mono_ns_, m);
}

}  // namespace isorig::daemon
