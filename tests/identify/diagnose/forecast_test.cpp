#include "identify/diagnose/forecast.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/toml_reader.hpp"
#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/fit/intervals.hpp"
#include "identify/diagnose/fit/left_out.hpp"
#include "identify/diagnose/search/events.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "sim/physics.hpp"

namespace isorig::identify {
namespace {

constexpr double kNoise_N = 0.02;

std::vector<double> simulated(const model::ModelSpec& spec, const Excitation& excitation) {
  model::RunningModel running(spec, excitation.reference);
  running.reset(excitation.instants.front());
  std::vector<double> out;
  for (const model::Instant& now : excitation.instants) out.push_back(running.step(now));
  return out;
}

/// slse1 with friction, as learnt from the bench.
class Forecasts : public testing::Test {
 protected:
  static const model::ModelSpec& learnt() {
    static const model::ModelSpec spec = [] {
      const std::vector<Series> series{prepare_series("bench", test::record({.friction_N = 0.8, .seed = 12}), {})};
      const Problem problem(series, {kNoise_N, 0.0, 1.0});
      model::ModelSpec with = problem.fit(model::nominal_model("slse1"), 20).spec;
      const std::vector<model::Part> nominal = with.parts;
      const model::Physics& friction = *model::find_physics("coulomb_friction");
      with.parts.push_back(model::make_part(friction, friction.laws.front()));
      with = problem.fit(with, 30).spec;
      model::Seen seen = ranges_of(series);
      // As a diagnosis does: what it errs by where it was not fitted.
      const auto left_out = predict_blocks(series, refit(with, {kNoise_N, 0.0, 1.0}), blocks_of(series), 2);
      const RowErrors rows = row_errors(with, series[0], {});
      seen.error_N =
          std::max(together(left_out).rmse_N(kNoise_N), std::sqrt(rows.squares_N2 / static_cast<double>(rows.rows)));
      seen.covariance = lower_triangle(covariance(problem, with, Spread::kMoves));
      seen.nominal = nominal;
      with.seen = std::move(seen);
      return with;
    }();
    return spec;
  }
  /// The bench's other motion, `wider` times as wide at the same pace; noise on top.
  static messages::Recording other() {
    messages::Recording r = test::record_other({.friction_N = 0.8, .force_noise_N = kNoise_N, .seed = 13});
    return r;
  }
  static Excitation stretched(double wider) {
    messages::Recording r = other();
    for (double& x : r.frame.position_mm) x *= wider;
    return reconstruct_excitation(r);
  }
};

/// A model that reads the pressure, in a recording whose gauge is dead from 100 s on, or that has none.
TEST_F(Forecasts, WhereNobodyReadThePressureAreTheNominalModel) {
  model::ModelSpec reads = learnt();
  const model::Physics& coupling = *model::find_physics("pressure_coupling");
  reads.parts.push_back(model::make_part(coupling, coupling.laws.front()));
  reads.parts.back().coefficients.assign(reads.parts.back().coefficients.size(), 0.1);
  reads.parts.back().fixed = true;
  messages::Recording recording = other();
  ASSERT_TRUE(recording.pressure);
  EXPECT_TRUE(unread_by(reads, recording).empty());
  auto& gauge = *recording.pressure;
  const auto kept = static_cast<std::size_t>(std::ranges::lower_bound(gauge.t_s, 100.0) - gauge.t_s.begin());
  gauge.t_s.resize(kept);
  gauge.pressure_psi.resize(kept);
  EXPECT_TRUE(unread_by(learnt(), recording).empty()) << "friction does not mind";
  const auto unread = unread_by(reads, recording);
  ASSERT_EQ(unread.size(), 1U);
  const Excitation excitation = reconstruct_excitation(recording);
  const Forecast out = forecast(reads, excitation, {}, unread), whole = forecast(reads, excitation);
  model::ModelSpec nominal = reads;
  nominal.parts = reads.seen->nominal;
  nominal.seen.reset();
  const std::vector<double> nominal_N = simulated(nominal, excitation);
  for (std::size_t k = 0; k < nominal_N.size(); ++k) {
    if (excitation.instants[k].t_s < unread[0].from_s) {
      ASSERT_EQ(out.force_N[k], whole.force_N[k]) << k;
      continue;
    }
    ASSERT_NEAR(out.force_N[k], nominal_N[k], 1e-9) << k;
    ASSERT_EQ(out.outside[k], 1.0) << k;
    ASSERT_GE(out.high95_N[k] - out.force_N[k], std::fabs(whole.force_N[k] - nominal_N[k])) << k;
  }
  ASSERT_FALSE(out.notes.empty());
  EXPECT_NE(out.notes.back().find("pressure.csv has no readings from "), std::string::npos) << out.notes.back();
  recording.pressure.reset();
  EXPECT_EQ(unread_by(reads, recording).size(), 1U);
}

TEST_F(Forecasts, InsideWhatWasSeenAreTheModel) {
  const Excitation excitation = stretched(1.0);
  const Forecast out = forecast(learnt(), excitation);
  EXPECT_TRUE(out.notes.empty()) << out.notes.front();
  EXPECT_EQ(std::ranges::count(out.outside, 1.0), 0);
  const std::vector<double> model_N = simulated(learnt(), excitation);
  for (std::size_t k = 0; k < model_N.size(); ++k) ASSERT_NEAR(out.force_N[k], model_N[k], 1e-9) << k;
}

TEST_F(Forecasts, TheBandHoldsNinetyFivePercentOfReadingsNotSeen) {
  const messages::Recording recording = test::record({.friction_N = 0.8, .force_noise_N = kNoise_N, .seed = 99});
  const Forecast out = forecast(learnt(), reconstruct_excitation(recording));
  double inside = 0.0, n = 0.0, squares = 0.0;
  for (std::size_t k = 0; k < out.force_N.size(); ++k, n += 1.0) {
    squares += std::pow(recording.frame.force_N[k] - out.force_N[k], 2.0);
    inside += recording.frame.force_N[k] >= out.low95_N[k] && recording.frame.force_N[k] <= out.high95_N[k] ? 1.0 : 0.0;
  }
  // Thousands of readings: the share itself errs by 0.3 %. The stated error is that of one recording; what the
  // reconstructed motion errs by at the corners differs between two by 15 % of the rms, which makes 1.96 of it anything
  // from 1.67 to 2.25 standard deviations: 90.5 to 97.6 %.
  EXPECT_GT(inside / n, 0.905) << std::sqrt(squares / n) << " N rms, stated " << learnt().seen->error_N;
  EXPECT_LT(inside / n, 0.976);
}

TEST_F(Forecasts, BeyondWhatWasSeenFadeToTheNominalModelAndSayItsRange) {
  const Excitation excitation = stretched(30.0);
  const Forecast out = forecast(learnt(), excitation);
  ASSERT_FALSE(out.notes.empty());
  EXPECT_NE(out.notes[0].find("the position goes from"), std::string::npos) << out.notes[0];
  const std::vector<double> model_N = simulated(learnt(), excitation);
  const std::vector<double> nominal_N = simulated({"nominal", learnt().seen->nominal}, excitation);
  double widest = 0.0, narrowest = 1e300;
  std::size_t faded = 0;
  for (std::size_t k = 0; k < model_N.size(); ++k) {
    const double half = 0.5 * (out.high95_N[k] - out.low95_N[k]);
    widest = std::max(widest, half);
    narrowest = std::min(narrowest, half);
    EXPECT_LE(std::min(model_N[k], nominal_N[k]) - 1e-9, out.force_N[k]);
    EXPECT_GE(std::max(model_N[k], nominal_N[k]) + 1e-9, out.force_N[k]);
    EXPECT_LE(std::fabs(model_N[k] - out.force_N[k]), half + 1e-9) << "what was faded away stays in the band";
    if (std::fabs(out.force_N[k] - nominal_N[k]) < 1e-9 && std::fabs(model_N[k] - nominal_N[k]) > 0.1) ++faded;
  }
  EXPECT_GT(faded, 10u) << "far out nothing but the nominal model is left";
  EXPECT_GT(widest, 5.0 * narrowest);
}

/// Of a model that left-out readings do not bear whole, its share is predicted, and the band holds the rest.
TEST_F(Forecasts, PredictTheShareThatTheModelSays) {
  model::ModelSpec spec = learnt();
  spec.seen->share = 0.7;
  spec = model::parse_model(model::model_text(spec), "here");
  ASSERT_DOUBLE_EQ(spec.seen->share, 0.7);
  const Excitation excitation = stretched(1.0);
  const Forecast out = forecast(spec, excitation), whole = forecast(learnt(), excitation);
  const std::vector<double> nominal_N = simulated({"nominal", learnt().seen->nominal}, excitation);
  double largest_N = 0.0;
  for (std::size_t k = 0; k < nominal_N.size(); ++k) {
    const double beyond_N = whole.force_N[k] - nominal_N[k];
    EXPECT_NEAR(out.force_N[k], nominal_N[k] + 0.7 * beyond_N, 1e-9);
    EXPECT_NEAR(out.high95_N[k] - out.low95_N[k], whole.high95_N[k] - whole.low95_N[k] + 0.6 * std::fabs(beyond_N),
                1e-9);
    largest_N = std::max(largest_N, std::fabs(beyond_N));
  }
  EXPECT_GT(largest_N, 0.1);
  spec.seen->share = 1.0;
  EXPECT_EQ(model::model_text(spec).find("share = "), std::string::npos) << "a model that is whole does not say so";
}

/// A session whose recording begins with its filling: a fit has the rows after it alone.
TEST_F(Forecasts, CountTimeAndTravelFromTheSessionsBegin) {
  const model::Physics& drift = *model::find_physics("zero_drift");
  model::ModelSpec spec = model::nominal_model("slse1");
  spec.parts.push_back(model::make_part(drift, *model::find_law(drift, "linear")));
  spec.parts.back().coefficients = {3600.0};  // 1 N/s
  Excitation whole = stretched(1.0);
  Excitation session = whole;
  const auto begin = whole.instants.size() / 3;
  session.instants.erase(session.instants.begin(), session.instants.begin() + static_cast<std::ptrdiff_t>(begin));
  session.instants.front().dt_s = session.instants.front().step_mm = session.instants.front().slide_mm = 0.0;
  whole.begin_row = begin;
  const auto of_whole = forecast(spec, whole).force_N, of_session = forecast(spec, session).force_N;
  ASSERT_EQ(of_whole.size(), whole.instants.size());
  for (std::size_t k = 0; k < of_session.size(); ++k) ASSERT_NEAR(of_whole[begin + k], of_session[k], 1e-9) << k;
}

TEST_F(Forecasts, WithoutARecordOfWhatWasSeenHaveNoBand) {
  model::ModelSpec spec = learnt();
  spec.seen.reset();
  const Forecast out = forecast(spec, stretched(1.0));
  EXPECT_TRUE(out.low95_N.empty());
  EXPECT_TRUE(out.outside.empty());
}

TEST_F(Forecasts, ACovarianceOfAnotherModelIsRefused) {
  model::ModelSpec spec = learnt();
  EXPECT_EQ(unfit_seen(spec), "");
  spec.seen->covariance.pop_back();
  EXPECT_NE(unfit_seen(spec).find("diagnose again"), std::string::npos);
}

TEST_F(Forecasts, WhatWasSeenSurvivesItsFile) {
  const std::string text = model::model_text(learnt());
  const model::ModelSpec read = model::parse_model(text, "read");
  EXPECT_EQ(model::model_text(read), text);
  const Excitation excitation = stretched(3.0);
  EXPECT_EQ(forecast(read, excitation).low95_N, forecast(learnt(), excitation).low95_N);
  model::ModelSpec of_two = learnt();
  of_two.seen->recordings = {model::kLargestRecordingId, 2.0};
  of_two.seen->zero_elsewhere_N = -0.7;
  const model::Seen of_file = *model::parse_model(model::model_text(of_two), "read").seen;
  EXPECT_EQ(of_file.recordings, of_two.seen->recordings);
  EXPECT_EQ(of_file.zero_elsewhere_N, -0.7);
}

/// Zeros of 0, 0.3 and 0.6 N: s = 0.3 N, and a further one is known to s sqrt(1 + 1/3).
TEST(RunningForecast, OfARecordingThatWasNotFittedHoldsTheScatterOfTheZerosInItsBand) {
  model::ModelSpec spec{.name = "zeros", .parts = {}};
  const auto add = [&](const char* physics, double force_N) -> model::Part& {
    model::Part part = model::make_part(*model::find_physics(physics), model::find_physics(physics)->laws.front());
    part.coefficients = {force_N};
    return spec.parts.emplace_back(std::move(part));
  };
  add("constant", 1.0);
  add("force_zero", 0.3).parameters[0] = 7.0;
  add("force_zero", 0.6).parameters[0] = 9.0;
  spec.seen.emplace();
  spec.seen->recordings = {5.0, 7.0, 9.0};
  spec.seen->nominal = spec.parts;
  spec.seen->covariance.assign(6, 0.0);
  const auto row = [&](double recording_id) {
    RunningForecast running(spec, {.recording_id = recording_id}, {});
    running.reset({});
    return running.step({});
  };
  EXPECT_NEAR(row(8.0).force_N, 1.3, 1e-12);
  EXPECT_NEAR(row(8.0).half_N, 1.96 * 0.3 * std::sqrt(4.0 / 3.0), 1e-12);
  EXPECT_NEAR(row(7.0).half_N, 0.0, 1e-12) << "its own zero is known";
  EXPECT_NEAR(row(5.0).half_N, 0.0, 1e-12) << "the longest: its zero is the constant";
}

TEST_F(Forecasts, AFaultInSeenIsNamed) {
  const std::string text = model::model_text(learnt());
  const auto refused = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    changed.replace(at, from.size(), to);
    try {
      (void)model::parse_model(changed, "m.toml");
    } catch (const base::ConfigError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_NE(refused("rate_mm_s = ", "rate_mm_s = -").find("rate_mm_s"), std::string::npos);
  EXPECT_NE(refused("position_mm = [", "position_mm = [99.0, ").find("position_mm"), std::string::npos);
  EXPECT_NE(refused("error_N = ", "error_n = ").find("error_N"), std::string::npos);
}

/// Every law that a search can put into a model: the effects of the catalogue, tables and elements with memory.
std::vector<model::Part> all_parts() {
  std::vector<model::Part> out;
  std::vector<const model::Physics*> physics(model::effects().begin(), model::effects().end());
  for (const auto* one :
       {&model::element::empirical_force(), &model::element::empirical_motion(), &model::element::empirical_memory(),
        &model::element::empirical_response(), &model::element::discovered()})
    physics.push_back(one);
  for (const auto* one : physics) {
    for (const model::Law& law : one->laws) {
      out.push_back(model::make_part(*one, law));
      model::Part& part = out.back();
      for (std::size_t i = 0; i < part.coefficients.size(); ++i)
        part.coefficients[i] = law.coefficients[i].sign == model::Sign::kNonPositive ? -0.137 : 0.137;
      if (!law.make_table) continue;
      part.fixed = true;
      part.table = {-2.5, 0.7, {0.01, -0.02, 0.03, 0.015, -0.04, 0.02, 0.01, 1.0 / 3.0, 0.0, -0.01}};
    }
  }
  return out;
}

TEST(EveryModelOfASearch, IsWrittenReadPredictedAndRunByTheSimulatedRig) {
  const Excitation excitation = reconstruct_excitation(test::record_other({.pressure_wander_psi = 0.3, .seed = 5}));
  model::ActuatorParameters actuator;
  actuator.initial_length_mm = 90.0;
  actuator.minimum_length_mm = 75.0;
  actuator.mesh_diameter_mm = 10.0;
  actuator.braid_angle_deg = 30.0;
  actuator.pressure_psi = {0.0, 40.0};
  actuator.mckibben = {{100.0, 100.0}, {1.0, 1.0}, {1.0, 1.0}};
  const std::vector<model::Part> parts = all_parts();
  EXPECT_GE(parts.size(), 45u);
  for (const model::Part& part : parts) {
    const std::string name = std::string(part.physics->name) + " " + std::string(part.law->name);
    model::ModelSpec spec = model::nominal_model("slse1");
    const std::vector<model::Part> nominal = spec.parts;
    spec.parts.push_back(part);
    model::fill_from_recording(spec.parts.back(), excitation.reference);
    spec.seen = model::Seen{-5.0, 5.0, 100.0, 1e4, 0.0, 40.0, 1e4, {}, 0.0, 0.03, 1.0, {}, nominal};
    const std::size_t n = fitted_numbers(spec).size();
    spec.seen->covariance.assign(n * (n + 1) / 2, 0.0);
    const std::string text = model::model_text(spec, "written");
    const model::ModelSpec read = model::parse_model(text, "read");
    ASSERT_EQ(model::model_text(read, "written"), text) << name;
    ASSERT_EQ(unfit_seen(read), "") << name;
    const std::vector<double> direct = simulated(spec, excitation);
    const Forecast predicted = forecast(read, excitation);
    double largest = 0.0;
    for (std::size_t k = 0; k < direct.size(); ++k) {
      ASSERT_TRUE(std::isfinite(predicted.force_N[k])) << name;
      ASSERT_NEAR(predicted.force_N[k], direct[k], 1e-9 * (1.0 + std::fabs(direct[k]))) << name << " row " << k;
      ASSERT_NEAR(predicted.high95_N[k] - predicted.force_N[k], 1.96 * 0.03, 1e-9) << name;
      largest = std::max(largest, std::fabs(direct[k]));
    }
    EXPECT_GT(largest, 0.1) << name;
    // The rig steps the same parts in its own way: twice the same from the file as from memory.
    sim::SpecimenPhysics from_memory(actuator, sim::PhysicsConfig{spec, true, 20.0});
    sim::SpecimenPhysics from_file(actuator, sim::PhysicsConfig{read, true, 20.0});
    for (int k = 1; k < 400; ++k) {
      const double t_s = 0.01 * k, x_mm = 2.0 * std::sin(t_s), v_mm_s = 2.0 * std::cos(t_s);
      const double a = from_memory.step(x_mm, v_mm_s, 20.1, 0.01), b = from_file.step(x_mm, v_mm_s, 20.1, 0.01);
      ASSERT_TRUE(std::isfinite(b)) << name;
      ASSERT_EQ(a, b) << name << " step " << k;
    }
  }
}

// The variance of its time constant has no bound; infinity in the file was refused by predict.
TEST(Seen, OfAnArmWithoutStiffnessIsReadAgain) {
  const Study study =
      diagnose({test::record({.arm_N_mm = 0.0, .seed = 14})}, {"bench"}, model::nominal_model("slse1"), {});
  for (const model::ModelSpec& spec : {study.diagnosis.nominal, study.diagnosis.model}) {
    ASSERT_TRUE(spec.seen.has_value());
    const model::ModelSpec read = model::parse_model(model::model_text(spec), "nominal.toml");
    EXPECT_EQ(unfit_seen(read), "");
  }
}

}  // namespace
}  // namespace isorig::identify
