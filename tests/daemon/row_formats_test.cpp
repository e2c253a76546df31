#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/inotify.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <random>
#include <sstream>

#include "daemon/export/export.hpp"
#include "daemon/export/rows.hpp"
#include "daemon/export/streams.hpp"
#include "recording_rig.hpp"

namespace isorig::daemon::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

/// Steps 0, 1 and 2 of it are those of the records: filling, a ramp in full, rest.
constexpr const char* kProtocol = R"(
format = "isorig-protocol/1"
name = "three"
recording.policy = "averaged"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = -2, velocity_mm_s = 4 },
  { do = "hold", duration_s = 2 },
]
)";

void record(const std::filesystem::path& run) {
  auto info = run_info();
  info.sessions = {{0, 1, 5.0, 118.25}};
  info.texts[0].second = kProtocol;
  info.texts.emplace_back("calibration.toml", "[position]\nid = \"p-1\"\nscale = 1.25\noffset = 0.5\n");
  Streams streams;
  Recorder recorder(recorder_options(run), info);
  run_plan(recorder, streams, {{2'000, 0, Keep::kAveraged}, {40'000, 1, Keep::kFull}, {42'000, 2, Keep::kAveraged}},
           20);
  recorder.finish(streams, true);
}

std::vector<std::string> lines_of(const std::filesystem::path& file) {
  std::vector<std::string> lines;
  std::istringstream in(file_text(file));
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

TEST(ExportFormats, TheColumnsSayWhoseBoundTheyGive) {
  for (const auto stream : {Stream::kFrame, Stream::kPressure}) {
    for (const bool remapped : {false, true}) {
      StreamOrigin origin;
      origin.remapped = remapped;
      int told = 0;
      for (const auto& column : schema_of(stream, origin).columns) {
        if (column.name != "bound_ns" && column.name != "repeatability_ns") continue;
        EXPECT_THAT(column.description, HasSubstr(remapped ? "of the offline mapping, or" : "of the online mapping"));
        ++told;
      }
      EXPECT_EQ(told, 2);
    }
  }
}

TEST(ExportFormats, CsvHasTheTablesOfTheProtocol) {
  const TemporaryDirectory dir("formats");
  record(dir.path() / "run");
  const auto report = export_run(dir.path() / "run", dir.path() / "out", {.run_id = "r"});
  ASSERT_EQ(report.sessions.size(), 1U);
  const auto folder = dir.path() / "out" / "rep-1_5-psi";
  const auto frame = lines_of(folder / "frame.csv");
  EXPECT_EQ(frame[0],
            "t_s,position_mm,force_N,position_min_mm,position_max_mm,force_min_N,force_max_N,averaged,samples,step,"
            "mono_ns,bound_ns,repeatability_ns,device_us,sequence");
  EXPECT_EQ(frame.size(), 1 + report.sessions[0].frame_rows);
  EXPECT_GT(frame.size(), 2 * kBlockRows) << "several blocks";
  EXPECT_THAT(frame[1], HasSubstr(",1,100,0,"));  // averaged, 100 samples, step 0
  EXPECT_THAT(frame[20'000], HasSubstr(",,,,,0,1,1,"));
  // A ramp of the third step's words; times from the session's first sample, 137 ns and half an interval in.
  const auto ramps = lines_of(folder / "ramps.csv");
  ASSERT_EQ(ramps.size(), 2U);
  EXPECT_EQ(ramps[0], "step,t_start_s,t_end_s,complete,from_mm,to_mm,velocity_mm_s,strain_rate_per_s,pressure_psi");
  EXPECT_THAT(ramps[1], StartsWith("1,1.95"));
  EXPECT_THAT(ramps[1], HasSubstr(",1,0,-2,-4,-0.033826638,5"));  // -4 mm/s over 118.25 mm
  const auto steps = lines_of(folder / "steps.csv");
  ASSERT_EQ(steps.size(), 4U);
  EXPECT_THAT(steps[2], HasSubstr(",ramp,ramp to -2 mm at 4 mm/s,"));
  EXPECT_EQ(lines_of(folder / "holds.csv").size(), 2U);
  EXPECT_THAT(lines_of(folder / "sessions.csv"),
              ElementsAre(StartsWith("name,session,"), StartsWith("rep-1_5-psi,0,1,1,5,118.25,1,")));
  EXPECT_GT(lines_of(folder / "setpoints.csv").size(), 3'000U);
}

TEST(ExportFormats, ANotedSpecimenCountsWithItsOwnLengthsOrNone) {
  const TemporaryDirectory dir("formats");
  record(dir.path() / "run");
  const auto exported = [&](const ExportOptions::Noted& noted) {
    (void)export_run(dir.path() / "run", dir.path() / "out", {.noted = noted});
    return messages::read_recording(dir.path() / "out" / "rep-1_5-psi").metadata;
  };
  const auto other = exported({"Other", 150.0, [](double psi) { return 150.0 - psi; }});
  EXPECT_EQ(other.specimen, "Other");
  EXPECT_EQ(other.rest_length_mm, 150.0);
  EXPECT_EQ(other.pressurized_rest_length_mm, 145.0);
  const auto unknown = exported({.specimen = "Other"});
  EXPECT_EQ(unknown.specimen, "Other");
  EXPECT_FALSE(unknown.rest_length_mm || unknown.pressurized_rest_length_mm) << "lengths of the recorded specimen";
}

TEST(ExportFormats, LeanIsTheRecordingFormatAlone) {
  const TemporaryDirectory dir("formats");
  record(dir.path() / "run");
  (void)export_run(dir.path() / "run", dir.path() / "out", {.lean = true});
  const auto folder = dir.path() / "out" / "rep-1_5-psi";
  EXPECT_EQ(lines_of(folder / "frame.csv")[0], "t_s,position_mm,force_N");
  EXPECT_EQ(lines_of(folder / "pressure.csv")[0], "t_s,pressure_psi");
  EXPECT_FALSE(std::filesystem::exists(folder / "steps.csv"));
  // Nor does a table of an earlier export stay beside it.
  (void)export_run(dir.path() / "run", dir.path() / "out", {});
  EXPECT_TRUE(std::filesystem::exists(folder / "steps.csv"));
  (void)export_run(dir.path() / "run", dir.path() / "out", {.lean = true});
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) names.push_back(entry.path().filename());
  EXPECT_THAT(names, ::testing::UnorderedElementsAre("frame.csv", "pressure.csv", "recording.toml"));
}

TEST(ExportFormats, RecordingTomlComesLastAndAFailureLeavesNothingNew) {
  const TemporaryDirectory dir("formats");
  record(dir.path() / "run");
  const auto out = dir.path() / "out", folder = out / "rep-1_5-psi";
  (void)export_run(dir.path() / "run", out, {.run_id = "r"});
  const auto earlier = file_text(folder / "recording.toml") + "# earlier\n";
  std::ofstream(folder / "recording.toml") << earlier;
  // A folder in the place of the last table.
  std::filesystem::remove(folder / "events.csv");
  std::filesystem::create_directories(folder / "events.csv" / "x");
  std::ofstream(folder / "frame.csv") << "earlier\n";
  EXPECT_THROW((void)export_run(dir.path() / "run", out, {.run_id = "r"}), std::runtime_error);
  EXPECT_EQ(file_text(folder / "recording.toml"), earlier);
  EXPECT_EQ(file_text(folder / "frame.csv"), "earlier\n");
  for (const auto& entry : std::filesystem::directory_iterator(folder)) EXPECT_NE(entry.path().extension(), ".new");
}

/// Whoever is killed in between, or reads meanwhile: while streams and tables are replaced there is no recording.toml.
TEST(ExportFormats, BetweenTwoExportsThereIsNoRecording) {
  const TemporaryDirectory dir("formats");
  record(dir.path() / "run");
  const auto folder = dir.path() / "out" / "rep-1_5-psi";
  (void)export_run(dir.path() / "run", dir.path() / "out", {.run_id = "r"});
  const int watch = ::inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
  ASSERT_GE(::inotify_add_watch(watch, folder.c_str(), IN_DELETE | IN_MOVED_TO), 0);
  (void)export_run(dir.path() / "run", dir.path() / "out", {.run_id = "r"});
  alignas(inotify_event) char buffer[8192];
  const auto got = ::read(watch, buffer, sizeof buffer);
  ::close(watch);
  std::vector<std::string> seen;
  for (::ssize_t at = 0; at < got;) {
    const auto* event = reinterpret_cast<const inotify_event*>(buffer + at);
    const std::string name = event->name;
    // recording.toml is written aside twice over: messages::write_recording_toml() does so too.
    if (name.find(".new") == std::string::npos) seen.push_back((event->mask & IN_DELETE ? "-" : "+") + name);
    at += static_cast<::ssize_t>(sizeof(inotify_event) + event->len);
  }
  ASSERT_GE(seen.size(), 4U);
  EXPECT_EQ(seen.front(), "-recording.toml");
  EXPECT_EQ(seen.back(), "+recording.toml");
  EXPECT_THAT(seen, ::testing::Contains("+frame.csv"));
}

TEST(ExportFormats, MeansHaveADecimalMoreThanReadings) {
  StreamOrigin origin;
  origin.position_step = 1e-3;
  origin.calibration = toml::parse("[position]\n\"valid-until\" = \"2027\"");
  const auto schema = schema_of(Stream::kFrame, origin);
  EXPECT_EQ(schema.columns[1].decimals, 5);  // position_mm
  EXPECT_EQ(schema.columns[3].decimals, 4);  // position_min_mm: a reading
  EXPECT_THAT(schema.columns[1].attributes,
              ::testing::Contains(::testing::Pair("calibration_valid_until", Attribute(std::string("2027")))))
      << "no field of a MAT struct has a '-'";
  Table block(schema);
  Row row;
  row.value = {1.234567, 0.0, 1.234567, 1.234567, 0.0, 0.0};
  fill(block, Stream::kFrame, row, 0);
  row.averaged = true;
  fill(block, Stream::kFrame, row, 0);
  EXPECT_THAT(block.cells()[1].real, ElementsAre(1.2346, 1.23457));
  EXPECT_THAT(block.cells()[3].real, ElementsAre(1.2346, 1.2346));
}

/// What is in them the system test asks their own readers; here the writers run under the sanitizers.
TEST(ExportFormats, Hdf5AndMatAreWrittenWholeOrNotAtAll) {
  const TemporaryDirectory dir("formats");
  record(dir.path() / "run");
  const auto out = dir.path() / "out";
  for (const auto format : {ExportFormat::kHdf5, ExportFormat::kMat}) {
    const auto report = export_run(dir.path() / "run", out, {.format = format, .run_id = "r"});
    EXPECT_EQ(report.sessions.at(0).name, "rep-1_5-psi");
  }
  const auto hdf5 = file_text(out / "r.h5"), mat = file_text(out / "r" / "rep-1_5-psi.mat");
  EXPECT_THAT(hdf5.substr(0, 8), StartsWith("\x89HDF\r\n"));
  EXPECT_THAT(mat.substr(0, 40), StartsWith("MATLAB 5.0 MAT-file, isorig-export/1"));
  // No dates: again gives the same.
  for (const auto format : {ExportFormat::kHdf5, ExportFormat::kMat}) {
    (void)export_run(dir.path() / "run", dir.path() / "again", {.format = format, .run_id = "r"});
  }
  EXPECT_TRUE(file_text(dir.path() / "again" / "r.h5") == hdf5);
  EXPECT_TRUE(file_text(dir.path() / "again" / "r" / "rep-1_5-psi.mat") == mat);
  // A folder in the place of the file: nothing is left beside it.
  for (const auto format : {ExportFormat::kHdf5, ExportFormat::kMat}) {
    const auto taken = dir.path() / "taken";
    std::filesystem::create_directories(taken / "r.h5" / "x");
    std::filesystem::create_directories(taken / "r" / "rep-1_5-psi.mat" / "x");
    EXPECT_THROW((void)export_run(dir.path() / "run", taken, {.format = format, .run_id = "r"}), std::runtime_error);
    EXPECT_FALSE(std::filesystem::exists(taken / "r.h5.new"));
    EXPECT_FALSE(std::filesystem::exists(taken / "r" / "rep-1_5-psi.mat.new"));
  }
}

TEST(RowOrder, BringsLateRowsIntoTheOrderOfTime) {
  constexpr std::int64_t kLate_ns = 50'000'000;
  std::mt19937_64 random(7);
  std::uniform_int_distribution<std::int64_t> late(0, kLate_ns);
  std::vector<std::pair<std::int64_t, std::int64_t>> arrivals;  // when it comes, its time
  for (std::int64_t i = 0; i < 100'000; ++i) arrivals.emplace_back(i * kMs + late(random), i * kMs);
  std::sort(arrivals.begin(), arrivals.end());
  RowOrder order(kLate_ns);
  std::vector<std::int64_t> out;
  std::size_t most = 0;
  const auto take = [&](bool all) { order.take(all, [&](const Row& r) { out.push_back(r.mono_ns); }); };
  std::size_t came = 0;
  for (const auto& arrival : arrivals) {
    Row r;
    r.mono_ns = arrival.second;
    order.add(r);
    if (order.due()) take(false);
    most = std::max(most, ++came - out.size());
  }
  take(true);
  ASSERT_EQ(out.size(), arrivals.size());
  for (std::size_t i = 0; i < out.size(); ++i) ASSERT_EQ(out[i], static_cast<std::int64_t>(i) * kMs);
  EXPECT_EQ(order.moved(), 0U);
  EXPECT_LE(most, 2 * kBlockRows) << "memory grows with the recording";
}

TEST(RowOrder, ARowThatIsMovedHasABoundWiderByAsMuch) {
  RowOrder order(0);
  for (int i = 0; i < 3; ++i) {
    Row r;
    r.mono_ns = 1'000;
    r.bound_ns = 100.0;
    order.add(r);
  }
  std::vector<std::pair<std::int64_t, double>> out;
  order.take(true, [&](const Row& r) { out.emplace_back(r.mono_ns, r.bound_ns); });
  EXPECT_THAT(out, ElementsAre(std::pair(1'000, 100.0), std::pair(1'002, 102.0), std::pair(1'004, 104.0)));
}

TEST(Table, RoundsToTheNearestDecimalAndKeepsWhatItCannotRound) {
  EXPECT_EQ(rounded(1.23456, 3), 1.235);
  EXPECT_EQ(rounded(-0.0000049, 5), 0.0);
  EXPECT_EQ(rounded(1e300, 9), 1e300);
  EXPECT_TRUE(std::isnan(rounded(std::nan(""), 3)));
  EXPECT_EQ(decimals_for(1e-3), 4);
  EXPECT_EQ(decimals_for(9.93e-4), 4) << "a thousandth that was kept in 24 bits";
  EXPECT_EQ(decimals_for(2.2887e-3), 4);
  EXPECT_EQ(decimals_for(0.0), 9);
  Table t({"t", "", {{"a", ColumnType::kReal, "", ""}, {"b", ColumnType::kText, "", ""}}});
  t.real(1.0);
  EXPECT_THROW(t.end_row(), std::logic_error);
}

}  // namespace
}  // namespace isorig::daemon::testing
