#pragma once
#include <atomic>

namespace isorig::sim {

/// Faults of the emulated frame gateway, switched while it runs, from any thread (docs/wire-frame.md).
struct FrameWireFaults {
  std::atomic<int> delay_ms{0};  ///< every answer comes so much later
  std::atomic<int> late_ms{
      0};  ///< the next answer only; then 0 again. Beyond the client's time-out: a late reply
  std::atomic<int> drop{0};             ///< so many answers are never sent; -1: until switched off
  std::atomic<int> corrupt{0};          ///< so many answers are damaged; -1: until switched off
  std::atomic<bool> disconnect{false};  ///< connections are cut and none is taken, until switched off
  std::atomic<bool> freeze{false};  ///< registers stand still, as when the frame hangs behind a live gateway
  std::atomic<bool> refuse{false};  ///< start commands get an exception
  std::atomic<bool> wrong_identity{false};
};

}  // namespace isorig::sim
