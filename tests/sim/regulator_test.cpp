// The regulator's driver against the emulated regulator in the simulated plant, over RTU on a pseudo-terminal and TCP.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <thread>

#include "drivers/clock/real_clock.hpp"
#include "drivers/pressure/alicat_regulator.hpp"
#include "sim/wire/pressure/regulator_server.hpp"
#include "tree.hpp"

namespace isorig::sim {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using ::testing::HasSubstr;

const std::string kMap = test::source_path("/config/regulators/alicat.toml");

class Regulator : public ::testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    auto sim = load_sim(test::source_path("/config/rigs/sim-8800-regulator.toml"));
    sim.pressure.watchdog_s = 60.0;
    RigOptions live;
    live.start_ns = clock_.now_ns();
    live.clock = &clock_;
    live.threaded = true;
    live.keep_truth = true;
    rig_ = std::make_unique<Rig>(sim, load_specimen(sim.specimen), live);
    rig_->interlock().connect();
    rig_->interlock().hold_pressure(true);
    rig_->pressure().connect();
    rig_->pressure().heartbeat();
    rig_->pressure().command({1000, 0, 0.0F});  // the supply valve
    RegulatorServer::Options options;
    options.tcp = GetParam();
    options.pty_link =
        (std::filesystem::path(::testing::TempDir()) / ("regulator-" + std::to_string(::getpid()))).string();
    server_ = std::make_unique<RegulatorServer>(options, *rig_, faults_);
    config_.map = pressure::read_regulator_map(kMap);
    config_.line.map.unit_id = 1;
    config_.line.transport = GetParam() ? modbus::ModbusTransport::kTcp : modbus::ModbusTransport::kRtu;
    config_.line.port = server_->port();
    config_.line.tty = options.pty_link;
    config_.line.response_timeout_ms = 1500;  // a machine may stand still for a second
    config_.max_psi = 20.0;
    make();
  }
  static constexpr int kShort_ms = 200;
  void make() { device_ = std::make_unique<pressure::AlicatRegulator>(config_); }

  static bool until(const std::function<bool()>& condition) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!condition()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return true;
  }
  /// The regulator and the plant have come to rest there: no valve of it is open any more.
  bool settles_at(double psi) {
    int steady = 0;
    return until([&] {
      steady = std::abs(rig_->truth().pressure_psi - psi) < 0.1 ? steady + 1 : 0;
      return steady == 20;
    });
  }
  /// What it says is what the plant's pressure was at some time since it was asked.
  pressure::RegulatorState read_as_the_plant() {
    (void)rig_->take_truth();
    double low = rig_->truth().pressure_psi, high = low;
    const auto state = device_->read();
    for (const auto& t : rig_->take_truth()) {
      low = std::min(low, t.pressure_psi);
      high = std::max(high, t.pressure_psi);
    }
    EXPECT_GE(double{state.pressure_psi}, low - 1e-3);
    EXPECT_LE(double{state.pressure_psi}, high + 1e-3);
    return state;
  }
  /// As the daemon does: again, until it works.
  static bool comes_through(const std::function<void()>& call) {
    return until([&] {
      try {
        call();
        return true;
      } catch (const DeviceError&) {
        return false;
      }
    });
  }
  /// With a time-out that is to be met.
  void hold_4_psi() {
    config_.line.response_timeout_ms = kShort_ms;
    make();
    ASSERT_TRUE(comes_through([&] { device_->connect(); }));
    ASSERT_TRUE(comes_through([&] { device_->regulate(4.0F); }));
    ASSERT_TRUE(settles_at(4.0)) << rig_->truth().pressure_psi;
  }
  Fault fault_of(const std::function<void()>& call, const std::string& says) {
    try {
      call();
    } catch (const DeviceError& error) {
      EXPECT_THAT(error.what(), HasSubstr(says));
      return error.fault();
    }
    ADD_FAILURE() << "nothing was thrown";
    return Fault::kTimeout;
  }

  clock::RealClock clock_;
  RegulatorFaults faults_;
  std::unique_ptr<Rig> rig_;
  std::unique_ptr<RegulatorServer> server_;
  pressure::RegulatorConfig config_;
  std::unique_ptr<pressure::AlicatRegulator> device_;
};

TEST_P(Regulator, SetsThePressureAndLetsItGo) {
  EXPECT_THAT(device_->connect(), HasSubstr("alicat"));
  EXPECT_TRUE(server_->exhausting());
  device_->regulate(5.0F);
  EXPECT_FALSE(server_->exhausting());
  EXPECT_NEAR(server_->setpoint_psi(), 5.0, 1e-5);
  EXPECT_TRUE(settles_at(5.0)) << rig_->truth().pressure_psi;
  const auto state = read_as_the_plant();
  EXPECT_NEAR(state.setpoint_psi, 5.0, 1e-3);
  EXPECT_FALSE(state.exhausting);
  EXPECT_FALSE(state.faulty);
  device_->exhaust();
  EXPECT_TRUE(device_->read().exhausting);
  EXPECT_TRUE(until([&] { return rig_->truth().pressure_psi < 0.3; })) << rig_->truth().pressure_psi;
}

TEST_P(Regulator, SaysWhichWordOrderWouldBeRight) {
  faults_.swap_words = true;
  EXPECT_EQ(fault_of([&] { (void)device_->connect(); }, "with word_order = \"CDAB\" it would be right"),
            Fault::kIdentity);
  config_.map.order = modbus::WordOrder::kCDAB;
  make();
  device_->connect();
  device_->regulate(3.0F);
  EXPECT_NEAR(server_->setpoint_psi(), 3.0, 1e-5);
  EXPECT_TRUE(device_->read().setpoint_psi == 3.0F);
}

TEST_P(Regulator, SeesAnotherUnit) {
  faults_.in_kpa = true;
  EXPECT_EQ(fault_of([&] { (void)device_->connect(); }, "check pressure_unit"), Fault::kIdentity);
  config_.map.psi_per_unit = 0.14503773773;
  config_.map.known_min = 60.0;
  config_.map.known_max = 110.0;
  make();
  device_->connect();
  device_->regulate(3.0F);
  EXPECT_NEAR(server_->setpoint_psi(), 3.0, 1e-4);
}

TEST_P(Regulator, ASetpointThatDoesNotArriveIsRefused) {
  device_->connect();
  faults_.clamp = true;
  EXPECT_EQ(fault_of([&] { device_->regulate(5.0F); }, "was read back as 2 psi"), Fault::kRefused);
  EXPECT_TRUE(server_->exhausting());  // still: the valve is let go only after the set-point stands
  EXPECT_EQ(fault_of([&] { device_->regulate(20.5F); }, "outside 0 to max_psi"), Fault::kRefused);
  EXPECT_EQ(fault_of([&] { device_->regulate(std::nanf("")); }, "outside 0 to max_psi"), Fault::kRefused);
}

TEST_P(Regulator, ALateAnswerIsNeverTheNextOne) {
  ASSERT_NO_FATAL_FAILURE(hold_4_psi());
  for (int i = 0; i < 3; ++i) {
    // Another one, where the machine stood still and the answer was in time for the driver after all.
    EXPECT_TRUE(until([&] {
      faults_.late_ms = kShort_ms + 70;
      try {
        (void)device_->read();
        return false;
      } catch (const DeviceError& error) {
        EXPECT_EQ(error.fault(), Fault::kTimeout);
        EXPECT_THAT(error.what(), HasSubstr("no answer within"));
        return true;
      }
    }));
    faults_.late_ms = 0;
    pressure::RegulatorState state;
    ASSERT_TRUE(comes_through([&] { state = read_as_the_plant(); }));
    EXPECT_NEAR(state.setpoint_psi, 4.0, 1e-3);
  }
}

TEST_P(Regulator, KeepsItsSetpointWhenNobodySpeaksToIt) {
  ASSERT_NO_FATAL_FAILURE(hold_4_psi());
  faults_.disconnect = true;
  EXPECT_THROW((void)device_->read(), DeviceError);
  EXPECT_THROW(device_->exhaust(), DeviceError);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_NEAR(rig_->truth().pressure_psi, 4.0, 0.3);
  rig_->pressure().command({0, 1000, 0.0F});  // supply shut, vent open: the Teensy's, with or without the regulator
  EXPECT_TRUE(until([&] { return rig_->truth().pressure_psi < 0.3; })) << rig_->truth().pressure_psi;
}

INSTANTIATE_TEST_SUITE_P(Rtu, Regulator, ::testing::Values(false));
INSTANTIATE_TEST_SUITE_P(Tcp, Regulator, ::testing::Values(true));

TEST(RegulatorMap, CountsFromWhereTheManualDoes) {
  std::ifstream in(kMap);
  std::string text((std::istreambuf_iterator<char>(in)), {});
  const auto with = [&](const std::string& from, const std::string& to) {
    auto changed = text;
    changed.replace(changed.find(from), from.size(), to);
    const auto path = std::filesystem::path(::testing::TempDir()) / ("map-" + std::to_string(::getpid()) + ".toml");
    std::ofstream(path) << changed;
    return path;
  };
  const auto zero = pressure::read_regulator_map(kMap);
  const auto one = pressure::read_regulator_map(with("address_base = 0", "address_base = 1"));
  EXPECT_EQ(zero.setpoint, 1009);
  EXPECT_EQ(one.setpoint, 1008);
  EXPECT_EQ(one.known, 1356);
  EXPECT_EQ(zero.exhausting_bits, 1U << 10U);
  EXPECT_THROW((void)pressure::read_regulator_map(with("pressure = 1202", "pressure = 1100")), base::ConfigError);
  EXPECT_THROW((void)pressure::read_regulator_map(with("\"psi\"", "\"mbar\"")), base::ConfigError);
}

}  // namespace
}  // namespace isorig::sim
