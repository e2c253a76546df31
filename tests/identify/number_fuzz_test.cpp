#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "identify/fv/fv_analysis.hpp"
#include "identify/fv/fv_report.hpp"
#include "iso_velocity_recording.hpp"
#include "messages/csv.hpp"

/// Every number that a file can hold, through the readers and `isorig fv`'s analysis: refused with its place, or
/// survived with finite results.
namespace isorig::identify {
namespace {

namespace fs = std::filesystem;

class NumberFuzz : public ::testing::Test {
 protected:
  fs::path folder_ = fs::path(::testing::TempDir()) /
                     (std::string("number-fuzz-") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
  void SetUp() override {
    testing::IsoVelocityTest test;
    test.speeds_mm_s = {2, 10};
    test.precondition = false;
    test.hold_s = 3.0;
    test.return_speed_mm_s = 2.0;
    test.dense_step_s = 0.05;
    good_ = testing::simulate(test);
    good_.metadata.specimen = "one";
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// "" when it was refused by the readers.
  std::string outcome(const messages::Recording& recording) {
    const auto result = analyse_recording(recording, "r");
    std::vector<RecordingResult> all{result};
    const auto analysis = analyse_curves(std::move(all), FvModel::kSlse1, {});
    for (const auto& curve : analysis.curves) {
      if (!curve.result.fit) continue;
      for (const auto& p : curve.result.fit->parameters)
        if (!std::isfinite(p.value)) return p.name + " is not finite";
    }
    for (const auto& fit : analysis.recordings.front().series) {
      if (!std::isfinite(fit.rms_N) || !std::isfinite(fit.stiffness_N_mm.value)) return "the series' fit is not finite";
    }
    return {};
  }

  messages::Recording good_;
};

// A sanitizer makes an analysis thirty times as long. The plain build tries all, the sanitized one a quarter.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kRounds = 2;
#else
constexpr int kRounds = 8;
#endif

const double kOdd[] = {0.0,
                       -0.0,
                       1e-320,
                       5e-324,
                       -5e-324,
                       1e-300,
                       -1e-300,
                       1e-160,
                       1e-30,
                       1e-9,
                       0.1,
                       1.0,
                       -1.0,
                       90.0,
                       1e3,
                       -1e3,
                       9999.0,
                       1e4,
                       -1e4,
                       1e5,
                       1e6,
                       -1e6,
                       1e7,
                       1e9,
                       1e10,
                       1e18,
                       1e30,
                       1e100,
                       1e150,
                       1e154,
                       1.4e154,
                       -1e155,
                       1e200,
                       1e300,
                       -1e300,
                       1e308,
                       -1e308,
                       1.7976931348623157e308,
                       -1.7976931348623157e308};

// A cell of 1e308 crashed fv (SIGSEGV); times of 1e-300 s and forces of 1e300 N were "consistent, rms -nan".
TEST_F(NumberFuzz, EveryOddCellIsRefusedWithItsLineOrSurvived) {
  messages::write_recording(folder_, good_);
  std::ifstream in(folder_ / "frame.csv");
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  in.close();
  std::mt19937_64 random(3);
  std::uniform_int_distribution<std::size_t> row(1, lines.size() - 1);
  int refused = 0, survived = 0;
  for (int round = 0; round < kRounds; ++round) {
    for (int column = 0; column < 3; ++column) {
      for (const double odd : kOdd) {
        const auto at = row(random);
        auto broken = lines;
        std::vector<std::string> cells;
        std::istringstream split(broken[at]);
        for (std::string cell; std::getline(split, cell, ',');) cells.push_back(cell);
        char text[40];
        std::snprintf(text, sizeof text, "%.17g", odd);
        cells[static_cast<std::size_t>(column)] = text;
        broken[at] = cells[0] + "," + cells[1] + "," + cells[2];
        std::string all;
        for (const auto& line : broken) all += line + "\n";
        std::ofstream(folder_ / "frame.csv", std::ios::binary) << all;
        SCOPED_TRACE(broken[at]);
        try {
          const auto read = messages::read_recording(folder_);
          EXPECT_EQ(outcome(read), "");
          ++survived;
        } catch (const messages::RecordingError& e) {
          ++refused;
          if (e.fault() == messages::RecordingFault::kUnits) continue;  // that is of the whole file
          EXPECT_TRUE(e.line() == at + 1 || e.line() == at + 2)
              << e.what();  // the row, or the one that follows a wrong time
        }
      }
    }
  }
  EXPECT_GT(8 * refused, 300 * kRounds);
  EXPECT_GT(8 * survived, 200 * kRounds);
}

/// Whole columns scaled, shifted and thinned: what reads as plausible is survived, however unlike a test it is.
TEST_F(NumberFuzz, WholeColumnsOfOddNumbers) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> exponent(-12.0, 6.0), unit(0.0, 1.0);
  for (int i = 0; i < 50 * kRounds; ++i) {
    SCOPED_TRACE(i);
    auto r = good_;
    const double x = std::pow(10.0, exponent(random) - 2.5), f = std::pow(10.0, exponent(random));
    const int kind = i % 8;
    for (std::size_t k = 0; k < r.frame.size(); ++k) {
      auto& force = r.frame.force_N[k];
      auto& position = r.frame.position_mm[k];
      if (kind == 0) force *= f / 100.0;
      if (kind == 1) position = std::clamp(position * x, -1e4, 1e4);
      if (kind == 2) force = unit(random) < 0.01 ? 1e6 : force;
      if (kind == 3) position = unit(random) < 0.01 ? -1e4 : position;
      if (kind == 4) force = 0.0;
      if (kind == 5) position = k % 2 == 0 ? 1e4 : -1e4;
      if (kind == 6) force = k % 2 == 0 ? 1e6 : -1e6;
      if (kind == 7) force += f;
      force = std::clamp(force, -1e6, 1e6);
    }
    if (i % 3 == 1) {
      for (std::size_t k = r.frame.size() / 2; k < r.frame.size(); ++k) r.frame.t_s[k] += 9.9e4;
    }
    if (i % 3 == 2) {
      // Bursts at the finest step there is.
      double t_s = 0.0;
      for (std::size_t k = 0; k < r.frame.size(); ++k) r.frame.t_s[k] = t_s += k % 5 == 0 ? 0.05 : 1.1e-9;
    }
    EXPECT_EQ(outcome(r), "");
  }
}

TEST(SeriesFitNumbers, SumsThatOverflowAreAnErrorNotACrash) {
  std::vector<double> t_s, x_mm, force_N;
  for (int i = 0; i < 100; ++i) {
    t_s.push_back(0.1 * i);
    x_mm.push_back(i % 20);
    force_N.push_back(i == 50 ? -1e308 : 2.0 * (i % 20));
  }
  ::testing::internal::CaptureStderr();
  for (const int arms : {1, 2}) EXPECT_THROW((void)fit_series(t_s, x_mm, force_N, arms), std::domain_error);
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "") << "what the solver says is nothing to a user";
}

TEST_F(NumberFuzz, UnitsInDoubtAreRefusedUnlessStated) {
  const auto fault_of = [&](const messages::Recording& r) -> std::string {
    messages::write_recording(folder_, r);
    try {
      (void)messages::read_recording(folder_);
      return "";
    } catch (const messages::RecordingError& e) {
      return e.what();
    }
  };
  EXPECT_EQ(fault_of(good_), "");
  auto metres = good_;
  for (double& x : metres.frame.position_mm) x *= 1e-3;
  const auto fault = fault_of(metres);
  EXPECT_NE(fault.find("a stroke of 0.004"), std::string::npos) << fault;
  EXPECT_NE(fault.find("in another unit"), std::string::npos) << fault;
  EXPECT_NE(fault.find("units = \"s, mm, N, psi\""), std::string::npos) << fault;
  metres.metadata.units_stated = true;  // somebody looked
  EXPECT_EQ(fault_of(metres), "");
  EXPECT_TRUE(messages::read_recording(folder_).metadata.units_stated);
  auto short_specimen = good_;
  short_specimen.metadata.rest_length_mm = 0.091;
  short_specimen.metadata.pressurized_rest_length_mm = 0.079;
  EXPECT_NE(fault_of(short_specimen).find("in another unit"), std::string::npos);
  auto micrometres = good_;
  for (double& x : micrometres.frame.position_mm) x *= 1e3;
  EXPECT_NE(fault_of(micrometres).find("in another unit"), std::string::npos);
  auto still = good_;  // a crosshead that stands says nothing of units
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0.0, 2e-4);
  for (double& x : still.frame.position_mm) x = 1.0 + noise(random);
  EXPECT_EQ(fault_of(still), "");
}

}  // namespace
}  // namespace isorig::identify
