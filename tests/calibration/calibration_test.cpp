#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <random>

#include "base/toml_reader.hpp"
#include "calibration/date.hpp"
#include "calibration/store.hpp"

namespace isorig::calibration {
namespace {

using ::testing::HasSubstr;

/// A sensor that reads raw = (reference - offset) / scale + noise, so that `truth` is what has to be found.
std::vector<Point> readings(Correction truth, const std::vector<double>& references, double noise = 0.0,
                            unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, 1.0);
  std::vector<Point> points;
  for (const double f : references)
    points.push_back({f, (f - truth.offset) / truth.scale + noise * normal(random), noise, 0.0});
  return points;
}

template <typename Call>
std::string refusal(Call&& call) {
  try {
    call();
  } catch (const std::exception& e) {
    return e.what();
  }
  return "was not refused";
}

class Folder {
 public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "isorig-calibration-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary directory");
    path = name;
  }
  ~Folder() { std::filesystem::remove_all(path); }
  std::filesystem::path path;
};

Record record_of(const std::string& made_utc, const std::vector<Point>& points, Correction before = {},
                 const std::string& supersedes = "", Mode mode = Mode::kAdjust) {
  Record r;
  r.rig = "bench";
  r.made_utc = made_utc;
  r.id = record_id(made_utc, r.channel);
  r.mode = mode;
  r.due = later(made_utc.substr(0, 10), 365);
  r.operator_name = "R. Hooke";
  r.supersedes = supersedes;
  r.reference = {"gauge-7", "K-2026-1", "2027-05-01", 0.01};
  r.before = before;
  r.points = points;
  r.result = calibrate(r.channel, mode, points, before, r.reference.uncertainty);
  return r;
}

const std::vector<double> kUpAndDown = {0, 5, 10, 15, 20, 15, 10, 5, 0};

TEST(CalibrationFit, FindsZeroAndSpanWithinWhatTheNoiseAllows) {
  // 400 calibrations with 0.005 psi of noise in a mean. Standard errors of a straight line through 9 points:
  // span s / sqrt(Sxx), zero s sqrt(1/n + mean^2 / Sxx).
  const Correction truth{1.012, -0.15};
  const double noise = 0.005;
  double sxx = 0.0;
  const double mean = 80.0 / 9.0;
  for (const double f : kUpAndDown) sxx += (f - mean) * (f - mean);
  const double span_error = noise / std::sqrt(sxx), zero_error = noise * std::sqrt(1.0 / 9.0 + mean * mean / sxx);
  int covered = 0;
  double span2 = 0.0, zero2 = 0.0;
  for (unsigned seed = 1; seed <= 400; ++seed) {
    const auto r = calibrate(Channel::kPressure, Mode::kAdjust, readings(truth, kUpAndDown, noise, seed), {}, 0.0);
    span2 += std::pow(r.correction.scale - truth.scale, 2) / 400.0;
    zero2 += std::pow(r.correction.offset - truth.offset, 2) / 400.0;
    // What is stated for one reading has to cover one reading.
    const auto again = readings(truth, {12.0}, noise, seed + 1000)[0];
    covered += std::abs(r.correction.apply(again.raw) - 12.0) <= r.uncertainty ? 1 : 0;
  }
  // The rms of 400 is within 10 % (3 sigma = 3 / sqrt(800)) of the derived value, and the raw scale adds 1 %.
  EXPECT_NEAR(std::sqrt(span2), span_error, 0.13 * span_error);
  EXPECT_NEAR(std::sqrt(zero2), zero_error, 0.13 * zero_error);
  EXPECT_GT(covered, 380);  // k = 2: 95 % or more
}

TEST(CalibrationFit, SaysWhatWasFoundWhatIsLeftAndWhetherTheSensorWasInItsBand) {
  const auto points = readings({1.0, -0.4}, kUpAndDown);  // reads 0.4 psi too much; DS-0376 allows 0.3
  const auto r = calibrate(Channel::kPressure, Mode::kAdjust, points, {}, 0.01);
  EXPECT_NEAR(r.as_found_max, 0.4, 1e-12);
  EXPECT_NEAR(r.as_found[3], 0.4, 1e-12);
  EXPECT_FALSE(r.found_in_band);
  EXPECT_LT(r.as_left_max, 1e-12);
  EXPECT_TRUE(calibrate(Channel::kPressure, Mode::kAdjust, readings({1.0, -0.2}, kUpAndDown), {}, 0.01).found_in_band);
  // With nothing else, U = 2 sqrt((0.01/2)^2 + q^2/12).
  const double q = 30.0 / 13108.0;
  EXPECT_NEAR(r.uncertainty, 2.0 * std::sqrt(0.005 * 0.005 + q * q / 12.0), 1e-9);
}

TEST(CalibrationFit, TellsUpFromDown) {
  auto points = readings({}, kUpAndDown);
  for (std::size_t i = 5; i < 8; ++i) points[i].raw += 0.06;  // on the way down, but for the end at zero
  const auto r = calibrate(Channel::kPressure, Mode::kCheck, points, {}, 0.0);
  ASSERT_TRUE(r.hysteresis);
  EXPECT_NEAR(*r.hysteresis, 0.06, 1e-12);
  EXPECT_GE(r.uncertainty, r.as_found_max);  // a check leaves its error to the user
  EXPECT_FALSE(calibrate(Channel::kPressure, Mode::kAdjust, readings({}, {0, 10, 20}), {}, 0.0).hysteresis);
}

TEST(CalibrationFit, ZeroKeepsTheSpan) {
  const auto r = calibrate(Channel::kForce, Mode::kZero, readings({1.0, 0.25}, {0.0}), {1.02, 0.0}, 0.0);
  EXPECT_EQ(r.correction.scale, 1.02);
  EXPECT_NEAR(r.correction.apply(-0.25), 0.0, 1e-12);
}

TEST(CalibrationFit, AGaugeBlockChangesTheSpanAndNotTheZeroOfTheSpecimen) {
  const Correction before{1.0, 3.0};  // the specimen's zero is at raw -3
  const auto r = calibrate(Channel::kPosition, Mode::kAdjust, readings({1.01, -7.0}, {0, 10, 10, 0}), before, 0.001);
  EXPECT_NEAR(r.correction.scale, 1.01, 1e-12);
  EXPECT_NEAR(r.correction.apply(-3.0), 0.0, 1e-12);
  EXPECT_NEAR(r.as_found_max, 10.0 - 10.0 / 1.01, 1e-12);  // of the block's length
  EXPECT_LT(r.as_left_max, 1e-12);
  EXPECT_THAT(refusal([] { (void)calibrate(Channel::kPosition, Mode::kZero, readings({}, {0.0}), {}, 0.0); }),
              HasSubstr("belongs to the specimen"));
}

TEST(CalibrationFit, ForceClasses) {
  // Three rising series and a falling one; +0.8 % everywhere, the second series 0.3 % higher, falling 0.4 % higher.
  std::vector<Point> points;
  const auto add = [&](double factor, const std::vector<double>& levels) {
    for (const double f : levels) points.push_back({f, f * factor, 0.0, 0.0});
  };
  const std::vector<double> up = {0, 20, 40, 60, 80, 100};
  add(1.008, up);
  add(1.011, up);
  add(1.008, up);
  add(1.013, {80, 60, 40, 20, 0});
  const auto r = calibrate(Channel::kForce, Mode::kCheck, points, {}, 0.0);
  ASSERT_TRUE(r.class_found);
  const auto& f = *r.class_found;
  EXPECT_NEAR(f.error_percent, 0.9, 1e-9);
  EXPECT_NEAR(*f.repeatability_percent, 0.3, 1e-9);
  EXPECT_NEAR(*f.reversibility_percent, 0.4, 1e-9);
  EXPECT_EQ(f.series, 3);
  EXPECT_EQ(f.levels, 5);
  EXPECT_EQ(f.text, "1");
  EXPECT_EQ(calibrate(Channel::kForce, Mode::kAdjust, points, {}, 0.0).class_left->text, "0.5");
  for (auto& p : points) p.raw *= 1.03;
  EXPECT_EQ(calibrate(Channel::kForce, Mode::kCheck, points, {}, 0.0).class_found->text, "none");
}

TEST(CalibrationFit, RefusesWhatIsNoCalibration) {
  const auto pressure = [](const std::vector<Point>& points, Mode mode = Mode::kAdjust) {
    return refusal([&] { (void)calibrate(Channel::kPressure, mode, points, {}, 0.0); });
  };
  EXPECT_THAT(pressure({}), HasSubstr("no point"));
  EXPECT_THAT(pressure(readings({}, {0, 20, 20.1, 0.1})), HasSubstr("3 levels or more, and there are 2"));
  EXPECT_THAT(pressure({{0, 1, 0, 0}, {10, 1, 0, 0}, {20, 1, 0, 0}}), HasSubstr("did not change"));
  EXPECT_THAT(pressure(readings({1.2, 0}, {0, 10, 20})), HasSubstr("wrong unit"));
  EXPECT_THAT(pressure(readings({1.0, 2.0}, {0, 10, 20})), HasSubstr("from the reference"));
  EXPECT_THAT(pressure({{std::nan(""), 0, 0, 0}}, Mode::kCheck), HasSubstr("not a number"));
}

TEST(CalibrationDate, KnowsTheCalendar) {
  EXPECT_EQ(days_of("1970-01-02"), 1);
  EXPECT_EQ(later("2027-12-31", 60), "2028-02-29");
  for (const auto* wrong : {"2027-02-29", "2027-13-01", "27-01-01", "2027/01/01", "2027-01-0x", ""}) {
    EXPECT_FALSE(days_of(wrong)) << wrong;
  }
}

TEST(CalibrationRecord, ReadsBackAsWritten) {
  const auto r = record_of("2026-11-21T07:15:00Z", readings({1.01, -0.1}, kUpAndDown, 0.003), {1.0, 0.05});
  const auto again = parse_record(to_toml(r), "x.toml");
  EXPECT_EQ(again.id, "20261121-071500-pressure");
  EXPECT_EQ(again.due, "2027-11-21");
  EXPECT_EQ(again.operator_name, "R. Hooke");
  EXPECT_EQ(again.reference.certificate_due, "2027-05-01");
  EXPECT_EQ(again.points.size(), 9U);
  EXPECT_DOUBLE_EQ(again.result.correction.scale, r.result.correction.scale);
  EXPECT_DOUBLE_EQ(again.result.uncertainty, r.result.uncertainty);
  EXPECT_FALSE(again.overdue("2027-11-21"));
  EXPECT_TRUE(again.overdue("2027-11-22"));
}

TEST(CalibrationRecord, SaysAllThatIsWrong) {
  auto text = to_toml(record_of("2026-11-21T07:15:00Z", readings({1.01, -0.1}, kUpAndDown)));
  const auto replace = [&](const std::string& from, const std::string& to) {
    auto changed = text;
    const auto at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) changed.replace(at, from.size(), to);
    return refusal([&] { (void)parse_record(changed, "x.toml"); });
  };
  EXPECT_THAT(replace("scale = 1.01", "scale = 1.02"), HasSubstr("changed after it was made"));
  EXPECT_THAT(replace("due = '2027-11-21'", "due = '21.11.2027'"), HasSubstr("a date is written"));
  EXPECT_THAT(replace("operator = 'R. Hooke'", "operator = \"a\\u001b[31m\""), HasSubstr("control characters"));
  for (const char* nobody : {"operator = ''", "operator = ' '"})
    EXPECT_THAT(replace("operator = 'R. Hooke'", nobody), HasSubstr("name who calibrated"));
  EXPECT_THAT(replace("unit = 'psi'", "unit = 'bar'"), HasSubstr("`unit` has to be"));
}

TEST(CalibrationStore, TheNewestIsInForceAndNothingIsReplaced) {
  const Folder folder;
  const auto directory = folder.path / "calibration" / "bench";
  Store store(directory, {Correction{1.0, 0.05}, Correction{}, Correction{}});
  EXPECT_EQ(store.in_force(Channel::kPressure).record, nullptr);
  EXPECT_EQ(store.in_force(Channel::kPressure).correction.offset, 0.05);

  const auto first = record_of("2026-11-21T07:15:00Z", readings({1.01, -0.1}, kUpAndDown), {1.0, 0.05});
  store.add(first);
  EXPECT_THAT(refusal([&] { store.add(first); }), HasSubstr("somebody calibrated meanwhile"));
  const auto second =
      record_of("2027-11-20T07:15:00Z", readings({1.01, -0.12}, {0.0}), first.result.correction, first.id, Mode::kZero);
  store.add(second);
  auto other = record_of("2027-11-21T07:15:00Z", readings({1.01, -0.1}, kUpAndDown), {1.0, 0.05}, second.id);
  EXPECT_THAT(refusal([&] { store.add(other); }), HasSubstr("another correction"));

  const Store again(directory, {});
  ASSERT_EQ(again.records().size(), 2U);
  const auto in_force = again.in_force(Channel::kPressure);
  EXPECT_EQ(in_force.record->id, second.id);
  EXPECT_NEAR(in_force.correction.offset, -0.12, 1e-12);
  EXPECT_EQ(in_force.record->supersedes, first.id);
  EXPECT_TRUE(again.overdue("2028-11-19").empty());
  ASSERT_EQ(again.overdue("2028-11-20").size(), 1U);
  EXPECT_THAT(again.overdue("2028-11-20")[0], HasSubstr("was due on 2028-11-19"));
  EXPECT_THAT(again.toml(), HasSubstr(second.id));

  // A file is there although the store does not know it: it stays what it is.
  auto third = record_of("2028-01-01T00:00:00Z", readings({1.01, -0.1}, kUpAndDown), in_force.correction, second.id);
  std::ofstream(directory / (third.id + ".toml")) << "somebody else's";
  EXPECT_THAT(refusal([&] { store.add(third); }), HasSubstr("never replaced"));
  EXPECT_THAT(refusal([&] { (void)Store(directory, {}); }), HasSubstr(third.id));  // and it is not passed over
}

}  // namespace
}  // namespace isorig::calibration
