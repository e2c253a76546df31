// Files that earlier versions wrote, kept as they were: every one still opens. A sample is never edited; a new version
// of a format adds one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "calibration/record.hpp"
#include "daemon/recording/amendments.hpp"
#include "daemon/rig/config.hpp"
#include "daemon/rig/specimen.hpp"
#include "drivers/config/register_map.hpp"
#include "drivers/config/regulator_config.hpp"
#include "messages/csv.hpp"
#include "messages/recording.hpp"
#include "model/composed.hpp"
#include "protocol/compile.hpp"
#include "sim/specimen.hpp"
#include "tree.hpp"

namespace isorig {
namespace {

using ::testing::HasSubstr;

std::filesystem::path sample(const std::string& name) {
  return std::filesystem::path(test::source_path()) / "tests/formats/samples" / name;
}

TEST(OldFiles, FirstConfiguration) {
  const auto plan = protocol::compile_file(sample("first/protocols/vma-smoke.toml"));
  EXPECT_EQ(plan.sessions.size(), 2U);
  EXPECT_EQ(plan.steps.size(), 24U);
  const auto rig = daemon::load_rig(sample("first/rigs/sim.toml"));
  EXPECT_EQ(rig.name, "sim");
  EXPECT_EQ(rig.limits.force_min_N, -15.0);
  EXPECT_EQ(daemon::load_specimen(sample("first/specimens/control2.toml")).rest_length_mm, 94.3);
  EXPECT_EQ(sim::load_specimen(sample("first/specimens/control2.toml")).actuator.initial_length_mm, 94.3);
  EXPECT_EQ(modbus::read_register_map(sample("first/frames/isorig-gateway.toml")).name, "isorig gateway");
  EXPECT_EQ(pressure::read_regulator_map(sample("first/regulators/alicat.toml")).name, "alicat");
}

TEST(OldFiles, RecordingBeforeItHadFurtherColumns) {
  const auto r = messages::read_recording(sample("2026-11-23/rep-1_5-psi"));
  EXPECT_EQ(r.metadata.specimen, "Control2");
  EXPECT_EQ(r.frame.size(), 11U);
  EXPECT_EQ(r.frame.t_s[0], 0.049537713000000004);
  ASSERT_TRUE(r.pressure);
  EXPECT_EQ(r.pressure->size(), 11U);
}

TEST(OldFiles, RecordingWithTheRequiredKeysAlone) {
  const auto r = messages::read_recording(sample("first/recording"));
  EXPECT_EQ(r.metadata.rest_length_mm, 100.0);
  EXPECT_FALSE(r.metadata.units_stated);
  EXPECT_EQ(r.frame.size(), 3U);
  EXPECT_FALSE(r.pressure);
}

TEST(OldFiles, Models) {
  for (const char* name : {"model.toml", "nominal.toml"}) {
    const auto file = sample(std::string("2026-11-23/") + name);
    const auto spec = model::parse_model(messages::read_whole_file(file), file.string());
    EXPECT_EQ(spec.name, "slse1") << name;
  }
}

/// amendments.toml and a calibration record.
TEST(OldFiles, WhatStandsBesideARun) {
  const auto amendments = daemon::read_amendments(sample("2026-11-23/run"));
  ASSERT_EQ(amendments.size(), 1U);
  EXPECT_EQ(amendments[0].specimen, "Control3");
  const auto record = calibration::parse_record(
      messages::read_whole_file(sample("2026-11-23/20261121-071500-pressure.toml")), "record");
  EXPECT_EQ(record.channel, calibration::Channel::kPressure);
  EXPECT_EQ(record.points.size(), 1U);
}

/// A version of tomorrow is refused by its name, not half-read.
TEST(OldFiles, AVersionThatIsNotKnownIsRefusedByItsName) {
  const auto says = [](auto read) -> std::string {
    try {
      read();
    } catch (const std::exception& e) {
      return e.what();
    }
    return "it was read";
  };
  const auto text = messages::read_whole_file(sample("first/specimens/control2.toml"));
  EXPECT_THAT(says([&] { (void)daemon::parse_specimen("format = \"isorig-specimen/2\"\n" + text, "s.toml"); }),
              HasSubstr("isorig-specimen/1"));
  EXPECT_THAT(says([&] { (void)model::parse_model("format = \"isorig-model/2\"\n", "m.toml"); }),
              HasSubstr("isorig-model/1"));
  EXPECT_THAT(says([&] {
                (void)protocol::compile(base::TomlDocument::parse_text("format = \"isorig-protocol/2\"\n", "p.toml"));
              }),
              HasSubstr("isorig-protocol/1"));
  EXPECT_THAT(
      says([&] {
        (void)modbus::read_register_map(base::TomlDocument::parse_text(
            "format = \"isorig-frame-map/2\"\n" + messages::read_whole_file(sample("first/frames/isorig-gateway.toml")),
            "f.toml"));
      }),
      HasSubstr("isorig-frame-map/1"));
}

}  // namespace
}  // namespace isorig
