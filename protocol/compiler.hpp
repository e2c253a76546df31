#pragma once
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/evaluator.hpp"
#include "protocol/limits.hpp"
#include "protocol/plan.hpp"
#include "protocol/syntax.hpp"

/// Within this room alone: compile.hpp is what others call.
namespace isorig::protocol {

inline constexpr double kWeek_s = 7 * 24 * 3600.0;

/// Walks the tree with the variables bound, and lays down the plan step by step.
class Compiler : private Evaluator {
 public:
  Compiler(const syntax::Protocol& protocol, const Limits& limits, Plan& plan)
      : Evaluator(protocol.constants), limits_(limits), plan_(plan) {}

  void run(const syntax::Protocol& protocol, const base::TomlTable& root);

 private:
  void walk(const std::vector<syntax::Node>& nodes);
  void repeat(const syntax::Node& node);
  void open_session(const syntax::Node* node);
  /// The session's pressure is that of its first pressurize, which has to come before any motion.
  void close_session(const base::TomlTable& table, std::uint32_t first, const std::string& label);
  void step(const syntax::Node& node);
  void check_approach(const base::TomlTable& root);

  // compile_steps.cpp: a step of each kind against the rig's limits.
  void pressurize(const syntax::Node& node, Step& out);
  void settle(const syntax::Node& node, Step& out);
  void ramp(const syntax::Node& node, Step& out);
  void wave(const syntax::Node& node, Step& out);
  /// As few chords as keep the sine within deviation_mm.
  void cut_sine(const syntax::Node& node, Step& out, const char* rate_key);
  void check_frequency(const syntax::Node& node, const Step& wave, double turning_s);
  void mark(const syntax::Node& node, Step& out);
  void check_speed(const syntax::Node& node, std::string_view key, double speed_mm_s);
  void check_interval(const syntax::Node& node, std::string_view key, double interval_s, const std::string& what);
  [[nodiscard]] bool outside_travel(double position_mm, double velocity_mm_s) const;
  [[nodiscard]] std::string travel_range(double position_mm, double velocity_mm_s) const;
  [[nodiscard]] std::string speed_range() const;

  const Limits& limits_;
  Plan& plan_;
  double position_mm_ = 0.0;
  double setpoint_psi_ = 0.0;
  bool in_session_ = false;
  const syntax::Node* outside_ = nullptr;  ///< the first step that stands in no session
  std::map<double, std::int32_t> sessions_at_psi_;
  std::set<std::string> session_labels_;
  std::set<std::pair<std::uint32_t, std::uint32_t>> warned_;  ///< places: a step in a repeat warns once
};

}  // namespace isorig::protocol
