#pragma once
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "sim/rig.hpp"
#include "tree.hpp"

namespace isorig::sim::testing {

inline std::filesystem::path config_path(const char* name) {
  return std::filesystem::path(test::source_path()) / "config" / name;
}

/// Runs a rig as a daemon would, 1 ms at a time: heartbeats, polls, and a simple loop on the true pressure.
class Driver {
 public:
  explicit Driver(Rig& rig) : rig_(rig), frame_buffer_(256), pressure_buffer_(256), exchange_buffer_(16) {
    rig_.frame().connect();
    rig_.pressure().connect();
    rig_.interlock().connect();
    rig_.interlock().hold_pressure(true);
    now_ns_ = rig_.truth().mono_ns;
  }

  void run(double seconds) {
    const auto ticks = static_cast<long>(std::llround(seconds * 1000.0));
    for (long i = 0; i < ticks; ++i) tick();
  }

  void tick() {
    now_ns_ += Rig::kStep_ns;
    ++ticks_;
    rig_.advance(now_ns_);
    if (beating && ticks_ % 50 == 1) {
      rig_.frame().heartbeat(static_cast<std::uint16_t>(ticks_ / 50 + 1));
      rig_.pressure().heartbeat();
    }
    if (target_psi >= 0.0 && ticks_ % 5 == 0) {
      const double error_psi = target_psi - rig_.truth().pressure_psi;
      const double duty = std::min(1000.0, 18.0 + 600.0 * std::abs(error_psi));
      const auto permille = static_cast<std::uint16_t>(duty);
      rig_.pressure().command(error_psi > 0.0 ? pressure::Command{permille, 0, 0.0F}
                                              : pressure::Command{0, permille, 0.0F});
    }
    if (syncing && ticks_ % 100 == 7) rig_.pressure().request_time_sync();
    if (polling) {
      const auto f = rig_.frame().poll(frame_buffer_);
      state = f.state;
      frame_lost += f.lost;
      frame_samples.insert(frame_samples.end(), frame_buffer_.begin(),
                           frame_buffer_.begin() + static_cast<std::ptrdiff_t>(f.samples));
      if (f.has_exchange) frame_exchanges.push_back(f.exchange);
      const auto p = rig_.pressure().poll(pressure_buffer_, exchange_buffer_, 0);
      pressure_state = p.state;
      pressure_lost += p.lost;
      pressure_samples.insert(pressure_samples.end(), pressure_buffer_.begin(),
                              pressure_buffer_.begin() + static_cast<std::ptrdiff_t>(p.samples));
      pressure_exchanges.insert(pressure_exchanges.end(), exchange_buffer_.begin(),
                                exchange_buffer_.begin() + static_cast<std::ptrdiff_t>(p.exchanges));
    }
  }

  void move(double target_mm, double velocity_mm_s) {
    rig_.frame().start_segment({++segment_, static_cast<float>(target_mm), static_cast<float>(velocity_mm_s)});
  }

  double target_psi = -1.0;  ///< < 0: valves shut by nobody's command
  bool beating = true, polling = true, syncing = false;
  frame::State state;
  pressure::State pressure_state;
  std::uint32_t frame_lost = 0, pressure_lost = 0;
  std::vector<frame::Sample> frame_samples;
  std::vector<pressure::Sample> pressure_samples;
  std::vector<clock::Exchange> frame_exchanges, pressure_exchanges;

  [[nodiscard]] std::int64_t now_ns() const { return now_ns_; }

 private:
  Rig& rig_;
  std::vector<frame::Sample> frame_buffer_;
  std::vector<pressure::Sample> pressure_buffer_;
  std::vector<clock::Exchange> exchange_buffer_;
  std::int64_t now_ns_ = 0;
  long ticks_ = 0;
  std::uint16_t segment_ = 0;
};

/// The shipped rig, its configuration ready to be changed.
inline SimConfig shipped() {
  return load_sim(config_path("rigs/sim.toml"));
}

}  // namespace isorig::sim::testing
