// Logs that no recorder wrote: their counts, numbers and names are anything, and reading them stays cheap and defined.
#include "messages/run_log.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <fstream>
#include <limits>
#include <sstream>
#include <tuple>

#include "messages/log_writer.hpp"
#include "tree.hpp"

namespace isorig::messages {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class HostileLog : public ::testing::Test {
 protected:
  HostileLog() {
    std::string name = "/tmp/isorig-run-log-XXXXXX";
    folder_ = ::mkdtemp(name.data());
  }
  ~HostileLog() override { std::filesystem::remove_all(folder_); }

  template <typename Message>
  static std::vector<std::uint8_t> encoded(const Message& message) {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    return bytes;
  }
  static isorig_msgs::run_header_t header() {
    isorig_msgs::run_header_t h{};
    h.format = "isorig-log/2";
    h.attempt = 1;
    return h;
  }
  void write(const std::string& file, Channel channel, const std::vector<std::uint8_t>& bytes) {
    LogWriter writer(folder_ / file, {});
    const auto first = encoded(header());
    ASSERT_TRUE(writer.append(name_of(Channel::kHeader), 0, first));
    ASSERT_TRUE(writer.append(name_of(channel), 0, bytes));
  }
  ReadReport read() {
    RunVisitor nobody;
    return read_run(folder_, nobody);
  }

  std::filesystem::path folder_;
};

TEST_F(HostileLog, ACountBeyondTheMessageTakesNoMemory) {
  auto bytes = encoded(header());
  // The last three numbers are the counts of texts, versions and sessions: 2^26 texts would take 4 GB.
  bytes[bytes.size() - 12] = 4;
  write("segment-0001.lcm", Channel::kHeader, bytes);
  rusage before{}, after{};
  ::getrusage(RUSAGE_SELF, &before);
  EXPECT_EQ(read().undecodable, 1U);
  ::getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 100 * 1024) << "kB";
}

TEST_F(HostileLog, ATextOfALengthBelowOneIsNoText) {
  auto bytes = encoded(header());
  // Behind the type's fingerprint the format's length, with the zero at its end.
  ASSERT_EQ(bytes[11], std::string("isorig-log/2").size() + 1);
  for (const int first : {0x00, 0x80, 0xFF}) {  // 0; -2^31, from which 1 cannot be subtracted; below -1
    bytes[8] = static_cast<std::uint8_t>(first);
    bytes[11] = 0;
    std::filesystem::remove(folder_ / "segment-0001.lcm");
    write("segment-0001.lcm", Channel::kHeader, bytes);
    EXPECT_EQ(read().undecodable, 1U) << first;
  }
}

TEST_F(HostileLog, TimesThatNoClockHasAreNoMessages) {
  for (const auto odd : {std::numeric_limits<std::int64_t>::max(), std::numeric_limits<std::int64_t>::min()}) {
    isorig_msgs::frame_batch_t batch{};
    batch.mono_ns = odd;
    std::filesystem::remove(folder_ / "segment-0001.lcm");
    write("segment-0001.lcm", Channel::kFrame, encoded(batch));
    EXPECT_EQ(read().undecodable, 1U) << odd;
    batch.mono_ns = 0;
    batch.number = odd;
    std::filesystem::remove(folder_ / "segment-0001.lcm");
    write("segment-0001.lcm", Channel::kFrame, encoded(batch));
    EXPECT_EQ(read().undecodable, 1U) << odd;
  }
}

TEST_F(HostileLog, CountsOfAnIntervalBelowZeroAreNoMessages) {
  isorig_msgs::pressure_average_batch_t batch{};
  batch.count = 1;
  batch.first_mono_ns = batch.last_mono_ns = batch.first_device_us = batch.last_device_us = {0};
  batch.first_sequence = batch.last_sequence = {0};
  batch.bound_ns = batch.repeatability_ns = batch.mean_raw_counts = batch.mean_temperature_C = {0.0F};
  batch.mean_pressure_psi = batch.min_pressure_psi = batch.max_pressure_psi = {0.0};
  // Samples and those of them that are current: their difference has to be a count, too.
  for (const auto& [samples, current, bad] : {std::tuple(3, 2, 0U), std::tuple(-1'895'825'408, 709'257'386, 1U),
                                              std::tuple(-1, 0, 1U), std::tuple(2, -1, 1U), std::tuple(2, 3, 1U)}) {
    batch.samples = {samples};
    batch.current = {current};
    std::filesystem::remove(folder_ / "segment-0001.lcm");
    write("segment-0001.lcm", Channel::kPressureAverage, encoded(batch));
    EXPECT_EQ(read().undecodable, bad) << samples << ' ' << current;
  }
}

TEST_F(HostileLog, AnAttemptHasASuccessor) {
  auto last = header();
  last.attempt = std::numeric_limits<std::int32_t>::max();
  write("segment-0001.lcm", Channel::kHeader, encoded(last));
  EXPECT_EQ(read().undecodable, 1U);
}

/// A log of tomorrow is no log of the live channels, and no damaged one.
TEST_F(HostileLog, AVersionThatIsNotKnownIsRefusedByItsName) {
  const auto write_header = [&](const std::vector<std::uint8_t>& bytes) {
    std::filesystem::remove(folder_ / "segment-0001.lcm");
    LogWriter writer(folder_ / "segment-0001.lcm", {});
    ASSERT_TRUE(writer.append(name_of(Channel::kHeader), 0, bytes));
    ASSERT_TRUE(writer.append(name_of(Channel::kFrame), 0, encoded(isorig_msgs::frame_batch_t{})));
  };
  const auto refused = ::testing::Throws<UnknownLogVersion>(::testing::Property(
      &std::exception::what,
      ::testing::StrEq(
          (folder_ / "segment-0001.lcm").string() +
          ": format \"isorig-log/3\", this program reads 1 and 2; read it with the isorig that recorded it, or a newer "
          "one")));
  auto h = header();
  h.format = "isorig-log/3";
  auto bytes = encoded(h);
  write_header(bytes);
  EXPECT_THAT([&] { (void)read(); }, refused);
  EXPECT_THAT([&] { (void)read_header(folder_ / "segment-0001.lcm"); }, refused);
  bytes[0] ^= 0xFFU;  // a type of another layout: nothing behind the format can be read
  bytes.resize(bytes.size() - 8);
  write_header(bytes);
  EXPECT_THAT([&] { (void)read(); }, refused);
  EXPECT_THAT([&] { (void)read_header(folder_ / "segment-0001.lcm"); }, refused);
  for (const char* other : {"isorig-logs/3", "isorig-log", "", "lcm"}) {
    h.format = other;
    write_header(encoded(h));
    EXPECT_EQ(read().undecodable, 1U) << other;
  }
  // Without checksums it may as well be a damaged 1.
  h.format = "isorig-log/3";
  write_header(encoded(h));
  {
    std::fstream log(folder_ / "segment-0001.lcm", std::ios::in | std::ios::out | std::ios::binary);
    const auto header_bytes = static_cast<std::streamoff>(kLogHeaderBytes + name_of(Channel::kHeader).size() +
                                                          encoded(h).size() + kLogChecksumBytes);
    log.seekp(header_bytes - 1);
    log.put('\x5A');
    log.seekp(0, std::ios::end);
    log.seekp(-1, std::ios::cur);
    log.put('\x5A');
  }
  const auto without = read();
  EXPECT_FALSE(without.has_checksums);
  EXPECT_EQ(without.undecodable, 1U);
}

TEST_F(HostileLog, SegmentsThatAreGoneAreToldInOneLine) {
  write("segment-0001.lcm", Channel::kFrame, encoded(isorig_msgs::frame_batch_t{}));
  write("segment-2147483647.lcm", Channel::kFrame, encoded(isorig_msgs::frame_batch_t{}));
  EXPECT_THAT(read().contradictions, ElementsAre(HasSubstr("segment-0002.lcm to segment-2147483646.lcm are missing")));
}

TEST_F(HostileLog, ANumberHasOneName) {
  EXPECT_EQ(segment_number("segment-0012.lcm"), 12);
  EXPECT_EQ(segment_number("segment-12345.lcm"), 12345);
  for (const char* other : {"segment-12.lcm", "segment-00012.lcm", "segment-0000.lcm", "segment--001.lcm"})
    EXPECT_EQ(segment_number(other), 0) << other;
}

TEST(GapCounter, CountsByTheCasesThatPythonCountsByToo) {
  std::ifstream file(test::source_path("/tests/messages/gap_cases.txt"));
  int cases = 0;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with('#')) continue;
    std::istringstream numbers(line.substr(0, line.find('='))), changes(line.substr(line.find('=') + 1));
    GapCounter gaps;
    std::vector<std::int64_t> counted, expected;
    for (std::int64_t number = 0; numbers >> number;) counted.push_back(gaps.next(number));
    for (std::int64_t change = 0; changes >> change;) expected.push_back(change);
    EXPECT_EQ(counted, expected) << line;
    ++cases;
  }
  EXPECT_GT(cases, 15);
}

}  // namespace
}  // namespace isorig::messages
