#include "daemon/export/export.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lcm/lcm.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <sstream>
#include <string_view>

#include "messages/recording.hpp"
#include "recording_rig.hpp"
#include "small_disk.hpp"

namespace isorig::daemon::testing {
namespace {

using ::testing::HasSubstr;

RunInfo two_sessions() {
  auto info = run_info();
  info.sessions = {{0, 1, 5.0, 118.25}, {2, 1, 10.0}};
  return info;
}

/// Session 0: averaged until 2.5 s, then full; session 1: averaged.
const std::vector<Stretch> kPlan{{2'500, 0, Keep::kAveraged}, {4'000, 1, Keep::kFull}, {6'000, 2, Keep::kAveraged}};

/// What rounding may move a value by: a twentieth of the smallest step between two readings in full (rounded to two
/// digits itself, hence 18).
template <typename Value>
double rounding(Value value, std::int64_t from, std::int64_t to) {
  double smallest = std::numeric_limits<double>::infinity(), largest = 0.0;
  for (auto i = from + 1; i < to; ++i) {
    smallest = std::min(smallest, std::abs(value(i) - value(i - 1)));
    largest = std::max(largest, std::abs(value(i)));
  }
  return std::max(smallest, largest / 16'777'216.0) / 18.0;  // a device's readings come in 24 bits
}

TEST(Export, WritesWhatWasRecordedInTheRecordingFormat) {
  const TemporaryDirectory dir("export");
  auto options = recorder_options(dir.path() / "run");
  options.before_s = 0.5;
  {
    Streams streams;
    Recorder recorder(options, two_sessions());
    run_plan(recorder, streams, kPlan, 20);
    recorder.finish(streams, true);
  }
  const auto report = export_run(dir.path() / "run", dir.path() / "out", {.run_id = "the-run"});
  EXPECT_TRUE(report.read.whole());
  ASSERT_EQ(report.sessions.size(), 2U);
  EXPECT_EQ(report.sessions[0].folder, dir.path() / "out" / "rep-1_05-psi");
  EXPECT_TRUE(report.sessions[0].complete);
  EXPECT_EQ(report.sessions[0].not_increasing, 0U);
  EXPECT_EQ(report.sessions[0].not_measured, 4U);  // every thousandth word is stale

  const auto r = messages::read_recording(report.sessions[0].folder);
  EXPECT_EQ(r.metadata.specimen, "M1");
  EXPECT_EQ(r.metadata.rest_length_mm, 120.5);
  EXPECT_EQ(r.metadata.pressurized_rest_length_mm, 118.25);
  EXPECT_EQ(r.metadata.nominal_pressure_psi, 5.0);
  EXPECT_THAT(r.metadata.further_toml, HasSubstr("run = 'the-run'"));
  EXPECT_THAT(r.metadata.further_toml, HasSubstr("seed = 42"));
  // 2 s of averages in 0.1 s, then 0.5 s of run-up and 1.5 s at 1 kHz. (Sample 2000 leaves the ring with the
  // first full one: it is 500 ms old, and alone in its interval.)
  ASSERT_EQ(r.frame.size(), 20U + 1U + 1'999U);
  const std::int64_t start = frame_record(0, 0, Keep::kFull).mono_ns + 99 * kMs / 2;
  EXPECT_EQ(r.frame.t_s[0], 0.0);
  const auto full = [](std::int64_t i) { return frame_record(i, 0, Keep::kFull); };
  const double mm = rounding([&](std::int64_t i) { return full(i).position_mm; }, 2'001, 4'000);
  const double newton = rounding([&](std::int64_t i) { return full(i).force_N; }, 2'001, 4'000);
  EXPECT_LT(mm, 1e-4);
  double mean = 0.0;
  for (int i = 0; i < 100; ++i) mean += frame_record(i, 0, Keep::kFull).position_mm / 100.0;
  EXPECT_NEAR(r.frame.position_mm[0], mean, mm / 10.0) << "a mean has a decimal more than a reading";
  for (std::size_t i = 0; i < 1'999; ++i) {
    const auto f = frame_record(2'001 + static_cast<std::int64_t>(i), 0, Keep::kFull);
    ASSERT_EQ(r.frame.t_s[21 + i], static_cast<double>(f.mono_ns - start) / 1e9) << i;
    ASSERT_NEAR(r.frame.position_mm[21 + i], f.position_mm, mm);
    ASSERT_NEAR(r.frame.force_N[21 + i], f.force_N, newton);
  }
  ASSERT_TRUE(r.pressure);
  // Both files count from the same moment.
  const double psi =
      rounding([](std::int64_t i) { return pressure_record(i, 0, Keep::kFull).pressure_psi; }, 2'001, 4'000);
  const auto p = pressure_record(3'998, 0, Keep::kFull);
  EXPECT_EQ(r.pressure->t_s.back(), static_cast<double>(p.mono_ns - start) / 1e9);
  EXPECT_NEAR(r.pressure->pressure_psi.back(), p.pressure_psi, psi);

  const auto second = messages::read_recording(report.sessions[1].folder);
  EXPECT_FALSE(second.metadata.pressurized_rest_length_mm) << "NaN is: not known";
  EXPECT_EQ(second.frame.size(), 20U);
}

/// A segment as a logger of the live channels would have written it: without header and chain.
void as_live_log(const std::filesystem::path& segment, const std::filesystem::path& live) {
  auto* from = lcm_eventlog_create(segment.c_str(), "r");
  auto* to = lcm_eventlog_create(live.c_str(), "w");
  ASSERT_TRUE(from != nullptr && to != nullptr);
  while (auto* event = lcm_eventlog_read_next_event(from)) {
    const std::string_view channel(event->channel);
    if (channel != "ISORIG_HEADER" && channel != "ISORIG_CHAIN") {
      EXPECT_EQ(lcm_eventlog_write_event(to, event), 0);
    }
    lcm_eventlog_free_event(event);
  }
  lcm_eventlog_destroy(from);
  lcm_eventlog_destroy(to);
}

TEST(Export, SaysHowFarItHasComeAlsoWithinALongSegment) {
  const TemporaryDirectory dir("export");
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), run_info());
    run_plan(recorder, streams, {{150'000, 0, Keep::kFull}}, 20);
    recorder.finish(streams, true);
  }
  const auto segments = messages::list_segments(dir.path() / "run");
  ASSERT_EQ(segments.size(), 1U);
  const auto bytes = std::filesystem::file_size(segments.front());
  ASSERT_GT(bytes, std::uintmax_t{4} << 20U);
  std::vector<double> told;
  messages::RunVisitor nobody;
  (void)messages::read_run(dir.path() / "run", nobody, [&](double fraction) { told.push_back(fraction); });
  EXPECT_TRUE(std::is_sorted(told.begin(), told.end()));
  EXPECT_EQ(told.front(), 0.0);
  EXPECT_EQ(told.back(), 1.0);
  EXPECT_GE(told.size(), (bytes >> 20U) - 1);  // about once per MiB
  told.clear();
  ExportOptions options;
  options.on_progress = [&](double fraction) { told.push_back(fraction); };
  (void)export_run(dir.path() / "run", dir.path() / "out", options);
  EXPECT_TRUE(std::is_sorted(told.begin(), told.end()));
  EXPECT_EQ(told.back(), 1.0);
  EXPECT_TRUE(std::any_of(told.begin(), told.end(), [](double f) { return f > 0.6 && f < 0.9; }));
  // A live log is read three times.
  as_live_log(segments.front(), dir.path() / "live.lcm");
  told.clear();
  options.specimen = "M1";
  options.rest_length_mm = 120.5;
  EXPECT_EQ(export_run(dir.path() / "live.lcm", dir.path() / "live", options).sessions.size(), 1U);
  EXPECT_TRUE(std::is_sorted(told.begin(), told.end()));
  EXPECT_EQ(told.back(), 1.0);
  for (const double from : {0.0, 0.5, 0.75}) {
    EXPECT_TRUE(std::any_of(told.begin(), told.end(), [=](double f) { return f > from + 0.05 && f < from + 0.2; }))
        << from;
  }
}

TEST(Export, KeepsRunsApart) {
  const TemporaryDirectory dir("export");
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), two_sessions());
    run_plan(recorder, streams, kPlan, 20);
    recorder.finish(streams, true);
  }
  const auto out = dir.path() / "out";
  (void)export_run(dir.path() / "run", out, {.run_id = "first"});
  EXPECT_EQ(export_run(dir.path() / "run", out, {.run_id = "first"}).sessions.size(), 2U);  // again: replaced
  EXPECT_THAT(
      [&] { (void)export_run(dir.path() / "run", out, {.run_id = "second"}); },
      ::testing::ThrowsMessage<std::runtime_error>(HasSubstr("of run first; export into a folder of this run's own")));
  // The names of these have the run in them.
  for (const auto format : {ExportFormat::kHdf5, ExportFormat::kMat}) {
    EXPECT_EQ(export_run(dir.path() / "run", out, {.format = format, .run_id = "second"}).sessions.size(), 2U);
  }
}

/// Of a plan of 5 and 10 psi only the first session is recorded at first: its name is that of the whole plan's export.
TEST(Export, OnAFullDiskSaysWhichFileAndLeavesNoFolder) {
  const TemporaryDirectory dir("export");
  const SmallDisk disk(dir.path() / "disk");
  if (!disk.mounted()) GTEST_SKIP() << "a full disk is a tmpfs, and mounting needs root: " << std::strerror(errno);
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), two_sessions());
    run_plan(recorder, streams, kPlan, 20);
    recorder.finish(streams, true);
  }
  disk.fill();
  const auto out = disk.path() / "out";
  for (const auto format : {ExportFormat::kCsv, ExportFormat::kMat, ExportFormat::kHdf5}) {
    SCOPED_TRACE(static_cast<int>(format));
    EXPECT_THAT([&] { (void)export_run(dir.path() / "run", out, {.format = format, .run_id = "r"}); },
                ::testing::ThrowsMessage<std::runtime_error>(
                    ::testing::AllOf(HasSubstr(out.string()), HasSubstr("check the disk's space and permissions"))));
    if (!std::filesystem::exists(out)) continue;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(out))
      EXPECT_THAT(entry.path().filename().string(), ::testing::StartsWith(".")) << "was left behind";
  }
}

TEST(Export, ASessionHasOneNameBeforeAndAfterTheOthersAreRecorded) {
  const TemporaryDirectory dir("export");
  const auto run = dir.path() / "run", out = dir.path() / "out";
  auto info = two_sessions();
  info.sessions.push_back({3, 1, 5.0});  // the first one's repetition and pressure again
  const auto record = [&](const std::vector<Stretch>& plan, std::int64_t from_ms, bool complete) {
    Streams streams;
    Recorder recorder(recorder_options(run), info);
    run_plan(recorder, streams, plan, 20, from_ms);
    recorder.finish(streams, complete);
  };
  const auto names = [](const std::filesystem::path& folder) {
    std::vector<std::string> found;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) found.push_back(entry.path().filename());
    return found;
  };
  record({{1'000, 0, Keep::kFull}}, 0, false);
  const auto formats = {ExportFormat::kCsv, ExportFormat::kMat, ExportFormat::kHdf5};
  for (const auto format : formats) {
    const auto half = export_run(run, out, {.format = format, .run_id = "r"});
    ASSERT_EQ(half.sessions.size(), 1U);
    EXPECT_EQ(half.sessions[0].name, "rep-1_05-psi");
  }
  // As a version that looked at the recorded sessions alone had named it; then a folder and a file of one's own, of
  // the same session, and one of another under such a name.
  std::filesystem::rename(out / "rep-1_05-psi", out / "rep-1_5-psi");
  std::filesystem::rename(out / "r" / "rep-1_05-psi.mat", out / "r" / "rep-1_5-psi.mat");
  std::filesystem::copy(out / "rep-1_5-psi", out / "smoothed");
  std::filesystem::copy(out / "r" / "rep-1_5-psi.mat", out / "r" / "smoothed.mat");
  std::filesystem::copy(out / "rep-1_5-psi", out / "rep-1_5-psi_session-2");
  std::filesystem::copy(out / "r" / "rep-1_5-psi.mat", out / "r" / "rep-1_5-psi_session-2.mat");
  record({{3'000, 0, Keep::kFull}, {4'000, 2, Keep::kFull}, {5'000, 3, Keep::kFull}}, 2'000, true);
  for (const auto format : formats) {
    const auto report = export_run(run, out, {.format = format, .run_id = "r"});
    ASSERT_EQ(report.sessions.size(), 3U);
    EXPECT_EQ(report.sessions[0].name, "rep-1_05-psi");
    EXPECT_EQ(report.sessions[1].name, "rep-1_10-psi");
    EXPECT_EQ(report.sessions[2].name, "rep-1_05-psi_session-2");
    EXPECT_THAT(report.sessions[1].replaces, ::testing::IsEmpty());
    EXPECT_THAT(report.sessions[2].replaces, ::testing::IsEmpty()) << "what lies there says that it is of session 0";
    const bool one_file = format == ExportFormat::kHdf5;
    EXPECT_EQ(report.sessions[0].replaces.size(), one_file ? 0U : 1U);
  }
  EXPECT_THAT(names(out), ::testing::UnorderedElementsAre("r", "r.h5", "smoothed", "rep-1_05-psi", "rep-1_10-psi",
                                                          "rep-1_05-psi_session-2", "rep-1_5-psi_session-2"));
  EXPECT_THAT(names(out / "r"),
              ::testing::UnorderedElementsAre("smoothed.mat", "rep-1_05-psi.mat", "rep-1_10-psi.mat",
                                              "rep-1_05-psi_session-2.mat", "rep-1_5-psi_session-2.mat"));
}

/// A note that somebody laid into the folder is not isorig's to remove.
TEST(Export, WhatSomebodyPutIntoAFolderStaysWhenItsSessionGoesToAnotherName) {
  const TemporaryDirectory dir("export");
  const auto run = dir.path() / "run", out = dir.path() / "out";
  {
    Streams streams;
    Recorder recorder(recorder_options(run), two_sessions());
    run_plan(recorder, streams, kPlan, 20);
    recorder.finish(streams, true);
  }
  (void)export_run(run, out, {.run_id = "r"});
  std::filesystem::rename(out / "rep-1_05-psi", out / "rep-1_5-psi");
  std::ofstream(out / "rep-1_5-psi" / "note.txt") << "mine\n";
  EXPECT_THAT(export_run(run, out, {.run_id = "r"}).sessions.at(0).replaces,
              ::testing::ElementsAre(out / "rep-1_5-psi"));
  EXPECT_EQ(file_text(out / "rep-1_5-psi" / "note.txt"), "mine\n");
  EXPECT_FALSE(std::filesystem::exists(out / "rep-1_5-psi" / "recording.toml")) << "it would still count";
  EXPECT_FALSE(std::filesystem::exists(out / "rep-1_5-psi" / "frame.csv"));
}

/// With its header unread it would pass for a log of the live channels.
TEST(Export, ARecordingOfAVersionToComeIsRefusedByItsName) {
  const TemporaryDirectory dir("export");
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), two_sessions());
    run_plan(recorder, streams, kPlan, 20);
    recorder.finish(streams, true);
  }
  make_version_3(dir.path() / "run" / "segment-0001.lcm");
  for (const auto format : {ExportFormat::kCsv, ExportFormat::kHdf5, ExportFormat::kMat}) {
    EXPECT_THAT([&] { (void)export_run(dir.path() / "run", dir.path() / "out", {.format = format, .specimen = "M1"}); },
                ::testing::ThrowsMessage<messages::UnknownLogVersion>(
                    HasSubstr("format \"isorig-log/3\", this program reads 1 and 2")));
  }
  EXPECT_FALSE(std::filesystem::exists(dir.path() / "out")) << "it was begun";
}

TEST(Export, TheLastAttemptCountsUnlessOnlyAnEarlierOneIsComplete) {
  const TemporaryDirectory dir("export");
  const auto run = dir.path() / "run";
  const auto record = [&](const std::vector<Stretch>& plan, std::int64_t from_ms, bool complete) {
    Streams streams;
    Recorder recorder(recorder_options(run), two_sessions());
    run_plan(recorder, streams, plan, 20, from_ms);
    recorder.finish(streams, complete);
  };
  record({{1'000, 0, Keep::kFull}, {1'500, 2, Keep::kFull}}, 0, false);  // stopped in session 1
  record({{3'000, 2, Keep::kFull}}, 2'000, true);                        // session 1 again, whole
  record({{4'100, 2, Keep::kFull}}, 4'000, false);                       // and a third try that was stopped
  const auto report = export_run(run, dir.path() / "out", {});
  ASSERT_EQ(report.sessions.size(), 2U);
  EXPECT_TRUE(report.sessions[0].complete);
  EXPECT_EQ(report.sessions[0].attempt, 1);
  EXPECT_EQ(report.sessions[1].attempt, 2);
  EXPECT_TRUE(report.sessions[1].complete);
  EXPECT_EQ(report.sessions[1].frame_rows, 1'000U);
  EXPECT_EQ(messages::read_recording(report.sessions[1].folder).frame.size(), 1'000U);
}

/// A column of a CSV file of the export; NaN for an empty cell.
std::vector<double> column_of(const std::filesystem::path& file, const std::string& name) {
  std::istringstream in(file_text(file));
  const auto cells = [](const std::string& line) {
    std::vector<std::string> out;
    std::istringstream from(line + ",");  // getline passes over an empty cell at the end
    for (std::string cell; std::getline(from, cell, ',');) out.push_back(cell);
    return out;
  };
  std::string line;
  std::getline(in, line);
  const auto head = cells(line);
  const auto at = static_cast<std::size_t>(std::find(head.begin(), head.end(), name) - head.begin());
  EXPECT_LT(at, head.size()) << name;
  std::vector<double> values;
  while (std::getline(in, line)) {
    const auto cell = cells(line).at(at);
    values.push_back(cell.empty() ? std::numeric_limits<double>::quiet_NaN() : std::stod(cell));
  }
  return values;
}

/// Of the frame's rows in an export, against the device's clock as it truly was.
struct AgainstTruth {
  std::size_t rows = 0, unbounded = 0, outside = 0;
  double worst_ns = 0.0;  ///< the largest error
  double least_bound_ns = std::numeric_limits<double>::infinity(), largest_bound_ns = 0.0;
  double largest_deviation_ns = 0.0;
};

AgainstTruth against_truth(const std::filesystem::path& folder, const std::function<double(double)>& host_ns) {
  const auto mono_ns = column_of(folder / "frame.csv", "mono_ns"),
             bound_ns = column_of(folder / "frame.csv", "bound_ns"),
             device_us = column_of(folder / "frame.csv", "device_us"),
             deviation_ns = column_of(folder / "frame.csv", "repeatability_ns");
  AgainstTruth out;
  out.rows = mono_ns.size();
  for (std::size_t i = 0; i < out.rows; ++i) {
    const double error_ns = std::abs(mono_ns[i] - host_ns(device_us[i]));
    out.worst_ns = std::max(out.worst_ns, error_ns);
    if (!std::isfinite(bound_ns[i])) {
      ++out.unbounded;
      continue;
    }
    // Half a nanosecond each: mono_ns is whole, and so is what is written of the bound.
    if (error_ns > bound_ns[i] + 1.0) ++out.outside;
    out.least_bound_ns = std::min(out.least_bound_ns, bound_ns[i]);
    out.largest_bound_ns = std::max(out.largest_bound_ns, bound_ns[i]);
    out.largest_deviation_ns = std::max(out.largest_deviation_ns, deviation_ns[i]);
  }
  return out;
}

/// A device whose clock is 30 ppm fast, symmetric delays: the truth is known, the online stamps are made
/// wrong.
TEST(Export, RemapsStampsFromTheRecordedExchanges) {
  const TemporaryDirectory dir("export");
  const auto host_ns = [](double device_us) { return device_us * 1e3 * (1.0 - 30e-6) + 7'000'000.0; };
  constexpr std::int64_t kUnbounded = 1'000;  // first rows, from before the map online
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), run_info());
    for (std::int64_t i = 0; i < 60'000; ++i) {
      auto f = frame_record(i, 0, Keep::kFull);
      f.device_us = 1'000'000 + i * 1000;
      // Online, the first half was off by up to 90 us.
      f.mono_ns = std::llround(host_ns(static_cast<double>(f.device_us))) + (i < 30'000 ? (i % 7) * 15'000 : 0);
      if (i < kUnbounded) f.bound_ns = f.repeatability_ns = std::numeric_limits<float>::infinity();
      streams.frame.push(f);
      if (i % 500 == 0) {
        const double at_us = 1'000'000.0 + static_cast<double>(i) * 1000.0;
        ExchangeRecord x;
        x.device = DeviceId::kFrame;
        const auto delay_ns = 250'000 + (i / 500 * 37 % 11) * 20'000;
        x.exchange = {std::llround(host_ns(at_us)) - delay_ns, std::llround(host_ns(at_us)) + delay_ns, at_us, at_us};
        streams.exchanges.push(x);
      }
      if (i % 100 == 0) recorder.drain(streams, i * kMs);
    }
    recorder.finish(streams, true);
  }
  const auto online = export_run(dir.path() / "run", dir.path() / "online", {});
  const auto offline = export_run(dir.path() / "run", dir.path() / "offline", {.remap = true});
  const auto jitter_us = [&](const ExportReport& report) {
    const auto r = messages::read_recording(report.sessions.at(0).folder);
    double worst = 0.0;
    for (std::size_t i = 1; i < r.frame.size(); ++i) {
      worst = std::max(worst, std::abs((r.frame.t_s[i] - r.frame.t_s[i - 1]) * 1e6 - 1000.0 * (1.0 - 30e-6)));
    }
    return worst;
  };
  EXPECT_GT(jitter_us(online), 80.0);
  EXPECT_LT(jitter_us(offline), 2.0);
  EXPECT_GT(offline.sessions.at(0).remap_rms_us, 10.0);
  EXPECT_EQ(offline.sessions[0].kept_online, 0U);
  const auto before = against_truth(online.sessions.at(0).folder, host_ns);
  const auto after = against_truth(offline.sessions.at(0).folder, host_ns);
  EXPECT_EQ(before.unbounded, static_cast<std::size_t>(kUnbounded));
  EXPECT_EQ(before.outside, 0U);
  EXPECT_EQ(after.rows, 60'000U);
  EXPECT_EQ(after.unbounded, 0U) << "the mapping has a bound where the daemon had none";
  EXPECT_EQ(after.outside, 0U);
  // Each way took 250 us at least: nothing in the exchanges can exclude less.
  EXPECT_GT(after.least_bound_ns, 200'000.0);
  EXPECT_LT(after.largest_deviation_ns, 9'000.0) << "less than any online one";
}

/// Requests take 50 us and replies 650 us at least: the mapping is off by their half difference, 300 us, for which its
/// bound of half the least round trip, 350 us, allows. That of the recorded stamps, 200 us, does not.
TEST(Export, ARemappedRowHasTheBoundOfItsMapping) {
  const TemporaryDirectory dir("export");
  const auto host_ns = [](double device_us) { return device_us * 1e3 + 7'000'000.0; };
  constexpr double kOnlineBoundNs = 200'000.0;
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), run_info());
    for (std::int64_t i = 0; i < 20'000; ++i) {
      auto f = frame_record(i, 0, Keep::kFull);
      f.device_us = 1'000'000 + i * 1000;
      f.mono_ns = std::llround(host_ns(static_cast<double>(f.device_us)));
      f.bound_ns = static_cast<float>(kOnlineBoundNs);
      streams.frame.push(f);
      if (i % 500 == 0) {
        const double at_us = 1'000'000.0 + static_cast<double>(i) * 1000.0;
        const auto more_ns = (i / 500 * 37 % 11) * 20'000;
        ExchangeRecord x;
        x.device = DeviceId::kFrame;
        x.exchange = {std::llround(host_ns(at_us)) - 50'000 - more_ns, std::llround(host_ns(at_us)) + 650'000 + more_ns,
                      at_us, at_us};
        streams.exchanges.push(x);
      }
      if (i % 100 == 0) recorder.drain(streams, i * kMs);
    }
    recorder.finish(streams, true);
  }
  const auto offline = export_run(dir.path() / "run", dir.path() / "offline", {.remap = true});
  EXPECT_EQ(offline.sessions.at(0).kept_online, 0U) << "of the two bounds neither excludes the other's time";
  const auto after = against_truth(offline.sessions[0].folder, host_ns);
  EXPECT_GT(after.worst_ns, kOnlineBoundNs) << "the case is none: the recorded bound would do";
  EXPECT_EQ(after.outside, 0U);
  EXPECT_EQ(after.unbounded, 0U);
  EXPECT_GT(after.least_bound_ns, kOnlineBoundNs);
}

/// A frame whose clock and counter begin anew at 20 s, or whose clock steps, in averages and in full; the online stamps
/// are right. Returns the report of an export with remapping, and how far its times are from the truth at worst.
struct AfterBreak {
  ExportReport report;
  double worst_us = 0.0;
  std::size_t rows = 0;
};

AfterBreak export_over_a_break(const std::filesystem::path& dir, Keep keep, double step_us, bool restart,
                               std::int64_t wrong_online_ns = 0) {
  const auto host_ns = [](std::int64_t i) { return i * kMs + 7'000'000; };
  const auto device_us = [&](std::int64_t i) {
    return i < 20'040 ? 31e6 + static_cast<double>(i) * 1e3
           : restart  ? static_cast<double>(i - 20'040) * 1e3
                      : 31e6 + static_cast<double>(i) * 1e3 + step_us;
  };
  auto options = recorder_options(dir / "run");
  options.before_s = 0.0;
  {
    Streams streams;
    Recorder recorder(options, run_info());
    for (std::int64_t i = 0; i < 40'000; ++i) {
      auto f = frame_record(i, 0, keep);
      f.sequence = static_cast<std::uint32_t>(restart && i >= 20'040 ? i - 20'040 : i);
      f.device_us = std::llround(device_us(i));
      f.mono_ns = host_ns(i);
      f.bound_ns = 150'000.0F;
      // Until an exchange tells, the old map goes on: the stamps follow the clock's step.
      if (i >= 20'040 && i < 21'000) f.mono_ns += wrong_online_ns;
      streams.frame.push(f);
      if (i % 500 == 0) {
        ExchangeRecord x;
        x.device = DeviceId::kFrame;
        const auto delay_ns = 100'000 + (i / 500 * 37 % 11) * 2'000;
        x.exchange = {host_ns(i) - delay_ns, host_ns(i) + delay_ns, device_us(i), device_us(i)};
        streams.exchanges.push(x);
      }
      if (i % 100 == 0) recorder.drain(streams, i * kMs);
    }
    recorder.finish(streams, true);
  }
  AfterBreak out;
  out.report = export_run(dir / "run", dir / "out", {.remap = true});
  const auto remapped = messages::read_recording(out.report.sessions.at(0).folder);
  const auto online = messages::read_recording(export_run(dir / "run", dir / "online", {}).sessions.at(0).folder);
  out.rows = remapped.frame.size();
  EXPECT_EQ(out.rows, online.frame.size()) << "rows are gone";
  for (std::size_t i = 0; i < std::min(out.rows, online.frame.size()); ++i) {
    out.worst_us = std::max(out.worst_us, std::abs(remapped.frame.t_s[i] - online.frame.t_s[i]) * 1e6);
  }
  return out;
}

TEST(Export, ARestartedDeviceClockIsMappedByItsParts) {
  for (const auto keep : {Keep::kFull, Keep::kAveraged}) {
    const TemporaryDirectory dir("export");
    const auto result = export_over_a_break(dir.path(), keep, 0.0, true);
    EXPECT_LT(result.worst_us, 300.0) << "an interval over the restart was put seconds away";
    EXPECT_EQ(result.report.sessions[0].not_increasing, 0U);
    EXPECT_GE(result.report.sessions[0].clock_breaks, 1U);
    EXPECT_LE(result.report.sessions[0].kept_online, 1U);
    EXPECT_GT(result.rows, 300U);
  }
}

TEST(Export, ASteppedDeviceClockIsMappedByItsParts) {
  for (const double step_us : {-30e6, 30e6, -50e3, 50e3}) {
    for (const auto keep : {Keep::kFull, Keep::kAveraged}) {
      const TemporaryDirectory dir("export");
      const auto result = export_over_a_break(dir.path(), keep, step_us, false);
      EXPECT_LT(result.worst_us, 300.0) << step_us;
      EXPECT_GE(result.report.sessions[0].clock_breaks, 1U) << step_us;
    }
  }
}

/// Where the online stamps and the exchanges contradict each other nobody can say which is right: nothing is moved, and
/// that is said.
TEST(Export, StampsThatContradictTheExchangesStayAndAreCounted) {
  const TemporaryDirectory dir("export");
  const auto result = export_over_a_break(dir.path(), Keep::kFull, 50e3, false, 50 * kMs);
  EXPECT_LT(result.worst_us, 300.0);
  EXPECT_GE(result.report.sessions[0].kept_online, 19'000U);
}

TEST(Export, EveryFolderSaysInWhichStateTheRecordingWas) {
  const TemporaryDirectory dir("export");
  const auto run = dir.path() / "run";
  auto info = two_sessions();
  info.operator_name = "Ada";
  {
    Streams streams;
    Recorder recorder(recorder_options(run), info);
    run_plan(recorder, streams, kPlan, 20);
    recorder.finish(streams, true);
  }
  const auto further = [&](const ExportReport& report, std::size_t i) {
    return messages::read_recording(report.sessions.at(i).folder).metadata.further_toml;
  };
  const auto whole = export_run(run, dir.path() / "whole", {});
  EXPECT_EQ(whole.read.state(), messages::RecordingState::kWhole);
  EXPECT_THAT(further(whole, 0), HasSubstr("recording_state = 'whole'"));
  EXPECT_THAT(further(whole, 0), HasSubstr("operator = 'Ada'"));

  std::filesystem::remove(run / "segment-0002.lcm");
  ExportOptions closed;
  closed.outcome = "done";
  const auto cut = export_run(run, dir.path() / "cut", closed);
  EXPECT_EQ(cut.read.state(), messages::RecordingState::kDamaged);
  ASSERT_EQ(cut.sessions.size(), 1U) << "what can be read is exported";
  EXPECT_THAT(further(cut, 0), HasSubstr("recording_state = 'damaged'"));
  EXPECT_THAT(further(cut, 0), HasSubstr("segment-0002.lcm is missing"));
  EXPECT_THAT(cut.read.complaints(), ::testing::Contains(HasSubstr("the catalogue has the run as done")));
}

TEST(Export, EveryFolderHasTheStepsTheEventsAndTheLossesOfItsSession) {
  const TemporaryDirectory dir("export");
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), two_sessions());
    streams.events.push(event_record(0, 0, "mark", Severity::kInfo));
    run_plan(recorder, streams, {kPlan[0]}, 20);
    streams.events.push(event_record(2'600, 1, "reconnect.frame", Severity::kWarning));
    for (std::int64_t i = 2'600; i < 4'000; ++i) push_ms(streams, i, kPlan[1]);  // 100 ms of both are missing
    recorder.drain(streams, 4'000 * kMs);
    run_plan(recorder, streams, {kPlan[2]}, 20, 4'000);
    recorder.finish(streams, true);
  }
  const auto report = export_run(dir.path() / "run", dir.path() / "out", {});
  ASSERT_EQ(report.sessions.size(), 2U);
  const auto text = [&](std::size_t i) {
    return messages::read_recording(report.sessions[i].folder).metadata.further_toml;
  };
  const auto first = toml::parse(text(0)), second = toml::parse(text(1));
  ASSERT_EQ(first["steps"].as_array()->size(), 2U) << text(0);
  EXPECT_EQ(first["steps"][0]["mark"].value_or(std::string()), "at sample 0");
  EXPECT_EQ(first["steps"][1]["do"].value_or(std::string()), "at sample 0");
  ASSERT_EQ(first["events"].as_array()->size(), 1U) << text(0);
  EXPECT_EQ(first["events"][0]["code"].value_or(std::string()), "reconnect.frame");
  EXPECT_EQ(first["events"][0]["severity"].value_or(std::string()), "warning");
  // In the recording's own time: the event came 1 ns behind the first sample after the gap.
  const auto r = messages::read_recording(report.sessions[0].folder);
  const auto after =
      std::adjacent_find(r.frame.t_s.begin(), r.frame.t_s.end(), [](double a, double b) { return b - a > 0.1005; });
  ASSERT_NE(after, r.frame.t_s.end());
  EXPECT_NEAR(first["events"][0]["t_s"].value_or(0.0), *(after + 1), 2e-3);
  EXPECT_EQ(first["missing"]["frame_samples"].value_or(-1), 100);
  EXPECT_EQ(first["missing"]["pressure_samples"].value_or(-1), 100);
  EXPECT_EQ(second["missing"]["frame_samples"].value_or(-1), 0) << "the recorder counts over the attempt";
  EXPECT_EQ(second["steps"].as_array()->size(), 1U);
  EXPECT_FALSE(second.contains("events"));
}

TEST(Export, ASessionWithPressureAloneIsNamed) {
  const TemporaryDirectory dir("export");
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), two_sessions());
    run_plan(recorder, streams, {{1'000, 0, Keep::kFull}}, 20);
    for (std::int64_t i = 1'000; i < 2'000; ++i) {
      streams.pressure.push(pressure_record(i, 2, Keep::kFull));
      if (i % 20 == 0) recorder.drain(streams, i * kMs);
    }
    recorder.finish(streams, true);
  }
  std::size_t measured = 0;
  for (std::int64_t i = 1'000; i < 2'000; ++i) measured += pressure_record(i, 2, Keep::kFull).status == 0;
  for (const auto format : {ExportFormat::kCsv, ExportFormat::kHdf5, ExportFormat::kMat}) {
    const auto report = export_run(dir.path() / "run", dir.path() / "out", {.format = format});
    ASSERT_EQ(report.sessions.size(), 1U);
    EXPECT_EQ(report.sessions[0].name, "rep-1_05-psi");
    ASSERT_EQ(report.skipped.size(), 1U);
    EXPECT_EQ(report.skipped[0].session, 1);
    EXPECT_EQ(report.skipped[0].pressure_rows, measured);
    EXPECT_THAT(report.skipped[0].why,
                HasSubstr("rep-1_10-psi is left out: it has " + std::to_string(measured) + " rows of pressure"));
  }
  // A session that has not begun is not left out.
  const TemporaryDirectory whole("export");
  {
    Streams streams;
    Recorder recorder(recorder_options(whole.path() / "run"), two_sessions());
    run_plan(recorder, streams, {{1'000, 0, Keep::kFull}}, 20);
    recorder.finish(streams, false);
  }
  EXPECT_TRUE(export_run(whole.path() / "run", whole.path() / "out", {}).skipped.empty());
}

/// Session 1 begins in the tick in which session 0 ends; its first samples, stamped before that tick, are in the log
/// already when the end comes. Recorded, and as a logger of the live channels has it.
TEST(Export, TheEndOfASessionIsAnEventOfThatSession) {
  const TemporaryDirectory dir("export");
  constexpr std::int64_t kEnd = 2'000;
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), two_sessions());
    const auto tell = [&](std::int64_t ms, std::uint32_t step, const char* code, const char* text) {
      auto e = event_record(ms, step, code, Severity::kInfo);
      std::snprintf(e.text, sizeof e.text, "%s", text);
      streams.events.push(e);
    };
    tell(0, 0, "session.start", "repetition 1, 5 psi");
    run_plan(recorder, streams, {{kEnd - 2, 0, Keep::kFull}}, 20);
    run_plan(recorder, streams, {{kEnd, 2, Keep::kFull}}, 20, kEnd - 2);  // in the slice before that of the end
    tell(kEnd, 1, "session.end", "repetition 1, 5 psi");
    tell(kEnd, 2, "session.start", "repetition 1, 10 psi");
    run_plan(recorder, streams, {{4'000, 2, Keep::kFull}}, 20, kEnd);
    tell(4'000, 2, "session.end", "repetition 1, 10 psi");
    recorder.finish(streams, true);
  }
  const auto segments = messages::list_segments(dir.path() / "run");
  ASSERT_EQ(segments.size(), 2U);
  EXPECT_THAT(file_text(segments[1]), HasSubstr("session.end")) << "the case is none: the end came before the samples";
  const auto sessions_told = [](const std::filesystem::path& folder) {
    std::vector<std::string> told;
    std::istringstream in(file_text(folder / "events.csv"));
    for (std::string line; std::getline(in, line);) {
      if (const auto at = line.find("session."); at != std::string::npos) told.push_back(line.substr(at));
    }
    return told;
  };
  const auto recorded = export_run(dir.path() / "run", dir.path() / "out", {});
  ASSERT_EQ(recorded.read.state(), messages::RecordingState::kWhole)
      << ::testing::PrintToString(recorded.read.complaints());
  {
    const auto both = file_text(dir.path() / "run" / "segment-0001.lcm") + file_text(segments[1]);
    std::ofstream(dir.path() / "both.lcm", std::ios::binary) << both;
  }
  as_live_log(dir.path() / "both.lcm", dir.path() / "live.lcm");
  const auto live = export_run(dir.path() / "live.lcm", dir.path() / "live", {.specimen = "M1"});
  for (const auto* report : {&recorded, &live}) {
    ASSERT_EQ(report->sessions.size(), 2U);
    const auto first = sessions_told(report->sessions[0].folder), second = sessions_told(report->sessions[1].folder);
    EXPECT_THAT(first, ::testing::ElementsAre(::testing::StartsWith("session.start,\"repetition 1, 5 psi\""),
                                              ::testing::StartsWith("session.end,\"repetition 1, 5 psi\"")));
    EXPECT_THAT(second, ::testing::ElementsAre(::testing::StartsWith("session.start,\"repetition 1, 10 psi\""),
                                               ::testing::StartsWith("session.end,\"repetition 1, 10 psi\"")));
  }
}

}  // namespace
}  // namespace isorig::daemon::testing
