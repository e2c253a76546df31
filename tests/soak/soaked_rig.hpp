#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "../daemon/made_samples.hpp"
#include "../daemon/struck_rig.hpp"
#include "daemon/host/host.hpp"
#include "witness.hpp"

namespace isorig::soak {

/// Samples of one stream, as the plant made them and as the recorder counted them.
struct Counted {
  std::uint64_t made = 0;  ///< while it was recorded
  std::uint64_t full = 0, averaged = 0, missing = 0;
};

/// The daemon's host, core, services and recorder on the simulated rig in virtual time, one thread: what `isorig run`
/// ticks, with the faults of the catalogue and an operator who repairs, resets and resumes.
class SoakedRig final : public daemon::test::StruckRig {
 public:
  SoakedRig(const daemon::RigConfig& config, const std::filesystem::path& runs_root);

  [[nodiscard]] daemon::VirtualRig& rig() noexcept override { return *rig_; }
  [[nodiscard]] daemon::Host& host() noexcept { return *host_; }
  [[nodiscard]] daemon::RunState state() const noexcept { return rig_->core().state(); }
  [[nodiscard]] daemon::Status status() const noexcept { return rig_->core().status(); }
  [[nodiscard]] double now_s() const noexcept { return static_cast<double>(rig_->now_ns()) * 1e-9; }
  Witness& witness() noexcept { return witness_; }

  void tick();
  void run_for(double seconds);
  template <typename Condition>
  bool run_until(double seconds, Condition condition) {
    const double until_s = now_s() + seconds;
    while (!condition()) {
      if (now_s() >= until_s) return false;
      tick();
    }
    return true;
  }

  daemon::Host::Result ask(daemon::Request::Verb verb, double target_mm = 0.0);
  /// A protocol's text, or a run that goes on.
  bool start(const std::string& protocol_text);
  bool resume(const std::string& run);
  [[nodiscard]] const std::string& refusal() const noexcept { return refusal_; }

  /// Docs/states.md, until the run goes on: confirm-zero, reset, resume of a held run, resume RUN of one that was
  /// vented. False after `seconds`; refusal() says what was in the way. True as well when the run is over.
  bool come_back(double seconds);
  [[nodiscard]] bool is_done() const { return !host_->run_open() && host_->last_outcome() == "done"; }

  /// Of all attempts at the run so far.
  Counted frame, pressure;
  std::uint64_t dropped = 0, lost_messages = 0;
  int attempts = 0, resets = 0, held_resumed = 0, runs_resumed = 0;
  std::string run_id;

 private:
  bool begin(const daemon::StartOptions& options);
  void follow_run();
  void add_counts();

  const daemon::RigConfig& config_;
  std::unique_ptr<daemon::VirtualRig> rig_;
  std::unique_ptr<daemon::Host> host_;
  Witness witness_;
  std::string refusal_;
  bool was_open_ = false;
  daemon::test::MadeSamples made_;
};

}  // namespace isorig::soak
