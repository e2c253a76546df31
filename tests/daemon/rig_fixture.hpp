#pragma once
#include <gtest/gtest.h>

#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "base/toml_reader.hpp"
#include "daemon/rig/virtual_rig.hpp"
#include "protocol/compile.hpp"
#include "tree.hpp"

namespace isorig::daemon::test {

inline std::string source(const std::string& path) {
  return isorig::test::source_path() + "/" + path;
}

/// A virtual rig with its queues drained into vectors, and the verbs as calls.
class RigFixture : public ::testing::Test {
 protected:
  RigFixture() : config(load_rig(source("config/rigs/sim.toml"))) {}

  void SetUp() override { virtual_rig = std::make_unique<VirtualRig>(config); }

  /// After a change of `config`.
  void rebuild() {
    events.clear();
    virtual_rig = std::make_unique<VirtualRig>(config);
  }

  void tick() {
    virtual_rig->tick();
    if (virtual_rig->now_ns() % 10'000'000 == 0) drain();
  }

  void run_for(double seconds) {
    const auto until = virtual_rig->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (virtual_rig->now_ns() < until) tick();
    drain();
  }

  /// Ticks until `condition`; false when `seconds` pass before.
  template <typename Condition>
  bool run_until(double seconds, Condition condition) {
    const auto until = virtual_rig->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (!condition()) {
      if (virtual_rig->now_ns() >= until) return false;
      tick();
    }
    drain();
    return true;
  }
  bool reach(RunState state, double seconds) {
    return run_until(seconds, [&] { return virtual_rig->core().state() == state; });
  }

  Reply ask(Request::Verb verb, const protocol::Plan* plan_to_run = nullptr, std::uint32_t session = 0) {
    Request request;
    request.verb = verb;
    request.id = ++last_id;
    request.plan = plan_to_run;
    request.first_session = session;
    virtual_rig->core().requests.push(request);
    tick();
    Reply reply;
    EXPECT_TRUE(virtual_rig->core().replies.pop(reply));
    EXPECT_EQ(reply.id, request.id);
    const auto shown = virtual_rig->core().status().control;
    EXPECT_EQ(shown.mono_ns, virtual_rig->now_ns()) << "the status is of before the answer";
    EXPECT_EQ(shown.state, virtual_rig->core().state());
    return reply;
  }

  /// To running, with `text` as the protocol.
  void start(const std::string& steps) {
    plan = protocol::compile(base::TomlDocument::parse_text(
                                 "format = \"isorig-protocol/1\"\nname = \"test\"\nrecording.policy = \"round_ramps\"\n"
                                 "steps = [\n" +
                                     steps + "\n]\n",
                                 "test.toml"),
                             config.limits);
    ASSERT_TRUE(reach(RunState::kReady, 5.0)) << virtual_rig->core().status().not_ready;
    const auto reply = ask(Request::Verb::kStart, &plan);
    ASSERT_TRUE(reply.accepted) << reply.text;
  }

  void drain() {
    FrameRecord f;
    PressureRecord p;
    ControlRecord c;
    EventRecord e;
    ExchangeRecord x;
    SyncRecord s;
    while (virtual_rig->streams.frame.pop(f)) {
      if (keep_records) frame.push_back(f);
      ++frame_count;
    }
    while (virtual_rig->streams.pressure.pop(p)) {
      if (keep_records) pressure.push_back(p);
      ++pressure_count;
    }
    while (virtual_rig->streams.control.pop(c)) control = c;
    while (virtual_rig->streams.exchanges.pop(x)) ++exchange_count;
    while (virtual_rig->streams.sync.pop(s)) sync.push_back(s);
    while (virtual_rig->streams.events.pop(e)) {
    }
    while (virtual_rig->core().host_events.pop(e)) events.push_back(e);
  }

  [[nodiscard]] const EventRecord* event(const char* code) const {
    for (const auto& e : events) {
      if (std::strcmp(e.code, code) == 0) return &e;
    }
    return nullptr;
  }

  RigConfig config;
  std::unique_ptr<VirtualRig> virtual_rig;
  protocol::Plan plan;
  std::uint32_t last_id = 0;
  bool keep_records = false;
  std::vector<FrameRecord> frame;
  std::vector<PressureRecord> pressure;
  std::vector<EventRecord> events;
  std::vector<SyncRecord> sync;
  ControlRecord control;
  std::uint64_t frame_count = 0, pressure_count = 0, exchange_count = 0;
};

/// Pressurized to 10 psi and holding for long: something is live to be disturbed.
inline constexpr const char* kHold =
    R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "hold", duration_s = 1000 },)";

}  // namespace isorig::daemon::test
