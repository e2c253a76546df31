#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "driver.hpp"

namespace isorig::sim {
namespace {

// Two I/O threads and a clock, as the daemon runs the rig in real time.
TEST(ThreadedRig, DevicesMayBeCalledFromTheirOwnThreads) {
  clock::VirtualClock clock;
  const SimConfig config = testing::shipped();
  Rig rig(config, load_specimen(config.specimen), {.clock = &clock, .threaded = true});
  rig.frame().connect();
  rig.pressure().connect();
  rig.interlock().connect();
  std::atomic<bool> stop{false};
  std::size_t frame_samples = 0;
  std::size_t pressure_samples = 0;
  std::atomic<int> frame_rounds{0};
  std::atomic<int> pressure_rounds{0};
  std::thread frame_thread([&] {
    std::vector<frame::Sample> buffer(256);
    std::uint16_t beat = 0;
    while (!stop) {
      const auto p = rig.frame().poll(buffer);
      frame_samples += p.samples + p.lost;
      rig.frame().heartbeat(++beat);
      ++frame_rounds;
      std::this_thread::yield();
    }
  });
  std::thread pressure_thread([&] {
    std::vector<pressure::Sample> buffer(256);
    std::vector<clock::Exchange> exchanges(8);
    while (!stop) {
      const auto p = rig.pressure().poll(buffer, exchanges, 0);
      pressure_samples += p.samples + p.lost;
      rig.pressure().heartbeat();
      rig.pressure().request_time_sync();
      ++pressure_rounds;
      std::this_thread::yield();
    }
  });
  for (int i = 1; i <= 500; ++i) {
    clock.sleep_until_ns(i * 1'000'000LL);
    if (i % 100 == 0) rig.interlock().hold_pressure(i % 200 == 0);
    if (i == 250) rig.interlock().estop_closed = false;
    if (i % 10 != 0) continue;
    // The scheduler may give an I/O thread nothing for as long as it likes; virtual time waits for both.
    const int frame_round = frame_rounds;
    const int pressure_round = pressure_rounds;
    while (frame_rounds == frame_round || pressure_rounds == pressure_round) std::this_thread::yield();
  }
  EXPECT_EQ(rig.truth().mono_ns, 500'000'000);
  stop = true;
  frame_thread.join();
  pressure_thread.join();
  std::vector<frame::Sample> rest(512);
  const auto p = rig.frame().poll(rest);
  EXPECT_NEAR(static_cast<double>(frame_samples + p.samples + p.lost), 498.0, 4.0);
  std::vector<pressure::Sample> rest_pressure(1024);
  std::vector<clock::Exchange> exchanges(64);
  const auto q = rig.pressure().poll(rest_pressure, exchanges, 0);
  EXPECT_NEAR(static_cast<double>(pressure_samples + q.samples + q.lost), 498.0, 4.0);
}

}  // namespace
}  // namespace isorig::sim
