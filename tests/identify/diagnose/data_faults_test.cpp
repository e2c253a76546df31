// Faults of the data put in a clean recording: listed in diagnosis.json with kind and place, and no physics
// named.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <ostream>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {
namespace {

std::size_t row_at(const messages::Recording& recording, double t_s) {
  const auto& t = recording.frame.t_s;
  return static_cast<std::size_t>(std::ranges::lower_bound(t, t_s) - t.begin());
}

struct Injected {
  std::string_view name, kind;
  double t_start_s, t_end_s;  ///< the listed fault must overlap it
  std::function<void(messages::Recording&)> put;
};
void PrintTo(const Injected& fault, std::ostream* out) {
  *out << fault.name;
}

void stand_still(std::vector<double>& reading, std::size_t from, std::size_t count) {
  std::fill_n(reading.begin() + static_cast<std::ptrdiff_t>(from), count, reading[from]);
}

/// The bench's ramp at 4 mm/s begins at 547 s; from 640 s it rests, to 658 s.
const Injected kInjected[] = {
    {"outliers", "outliers", 0.0, 1200.0,
     [](messages::Recording& r) {
       for (std::size_t k = 50; k + 50 < r.frame.size(); k += 331) r.frame.force_N[k] += k % 2 == 0 ? 1.5 : -0.7;
     }},
    {"burst", "outliers", 643.0, 645.0,
     [](messages::Recording& r) {
       for (std::size_t k = row_at(r, 644.0); k < row_at(r, 644.0) + 3; ++k) r.frame.force_N[k] -= 2.0;
     }},
    {"lost_force", "frozen", 645.0, 650.0,
     [](messages::Recording& r) { stand_still(r.frame.force_N, row_at(r, 645.0), 25); }},
    {"lost_force_in_a_ramp", "frozen", 547.1, 547.6,
     [](messages::Recording& r) { stand_still(r.frame.force_N, row_at(r, 547.1), 100); }},
    {"saturated_above", "saturation", 85.0, 120.0,
     [](messages::Recording& r) {
       for (double& f : r.frame.force_N) f = std::fmin(f, 58.0);
     }},
    {"saturated_below", "saturation", 230.0, 290.0,
     [](messages::Recording& r) {
       for (double& f : r.frame.force_N) f = std::fmax(f, 42.0);
     }},
    {"gap", "gap", 690.0, 720.0,
     [](messages::Recording& r) {
       const auto from = static_cast<std::ptrdiff_t>(row_at(r, 690.0)),
                  to = static_cast<std::ptrdiff_t>(row_at(r, 720.0));
       for (auto* column : {&r.frame.t_s, &r.frame.position_mm, &r.frame.force_N})
         column->erase(column->begin() + from, column->begin() + to);
     }},
    {"gap_in_a_ramp", "gap", 545.0, 550.0,
     [](messages::Recording& r) {
       const auto from = static_cast<std::ptrdiff_t>(row_at(r, 545.0)),
                  to = static_cast<std::ptrdiff_t>(row_at(r, 550.0));
       for (auto* column : {&r.frame.t_s, &r.frame.position_mm, &r.frame.force_N})
         column->erase(column->begin() + from, column->begin() + to);
     }},
    {"mains_hum", "hum", 0.0, 1200.0,
     [](messages::Recording& r) {
       for (std::size_t k = 0; k < r.frame.size(); ++k)
         r.frame.force_N[k] += 0.03 * std::sin(2.0 * std::numbers::pi * 50.01 * r.frame.t_s[k]);
     }},
    {"clock_jump", "gap", 650.0, 660.0,
     [](messages::Recording& r) {
       for (std::size_t k = row_at(r, 650.0); k < r.frame.size(); ++k) r.frame.t_s[k] += 9.0;
       for (double& t : r.pressure->t_s) t += t > 650.0 ? 9.0 : 0.0;
     }},
    {"lost_position_at_rest", "frozen", 645.0, 650.0,
     [](messages::Recording& r) { stand_still(r.frame.position_mm, row_at(r, 645.0), 25); }},
    {"lost_position_in_a_ramp", "frozen", 547.1, 547.6,
     [](messages::Recording& r) { stand_still(r.frame.position_mm, row_at(r, 547.1), 60); }},
    {"lost_half", "frozen", 620.0, 1200.0,
     [](messages::Recording& r) {
       const std::size_t first = row_at(r, 620.0);
       stand_still(r.frame.force_N, first, r.frame.size() - first);
     }},
    {"lost_pressure", "frozen", 400.0, 430.0,
     [](messages::Recording& r) { stand_still(r.pressure->pressure_psi, 2000, 150); }},
    {"coarse_steps", "quantisation", 0.0, 1200.0,
     [](messages::Recording& r) {
       for (double& f : r.frame.force_N) f = std::round(f / 0.1) * 0.1;
     }},
};

class DataFaults : public testing::TestWithParam<Injected> {};
TEST_P(DataFaults, AreListedAndNamedAsNoPhysics) {
  messages::Recording recording = test::record({.seed = 8});
  GetParam().put(recording);
  const Diagnosis d = diagnose({recording}, {"bench"}, model::nominal_model("slse1"), {}).diagnosis;
  const auto json = diagnosis_json(d);
  EXPECT_EQ(json["verdict"], "consistent") << json["missing"].dump(1);
  EXPECT_TRUE(json["missing"].empty()) << json["missing"].dump(1);
  bool listed = false;
  for (const auto& fault : json["data_faults"]) {
    EXPECT_EQ(fault["kind"], GetParam().kind) << fault.dump();
    listed = listed || (fault["kind"] == GetParam().kind && fault["t_start_s"] < GetParam().t_end_s &&
                        fault["t_end_s"] > GetParam().t_start_s);
    EXPECT_FALSE(fault["text"].get<std::string>().empty());
  }
  EXPECT_TRUE(listed) << json["data_faults"].dump(1);
}
/// Readings 0.01 s apart are half a period of the mains apart and the rougher for the hum, so that those at rest look
/// like means beside them, which have none. It was taken out of the quick ones alone, at twice its size.
TEST(MainsHum, IsTakenOutOfReadingsHalfAPeriodApartAndOfTheOthers) {
  messages::Recording recording = test::record({.fast_interval_s = 0.01, .seed = 12});
  constexpr double kHum_N = 0.04;
  for (std::size_t k = 0; k < recording.frame.size(); ++k)
    recording.frame.force_N[k] += kHum_N * std::sin(2.0 * M_PI * 50.02 * recording.frame.t_s[k]);
  const Diagnosis d = diagnose({recording}, {"bench"}, model::nominal_model("slse1"), {}).diagnosis;
  EXPECT_EQ(d.verdict, Verdict::kConsistent);
  ASSERT_EQ(d.faults.size(), 1U);
  double amplitude_N = 0.0;
  ASSERT_EQ(std::sscanf(d.faults[0].text.c_str(), "the force hums with the mains: %lf N", &amplitude_N), 1)
      << d.faults[0].text;
  EXPECT_NEAR(amplitude_N, kHum_N, 0.1 * kHum_N);
  EXPECT_NEAR(d.noise_N, 0.02, 0.001);  // of the bench
}

INSTANTIATE_TEST_SUITE_P(ConcealedSpecimen, DataFaults, testing::ValuesIn(kInjected),
                         [](const auto& fault) { return std::string(fault.param.name); });

}  // namespace
}  // namespace isorig::identify
