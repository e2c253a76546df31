// Recordings of format 1, which had no checksums: built here byte by byte, so that they do not change with the types.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <bit>
#include <cstdint>
#include <fstream>
#include <map>

#include "daemon/export/export.hpp"
#include "daemon/recording/recording_summary.hpp"
#include "messages/recording.hpp"
#include "messages/run_log.hpp"
#include "tree.hpp"

namespace isorig {
namespace {

/// Of the layout: LCM's decoders refuse a message with another.
const std::map<std::string, std::uint64_t> kFingerprints{
    {"chain_t", 0x9977e1aefc03a976},
    {"control_batch_t", 0x478703cb47f2979a},
    {"event_t", 0x64edfa9e1d20d517},
    {"exchange_batch_t", 0x61621183f20801fd},
    {"frame_average_batch_t", 0x73b1507afa5b13c0},
    {"frame_batch_t", 0xf8d6d122c65e2cc9},
    {"pressure_average_batch_t", 0x4c11b965c36c83f9},
    {"pressure_batch_t", 0xb2d10cd12703d754},
    {"run_header_t", 0x923a01a00ccd5d6f},
    {"session_mark_t", 0xb59648431efa8205},
    {"sync_check_t", 0x8de491dbdba38cf5},
};

class Bytes {
 public:
  template <typename T>
  Bytes& put(T value) {
    if constexpr (sizeof(T) == 8) {
      add(std::bit_cast<std::uint64_t>(value), 8);
    } else if constexpr (sizeof(T) == 4) {
      add(std::bit_cast<std::uint32_t>(value), 4);
    } else if constexpr (sizeof(T) == 2) {
      add(static_cast<std::uint16_t>(value), 2);
    } else {
      add(static_cast<std::uint8_t>(value), 1);
    }
    return *this;
  }
  Bytes& text(const std::string& value) {
    put(static_cast<std::int32_t>(value.size() + 1));
    bytes_ += value + '\0';
    return *this;
  }
  Bytes& raw(const std::string& value) {
    bytes_ += value;
    return *this;
  }
  [[nodiscard]] const std::string& all() const { return bytes_; }

 private:
  void add(std::uint64_t value, int size) {
    for (int shift = 8 * size - 8; shift >= 0; shift -= 8)
      bytes_ += static_cast<char>(value >> static_cast<unsigned>(shift));
  }
  std::string bytes_;
};

class OldLog : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = "/tmp/isorig-old-log-XXXXXX";
    folder_ = ::mkdtemp(pattern.data());
    std::filesystem::create_directories(folder_ / "run");
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  /// lcm-logger's event: sync word, number, time, lengths, channel, data.
  void event(const std::string& channel, const Bytes& data) {
    Bytes head;
    head.put(std::uint32_t{0xEDA1DA01U}).put(number_++).put(std::int64_t{946'684'800'000'000});
    head.put(static_cast<std::int32_t>(channel.size())).put(static_cast<std::int32_t>(data.all().size()));
    log_ += head.all() + channel + data.all();
  }

  static Bytes session() {
    Bytes b;
    b.put(std::int32_t{0}).put(std::int32_t{0}).put(std::int32_t{1}).put(5.0).put(92.5);
    return b;
  }

  void header() {
    Bytes b;
    b.put(kFingerprints.at("run_header_t")).text("isorig-log/1").put(std::int32_t{1});
    b.put(std::int64_t{946'684'800'000'000}).put(std::int8_t{1}).put(std::int64_t{42}).text("a rig").text("M1");
    b.put(100.0).text("a plan").put(0.1).put(3.0);
    b.put(std::int32_t{1}).text("protocol.toml").text("# none\n");
    b.put(std::int32_t{1}).text("isorig").text("0.1.0");
    b.put(std::int32_t{1}).raw(session().all());
    event("ISORIG_HEADER", b);
  }

  void mark(std::int8_t kind, std::int64_t number) {
    Bytes b;
    b.put(kFingerprints.at("session_mark_t")).put(number).put(std::int64_t{1'000'000'000});
    b.put(kind).put(std::int8_t{1}).put(std::int32_t{1}).raw(session().all());
    for (int i = 0; i < 7; ++i) b.put(std::int64_t{0});
    event("ISORIG_SESSION", b);
  }

  void frame() {
    constexpr std::int16_t kCount = 3;
    Bytes b;
    b.put(kFingerprints.at("frame_batch_t")).put(std::int64_t{0}).put(std::int32_t{0}).put(std::int32_t{0});
    b.put(std::int64_t{1'000'000'000}).put(std::int64_t{5'000'000}).put(std::int64_t{77}).put(kCount);
    for (std::int32_t i = 0; i < kCount; ++i) b.put(std::int32_t{i * 1'000'000});
    for (std::int32_t i = 0; i < kCount; ++i) b.put(std::int32_t{i * 1000});
    for (std::int16_t i = 0; i < kCount; ++i) b.put(i);
    for (const float value : {150'000.0F, 9'000.0F, 1.25F, 44.0F}) {
      for (int i = 0; i < kCount; ++i) b.put(value);
    }
    for (const double value : {1.5, 2.0, 2.5, 44.5, 44.0, 43.5}) b.put(value);
    event("ISORIG_FRAME", b);
  }

  void save() const { std::ofstream(folder_ / "run" / "segment-0001.lcm", std::ios::binary) << log_; }

  std::filesystem::path folder_;
  std::string log_;
  std::int64_t number_ = 0;
};

TEST_F(OldLog, Format1IsReadAndExported) {
  header();
  mark(0, 0);
  frame();
  mark(2, 1);
  save();
  const auto report = daemon::export_run(folder_ / "run", folder_ / "out", {.run_id = "old"});
  EXPECT_FALSE(report.read.has_checksums);
  EXPECT_EQ(report.read.state(), messages::RecordingState::kWhole) << testing::PrintToString(report.read.complaints());
  ASSERT_EQ(report.sessions.size(), 1U);
  const auto r = messages::read_recording(report.sessions[0].folder);
  EXPECT_EQ(r.metadata.specimen, "M1");
  EXPECT_EQ(r.metadata.pressurized_rest_length_mm, 92.5);
  EXPECT_EQ(r.frame.t_s, (std::vector<double>{0.0, 0.001, 0.002}));
  EXPECT_EQ(r.frame.position_mm, (std::vector<double>{1.5, 2.0, 2.5}));
  EXPECT_EQ(r.frame.force_N, (std::vector<double>{44.5, 44.0, 43.5}));
}

/// Beside the segments stands what people read, and what the catalogue takes the date from.
TEST_F(OldLog, ARunTomlOfBeforeItNamedItsFormatIsRead) {
  header();
  mark(0, 0);
  frame();
  mark(2, 1);
  save();
  EXPECT_EQ(daemon::summarize_recording(folder_ / "run").started_utc, "");
  std::filesystem::copy(std::filesystem::path(test::source_path()) / "tests/formats/samples/2026-11-23/run/run.toml",
                        folder_ / "run" / "run.toml");
  const auto run = daemon::summarize_recording(folder_ / "run");
  EXPECT_EQ(run.started_utc, "2026-11-23T05:17:35Z");
  EXPECT_EQ(run.header.specimen, "M1") << "the recording counts";
}

/// A type that changes makes every recording unreadable that has it. Then the format needs a new version, the old type
/// a place to be decoded, and this list a second column.
TEST(OldLogs, TheTypesHaveTheLayoutThatRecordingsHave) {
  using namespace isorig_msgs;
  const std::map<std::string, std::uint64_t> now{
      {"run_header_t", static_cast<std::uint64_t>(run_header_t::getHash())},
      {"session_mark_t", static_cast<std::uint64_t>(session_mark_t::getHash())},
      {"frame_batch_t", static_cast<std::uint64_t>(frame_batch_t::getHash())},
      {"frame_average_batch_t", static_cast<std::uint64_t>(frame_average_batch_t::getHash())},
      {"pressure_batch_t", static_cast<std::uint64_t>(pressure_batch_t::getHash())},
      {"pressure_average_batch_t", static_cast<std::uint64_t>(pressure_average_batch_t::getHash())},
      {"control_batch_t", static_cast<std::uint64_t>(control_batch_t::getHash())},
      {"event_t", static_cast<std::uint64_t>(event_t::getHash())},
      {"exchange_batch_t", static_cast<std::uint64_t>(exchange_batch_t::getHash())},
      {"sync_check_t", static_cast<std::uint64_t>(sync_check_t::getHash())},
      {"chain_t", static_cast<std::uint64_t>(chain_t::getHash())},
  };
  EXPECT_EQ(now, kFingerprints);
}

}  // namespace
}  // namespace isorig
