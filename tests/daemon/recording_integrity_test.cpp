#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <tuple>

#include "daemon/recording/recording_summary.hpp"
#include "messages/channels.hpp"
#include "recording_rig.hpp"

/// A recording that is not as it was written is never called whole, and one that is never called anything else.
namespace isorig::daemon::testing {
namespace {

using messages::RecordingState;
using ::testing::Contains;
using ::testing::HasSubstr;

const std::vector<Stretch> kPlan{
    {700, 0, Keep::kFull}, {1'400, 1, Keep::kAveraged}, {2'100, 2, Keep::kFull}, {2'600, 4, Keep::kFull}};

RunInfo three_sessions() {
  auto info = run_info();
  info.sessions = {{0, 1, 5.0, 118.0}, {2, 1, 10.0, 117.0}, {4, 2, 5.0, 118.0}};
  return info;
}

RecorderOptions small_segments(const std::filesystem::path& dir) {
  auto options = recorder_options(dir);
  options.max_segment_bytes = 40'000;
  return options;
}

void record(const std::filesystem::path& dir, bool complete = true) {
  Streams streams;
  Recorder recorder(small_segments(dir), three_sessions());
  run_plan(recorder, streams, kPlan, 20);
  EXPECT_EQ(recorder.finish(streams, complete), true);
}

/// Every sample and interval by its stamp: what an export makes its rows of.
using Rows = std::vector<std::tuple<char, std::int64_t, double, double>>;
Rows rows_of(const Collected& c) {
  Rows rows;
  for (const auto& s : c.frames) rows.emplace_back('f', s.mono_ns, s.value, s.other);
  for (const auto& s : c.pressures) rows.emplace_back('p', s.mono_ns, s.value, s.other);
  for (const auto& i : c.frame_intervals) rows.emplace_back('F', i.first_ns, i.mean, i.max);
  for (const auto& i : c.pressure_intervals) rows.emplace_back('P', i.first_ns, i.mean, i.max);
  std::sort(rows.begin(), rows.end());
  return rows;
}

class Integrity : public ::testing::Test {
 protected:
  Integrity() : dir_("integrity") {
    record(dir_.path());
    segments_ = messages::list_segments(dir_.path());
    for (const auto& s : segments_) bytes_.push_back(file_text(s));
    rows_ = rows_of(collect());
  }

  Collected collect() {
    Collected c;
    report_ = messages::read_run(dir_.path(), c);
    return c;
  }

  void write(std::size_t segment, const std::string& bytes) {
    std::ofstream(segments_[segment], std::ios::binary | std::ios::trunc) << bytes;
  }

  /// Reads what an attack left. Nothing that was not recorded may come out of it.
  void expect_told(const std::string& what, RecordingState least = RecordingState::kInterrupted) {
    const auto c = collect();
    EXPECT_GE(report_.state(), least) << what;
    EXPECT_FALSE(report_.whole()) << what;
    EXPECT_FALSE(report_.complaints().empty()) << what;
    const auto rows = rows_of(c);
    EXPECT_TRUE(std::includes(rows_.begin(), rows_.end(), rows.begin(), rows.end())) << what << ": other data came out";
  }

  TemporaryDirectory dir_;
  std::vector<std::filesystem::path> segments_;
  std::vector<std::string> bytes_;
  Rows rows_;
  messages::ReadReport report_;
};

TEST_F(Integrity, AnUntouchedRecordingIsWhole) {
  ASSERT_GE(segments_.size(), 6U);
  EXPECT_EQ(report_.state(), RecordingState::kWhole) << ::testing::PrintToString(report_.complaints());
  EXPECT_TRUE(report_.has_checksums);
  EXPECT_THAT(report_.complaints(), ::testing::IsEmpty());
  EXPECT_THAT(report_.notes, ::testing::IsEmpty());
}

TEST_F(Integrity, EveryRemovedSegmentIsMissed) {
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    std::filesystem::remove(segments_[i]);
    expect_told("removed " + segments_[i].string(), RecordingState::kDamaged);
    EXPECT_THAT(report_.complaints(), Contains(HasSubstr(segments_[i].filename().string() + " is missing")));
    write(i, bytes_[i]);
  }
}

TEST_F(Integrity, EveryEmptiedSegmentIsTold) {
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    write(i, "");
    expect_told("emptied " + segments_[i].string());
    EXPECT_THAT(report_.complaints(), Contains(HasSubstr(segments_[i].filename().string() + " is empty")));
    write(i, bytes_[i]);
  }
}

TEST_F(Integrity, AnotherSegmentInItsPlaceIsTold) {
  const TemporaryDirectory other("integrity");
  {  // the same plan with another seed: same numbers, same sizes
    Streams streams;
    auto info = three_sessions();
    info.seed = 43;
    Recorder recorder(small_segments(other.path()), info);
    run_plan(recorder, streams, kPlan, 20);
    recorder.finish(streams, true);
  }
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    write(i, file_text(other.path() / segments_[i].filename()));
    (void)collect();
    EXPECT_EQ(report_.state(), RecordingState::kDamaged) << segments_[i];
    write(i, bytes_[i]);
    const std::size_t next = (i + 1) % segments_.size();
    write(i, bytes_[next]);
    expect_told("put " + segments_[next].string() + " for " + segments_[i].string(), RecordingState::kDamaged);
    write(i, bytes_[i]);
  }
}

TEST_F(Integrity, EveryFlippedBitIsTold) {
  std::mt19937_64 random(20261122);
  for (int n = 0; n < 2'000; ++n) {
    const auto i = random() % segments_.size();
    auto bytes = bytes_[i];
    const auto at = random() % bytes.size();
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << random() % 8));
    write(i, bytes);
    expect_told("bit in " + segments_[i].string() + " at " + std::to_string(at));
    write(i, bytes_[i]);
    if (HasFailure()) return;
  }
}

TEST_F(Integrity, EveryFlippedBitOfTheEndIsTold) {
  const auto last = segments_.size() - 1;
  const std::size_t from = bytes_[last].size() - 600;
  for (std::size_t at = from; at < bytes_[last].size(); ++at) {
    auto bytes = bytes_[last];
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << at % 8));
    write(last, bytes);
    expect_told("bit at " + std::to_string(at));
    if (HasFailure()) return;
  }
}

/// As a power cut may leave the last segment: its name and its length are there, and a hole in each message. By itself
/// it looks like a log without checksums.
TEST_F(Integrity, ASegmentWithoutAWholeMessageGivesNothing) {
  const auto last = segments_.size() - 1;
  std::vector<std::size_t> ends;
  {
    messages::LogReader reader(segments_[last]);
    while (reader.next()) ends.push_back(static_cast<std::size_t>(reader.tally().bytes));
  }
  auto bytes = bytes_[last];
  for (const auto end : ends) bytes[end - messages::kLogChecksumBytes - 1] ^= '\x55';
  write(last, bytes);
  expect_told("a hole in each message");
  EXPECT_TRUE(report_.has_checksums);
  write(last, bytes.substr(0, bytes.size() - 1));  // torn, and not closed
  expect_told("the same, cut");
  EXPECT_TRUE(report_.has_checksums);
}

/// The same of a recording of one segment, which no earlier one speaks for. Its header says what it is; where a hole
/// has taken the header, nothing that follows is believed either.
TEST_F(Integrity, AnOnlySegmentWithoutAWholeMessageGivesNothing) {
  std::vector<std::size_t> ends;
  {
    messages::LogReader reader(segments_.front());
    while (reader.next()) ends.push_back(static_cast<std::size_t>(reader.tally().bytes));
  }
  auto bytes = bytes_.front();
  for (const auto end : ends) bytes[end - messages::kLogChecksumBytes - 1] ^= '\x55';
  const TemporaryDirectory alone("integrity");
  const auto segment = alone.path() / messages::segment_name(1);
  const auto read = [&](const std::string& content) {
    std::ofstream(segment, std::ios::binary) << content;
    Collected c;
    const auto report = messages::read_run(alone.path(), c);
    EXPECT_TRUE(report.has_checksums);
    EXPECT_EQ(report.events, 0U);
    EXPECT_FALSE(report.whole());
    EXPECT_FALSE(report.complaints().empty());
    EXPECT_TRUE(daemon::recorded_texts(alone.path()).empty());
  };
  read(bytes);
  constexpr std::size_t kSector = 512;
  std::fill_n(bytes.begin(), std::min(kSector, bytes.size()), '\0');
  read(bytes);
}

/// As a power cut in the first moment of a run leaves it. Only recordings of older versions have no checksums, and this
/// is none.
TEST_F(Integrity, OneThatIsCutWithinItsFirstMessageIsNoOlderRecording) {
  for (std::size_t i = 1; i < segments_.size(); ++i) std::filesystem::remove(segments_[i]);
  for (const std::size_t size : {1U, 30U, 60U}) {
    write(0, bytes_[0].substr(0, size));
    expect_told("cut at " + std::to_string(size));
    EXPECT_TRUE(report_.has_checksums) << size;
    EXPECT_EQ(report_.events, 0U);
  }
}

TEST_F(Integrity, EveryTruncationIsTold) {
  std::mt19937_64 random(1);
  for (int n = 0; n < 300; ++n) {
    const auto i = random() % segments_.size();
    write(i, bytes_[i].substr(0, random() % bytes_[i].size()));
    expect_told("cut " + segments_[i].string());
    write(i, bytes_[i]);
    if (HasFailure()) return;
  }
}

/// Between two events, where nothing is torn: only counts and the chain can tell.
TEST_F(Integrity, EveryTruncationBetweenMessagesAndEveryCutOutMessageIsTold) {
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    std::vector<std::size_t> ends{0};
    {
      messages::LogReader reader(segments_[i]);
      while (reader.next()) ends.push_back(static_cast<std::size_t>(reader.tally().bytes));
    }
    for (std::size_t k = 0; k + 1 < ends.size(); k += 1 + ends.size() / 12) {
      write(i, bytes_[i].substr(0, ends[k]));
      expect_told("cut behind message " + std::to_string(k));
      write(i, bytes_[i].substr(0, ends[k]) + bytes_[i].substr(ends[k + 1]));
      expect_told("without message " + std::to_string(k));
      write(i, bytes_[i].substr(0, ends[k + 1]) + bytes_[i].substr(ends[k]));
      (void)collect();
      EXPECT_FALSE(report_.whole()) << "twice message " << k;
      write(i, bytes_[i]);
      if (HasFailure()) return;
    }
  }
}

TEST_F(Integrity, ABlockOfZerosIsTold) {
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    for (std::size_t at = 0; at < bytes_[i].size(); at += 4'096) {
      auto bytes = bytes_[i];
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), std::min<std::size_t>(4'096, bytes.size() - at),
                  '\0');
      write(i, bytes);
      expect_told("zeros at " + std::to_string(at));
      write(i, bytes_[i]);
    }
  }
}

TEST_F(Integrity, ForeignBytesAtAnyEndOfAnySegmentAreTold) {
  std::mt19937_64 random(7);
  for (const std::size_t size : {1U, 27U, 5'000U}) {
    std::string foreign(size, ' ');
    for (auto& c : foreign) c = static_cast<char>(random());
    for (std::size_t i = 0; i < segments_.size(); ++i) {
      for (const bool behind : {true, false}) {
        write(i, behind ? bytes_[i] + foreign : foreign + bytes_[i]);
        expect_told(std::to_string(size) + (behind ? " bytes behind " : " bytes before ") + segments_[i].string(),
                    RecordingState::kDamaged);
        EXPECT_THAT(report_.complaints(),
                    Contains(HasSubstr(segments_[i].filename().string() + ": " + std::to_string(size) + " bytes at ")));
        write(i, bytes_[i]);
      }
    }
  }
}

TEST_F(Integrity, HalfAMessageBehindAClosedSegmentIsTold) {
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    write(i, bytes_[i] + bytes_[i].substr(0, 40));
    expect_told("begun message behind " + segments_[i].string());
    write(i, bytes_[i]);
  }
}

TEST_F(Integrity, ASegmentAloneIsReadAndSaysWhatItIs) {
  for (const auto& segment : segments_) {
    Collected c;
    const auto report = messages::read_run(segment, c);
    EXPECT_TRUE(report.lone_segment);
    EXPECT_TRUE(report.has_header);
    EXPECT_EQ(report.state(), RecordingState::kWhole) << ::testing::PrintToString(report.complaints());
  }
}

TEST(RecordingState, APlanThatWasStoppedIsIncompleteButWhatWasRecordedIsThere) {
  const TemporaryDirectory dir("integrity");
  record(dir.path(), false);
  Collected c;
  const auto report = messages::read_run(dir.path(), c);
  EXPECT_EQ(report.state(), RecordingState::kIncomplete);
  EXPECT_TRUE(report.whole());
  EXPECT_THAT(report.complaints(),
              ::testing::ElementsAre(
                  HasSubstr("1 of 3 planned repetitions were not carried to their end: repetition 2 at 5 psi")));
}

/// `named`: a segment behind the torn one of which the disk has the name alone, as a power cut leaves it.
void expect_whole_when_repeated(bool named) {
  const TemporaryDirectory dir("integrity");
  const auto first = std::make_unique<Streams>();
  const auto copy = dir.path() / "copy";
  {
    Recorder recorder(small_segments(dir.path() / "run"), three_sessions());
    run_plan(recorder, *first, kPlan, 20);
    recorder.drain(*first, 2'600 * kMs);
    std::filesystem::copy(dir.path() / "run", copy, std::filesystem::copy_options::recursive);  // as a kill leaves it
    recorder.finish(*first, true);
  }
  {  // and a torn end
    std::ofstream(messages::list_segments(copy).back(), std::ios::binary | std::ios::app) << "half a mess";
    if (named) {
      const int last = messages::segment_number(messages::list_segments(copy).back());
      std::ofstream(copy / messages::segment_name(last + 1));
    }
    Collected c;
    const auto report = messages::read_run(copy, c);
    EXPECT_EQ(report.state(), RecordingState::kInterrupted);
    EXPECT_THAT(report.complaints(), Contains(HasSubstr("has no end")));
  }
  {
    Streams streams;
    auto info = three_sessions();
    info.first_session = 2;
    Recorder recorder(small_segments(copy), info);
    run_plan(recorder, streams, {{10'500, 4, Keep::kFull}}, 20, 10'000);
    EXPECT_TRUE(recorder.finish(streams, true));
  }
  Collected c;
  const auto report = messages::read_run(copy, c);
  EXPECT_EQ(report.state(), RecordingState::kWhole) << ::testing::PrintToString(report.complaints());
  EXPECT_THAT(report.notes, Contains(HasSubstr("attempt 1 was interrupted")));
  // The torn end is known by its length: what is put behind it later is not the writer's.
  const auto torn = std::find_if(report.notes.begin(), report.notes.end(),
                                 [](const auto& n) { return n.find("were known to be none") != std::string::npos; });
  ASSERT_NE(torn, report.notes.end());
  std::ofstream(torn->substr(0, torn->find(".lcm") + 4), std::ios::binary | std::ios::app) << "foreign";
  Collected again;
  EXPECT_EQ(messages::read_run(copy, again).state(), RecordingState::kDamaged);
}

TEST(RecordingState, AnInterruptedAttemptThatWasRepeatedLeavesAWholeRecording) {
  expect_whole_when_repeated(false);
}

TEST(RecordingState, ASegmentOfWhichAPowerCutLeftTheNameAloneIsNoLoss) {
  expect_whole_when_repeated(true);
}

TEST(RecordingState, MessagesOutOfOrderAreNotMissing) {
  messages::NumberCheck numbers;
  for (const std::int64_t n : {0, 5, 3, 4, 1, 2, 6}) numbers.take(n);
  EXPECT_EQ(numbers.missing(), 0U);
  EXPECT_EQ(numbers.repeated(), 0U);
  for (const std::int64_t n : {10, 8, 8, 0}) numbers.take(n);
  EXPECT_EQ(numbers.missing(), 2U);
  EXPECT_EQ(numbers.repeated(), 2U);
}

/// The recorder sorts by time: what a stream sends late, behind samples that were stamped at their arrival, comes
/// before them in the log, with higher numbers.
TEST(RecordingState, AFrozenStreamLeavesNothingMissing) {
  const TemporaryDirectory dir("integrity");
  Streams streams;
  {
    Recorder recorder(recorder_options(dir.path()), run_info());
    for (std::int64_t i = 0; i < 3'000; ++i) {
      if (i <= 500 || i > 800) streams.frame.push(frame_record(i, 0, Keep::kFull));
      if (i == 840) {
        for (std::int64_t late = 501; late <= 800; ++late) streams.frame.push(frame_record(late, 0, Keep::kFull));
      }
      streams.pressure.push(pressure_record(i, 0, Keep::kFull));
      if (i % 20 == 0) recorder.drain(streams, i * kMs);
    }
    recorder.finish(streams, true);
  }
  struct : messages::RunVisitor {
    void frame(const isorig_msgs::frame_batch_t& m) override { take(m.number); }
    void frame_average(const isorig_msgs::frame_average_batch_t& m) override { averages.push_back(m.number); }
    void take(std::int64_t n) { batches.push_back(n); }
    std::vector<std::int64_t> batches, averages;
  } seen;
  const auto report = messages::read_run(dir.path(), seen);
  EXPECT_FALSE(std::is_sorted(seen.batches.begin(), seen.batches.end()) &&
               std::is_sorted(seen.averages.begin(), seen.averages.end()))
      << "was to have numbers out of order";
  EXPECT_EQ(report.state(), RecordingState::kWhole) << ::testing::PrintToString(report.complaints());
}

/// What isorig wrote before it wrote checksums.
void rewrite_as_format_1(const std::filesystem::path& from, const std::filesystem::path& to) {
  messages::LogReader reader(from);
  std::ofstream out(to, std::ios::binary);
  std::int64_t number = 0;
  while (const auto event = reader.next()) {
    if (event->channel == name_of(messages::Channel::kChain)) continue;
    std::vector<std::uint8_t> data(event->data.begin(), event->data.end());
    if (event->channel == name_of(messages::Channel::kHeader)) {
      isorig_msgs::run_header_t h;
      ASSERT_GT(h.decode(data.data(), 0, static_cast<int>(data.size())), 0);
      h.format = messages::kOldLogFormat;
      h.encode(data.data(), 0, static_cast<int>(data.size()));
    }
    std::array<std::uint8_t, messages::kLogHeaderBytes> head{};
    auto* at = messages::put_big_endian(head.data(), messages::kLogSyncWord);
    at = messages::put_big_endian(at, number++);
    at = messages::put_big_endian(at, event->utime_us);
    at = messages::put_big_endian(at, static_cast<std::uint32_t>(event->channel.size()));
    messages::put_big_endian(at, static_cast<std::uint32_t>(data.size()));
    out.write(reinterpret_cast<const char*>(head.data()), head.size());
    out << event->channel;
    out.write(reinterpret_cast<const char*>(data.data()), static_cast<std::streamsize>(data.size()));
  }
}

TEST_F(Integrity, AnOldRecordingIsReadAndSaysThatItHasNoChecksums) {
  const TemporaryDirectory old("integrity");
  for (const auto& s : segments_) rewrite_as_format_1(s, old.path() / s.filename());
  Collected c;
  const auto report = messages::read_run(old.path(), c);
  EXPECT_FALSE(report.has_checksums);
  EXPECT_EQ(report.state(), RecordingState::kWhole) << ::testing::PrintToString(report.complaints());
  EXPECT_TRUE(rows_of(c) == rows_);
  std::filesystem::remove(old.path() / segments_[3].filename());
  EXPECT_EQ(messages::read_run(old.path(), c).state(), RecordingState::kDamaged);
}

}  // namespace
}  // namespace isorig::daemon::testing
