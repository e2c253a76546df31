#include "protocol/compile.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "protocol/budget.hpp"
#include "protocol/evaluator.hpp"
#include "protocol/force_slope.hpp"
#include "protocol/recording.hpp"
#include "protocol/syntax.hpp"
#include "protocol/wave.hpp"

namespace isorig::protocol {
namespace {

using base::Range;
using syntax::Node;

constexpr double kWeek_s = 7 * 24 * 3600.0;
constexpr double kYear_s = 365 * 24 * 3600.0;
/// Limits are decimal numbers, positions are sums of them.
constexpr double kEpsilon = 1e-9;

/// Walks the tree with the variables bound, and lays down the plan step by step.
class Compiler : private Evaluator {
 public:
  Compiler(const syntax::Protocol& protocol, const Limits& limits, Plan& plan)
      : Evaluator(protocol.constants), limits_(limits), plan_(plan) {}

  void run(const syntax::Protocol& protocol, const base::TomlTable& root) {
    if (!within_budget(protocol.steps, root)) return;
    walk(protocol.steps);
    if (plan_.steps.empty()) {
      root.error("steps", "the protocol has no steps");
      return;
    }
    if (plan_.sessions.empty()) {
      open_session(nullptr);
      for (auto& step : plan_.steps) {
        step.session = 0;
        step.repetition = plan_.sessions.front().repetition;
      }
      close_session(root, 0, "");
    }
    if (plan_.worst_s > kYear_s) {
      root.error("steps", "the whole takes up to " + number_text(plan_.worst_s / kYear_s) +
                              " years; at most one is taken: shorten holds, time-outs or repeats");
    }
    if (const auto v = plan_.approach_velocity_mm_s; v > limits_.speed_max_mm_s || v < limits_.speed_min_mm_s) {
      root.error("approach_velocity_mm_s", "`approach_velocity_mm_s` = " + number_text(v) + "; " + speed_range());
    }
  }

 private:
  void walk(const std::vector<Node>& nodes) {
    for (const auto& node : nodes) {
      if (node.is_repeat) {
        repeat(node);
      } else {
        step(node);
      }
    }
  }

  void repeat(const Node& node) {
    const auto turns = static_cast<std::size_t>(node.turns());
    for (std::size_t turn = 0; turn < turns; ++turn) {
      const std::size_t outer = bind(node.bindings_of(turn));
      const auto first = static_cast<std::uint32_t>(plan_.steps.size());
      if (node.is_session) open_session(&node);
      walk(node.body);
      if (node.is_session) close_session(node.table, first, node.label);
      unbind(outer);
    }
  }

  void open_session(const Node* node) {
    Session session;
    session.position_mm = node == nullptr ? 0.0 : position_mm_;
    session.repetition = 0;
    if (node != nullptr && node->values.contains("repetition")) {
      session.repetition = static_cast<std::int32_t>(whole(*node, "repetition", {1.0, 1e6}));
    }
    plan_.sessions.push_back(session);
    in_session_ = true;
  }

  /// The session's pressure is that of its first pressurize, which has to come before any motion.
  void close_session(const base::TomlTable& table, std::uint32_t first, const std::string& label) {
    in_session_ = false;
    auto& session = plan_.sessions.back();
    const auto begin = plan_.steps.begin() + first;
    const auto pressurize =
        std::find_if(begin, plan_.steps.end(), [](const Step& step) { return step.kind != StepKind::kMark; });
    if (begin == plan_.steps.end()) {
      note(table, {}, "a session without steps");
      plan_.sessions.pop_back();
      return;
    }
    if (pressurize == plan_.steps.end() || pressurize->kind != StepKind::kPressurize) {
      note(table, "steps",
           "a session begins with a pressurize (to 0 psi if it needs none), so that it can be resumed on its "
           "own from a vented actuator");
    } else {
      session.pressure_psi = pressurize->pressure_psi;
    }
    session.first_step = first;
    session.last_step = static_cast<std::uint32_t>(plan_.steps.size() - 1);
    if (session.repetition == 0) {
      session.repetition = sessions_at_psi_[session.pressure_psi] + 1;
    }
    ++sessions_at_psi_[session.pressure_psi];
    for (auto it = begin; it != plan_.steps.end(); ++it) it->repetition = session.repetition;
    session.label =
        "repetition " + std::to_string(session.repetition) + ", " + number_text(session.pressure_psi) + " psi";
    if (!label.empty()) {
      std::string error;
      if (auto text = fill_in(label, bindings(), error)) {
        session.label = *std::move(text);
      } else {
        note(table, "label", "`label`: " + error);
      }
    }
    if (!session_labels_.insert(session.label).second) {
      note(table, {},
           "two sessions are called \"" + session.label +
               "\"; bind `repetition`, or give the session a `label` with its {variables}");
    }
  }

  void step(const Node& node) {
    begin_step();
    Step out;
    out.index = static_cast<std::uint32_t>(plan_.steps.size());
    if (in_session_) out.session = static_cast<std::uint32_t>(plan_.sessions.size() - 1);
    out.kind = node.kind;
    const auto at = node.table.where();
    out.line = at.line;
    out.column = at.column;
    out.start_s = plan_.nominal_s;
    out.position_before_mm = out.position_after_mm = position_mm_;
    out.pressure_psi = setpoint_psi_;
    switch (node.kind) {
      case StepKind::kPressurize:
        pressurize(node, out);
        break;
      case StepKind::kSettle:
        settle(node, out);
        break;
      case StepKind::kRamp:
        ramp(node, out);
        break;
      case StepKind::kHold:
        out.duration_s = out.nominal_s = value(node, "duration_s", {0.0, kWeek_s, true}, 1.0);
        break;
      case StepKind::kWave:
        wave(node, out);
        break;
      case StepKind::kMark:
        mark(node, out);
        break;
    }
    out.worst_s = out.timeout_s > 0.0 ? out.timeout_s : out.nominal_s;
    out.keep = resolve_keep(plan_.recording.mode, out.kind, node.record);
    position_mm_ = out.position_after_mm;
    setpoint_psi_ = out.pressure_psi;
    plan_.nominal_s += out.nominal_s;
    plan_.worst_s += out.worst_s;
    plan_.peak_speed_mm_s = std::max(plan_.peak_speed_mm_s, out.velocity_mm_s);
    plan_.position_min_mm = std::min(plan_.position_min_mm, position_mm_ - out.amplitude_mm);
    plan_.position_max_mm = std::max(plan_.position_max_mm, position_mm_ + out.amplitude_mm);
    plan_.pressure_max_psi = std::max(plan_.pressure_max_psi, setpoint_psi_);
    plan_.steps.push_back(out);
  }

  void pressurize(const Node& node, Step& out) {
    const double before_psi = out.pressure_psi;
    out.pressure_psi = value(node, "pressure_psi", {0.0, 1000.0}, before_psi);
    out.tolerance_psi = value(node, "tolerance_psi", base::kPositive, 0.1);
    out.settled_for_s = value(node, "settled_for_s", {0.0, 3600.0}, 1.0);
    out.rate_psi_s = value(node, "rate_psi_s", base::kPositive, 1.0);
    out.timeout_s = value(node, "timeout_s", {0.0, 24 * 3600.0, true}, 60.0);
    if (out.pressure_psi > limits_.pressure_max_psi && all_well(node, {"pressure_psi"})) {
      note(node.table, "pressure_psi",
           said(node, "pressure_psi", out.pressure_psi) + "; the rig allows at most " +
               number_text(limits_.pressure_max_psi) + " (limits.pressure_max_psi)");
    }
    if (out.rate_psi_s > limits_.pressure_rate_max_psi_s && all_well(node, {"rate_psi_s"})) {
      note(node.table, "rate_psi_s",
           said(node, "rate_psi_s", out.rate_psi_s) + "; the rig allows at most " +
               number_text(limits_.pressure_rate_max_psi_s) + " (limits.pressure_rate_max_psi_s)");
    }
    out.nominal_s = std::abs(out.pressure_psi - before_psi) / out.rate_psi_s + out.settled_for_s;
    // Resumed, a session starts from a vented actuator.
    const double longest_s = std::max(out.nominal_s, out.pressure_psi / out.rate_psi_s + out.settled_for_s);
    if (all_well(node, {"pressure_psi", "rate_psi_s", "settled_for_s", "timeout_s"}) && out.timeout_s <= longest_s) {
      note(node.table, "timeout_s",
           said(node, "timeout_s", out.timeout_s) + ", but the set-point alone takes " + number_text(longest_s) +
               " s at rate_psi_s, settled_for_s included; allow "
               "clearly more");
    }
  }

  void settle(const Node& node, Step& out) {
    out.force_slope_N_s = value(node, "force_slope_N_s", base::kPositive, 1.0);
    out.window_s = value(node, "window_s", {ForceSlope::kMinWindow_s, 3600.0}, 10.0);
    out.settled_for_s = value(node, "settled_for_s", {0.0, 3600.0}, 2.0);
    out.timeout_s = value(node, "timeout_s", {0.0, kWeek_s, true}, 60.0);
    out.on_timeout = node.on_timeout;
    const double shortest_s = out.window_s + out.settled_for_s;
    out.nominal_s = value(node, "expected_s", base::kPositive, shortest_s);
    if (all_well(node, {"window_s", "settled_for_s", "timeout_s"}) && out.timeout_s <= shortest_s) {
      note(node.table, "timeout_s",
           said(node, "timeout_s", out.timeout_s) +
               ", but the force cannot be judged in "
               "less than window_s + settled_for_s = " +
               number_text(shortest_s) + " s");
    } else if (all_well(node, {"expected_s", "window_s", "settled_for_s", "timeout_s"}) &&
               (out.nominal_s < shortest_s || out.nominal_s > out.timeout_s)) {
      note(node.table, "expected_s",
           said(node, "expected_s", out.nominal_s) +
               "; it lies between window_s + "
               "settled_for_s = " +
               number_text(shortest_s) + " s and timeout_s = " + number_text(out.timeout_s) + " s");
    }
  }

  void ramp(const Node& node, Step& out) {
    out.target_mm = value(node, "to_mm", {}, position_mm_);
    out.velocity_mm_s = value(node, "velocity_mm_s", base::kPositive, 1.0);
    if (all_well(node, {"velocity_mm_s"})) check_speed(node, "velocity_mm_s", out.velocity_mm_s);
    if (outside_travel(out.target_mm, out.velocity_mm_s)) {
      note(node.table, "to_mm",
           said(node, "to_mm", out.target_mm) + "; " + travel_range(out.target_mm, out.velocity_mm_s));
      out.target_mm = position_mm_;  // what follows is checked from where the rig can be
    }
    const double distance_mm = std::abs(out.target_mm - position_mm_);
    out.nominal_s = distance_mm / out.velocity_mm_s;
    out.position_after_mm = out.target_mm;
    plan_.travel_mm += distance_mm;
  }

  void wave(const Node& node, Step& out) {
    out.shape = node.shape;
    out.target_mm = position_mm_;
    out.amplitude_mm = value(node, "amplitude_mm", base::kPositive, 1.0);
    out.cycles = static_cast<std::uint32_t>(whole(node, "cycles", {1.0, 1e6}));
    const bool sine = node.shape == WaveShape::kSine;
    // Peak speed per Hz: 4 A f for a triangle, 2 pi A f for a sine.
    const double speed_per_hz = (sine ? 2.0 * std::numbers::pi : 4.0) * out.amplitude_mm;
    const bool by_velocity = node.table.has("velocity_mm_s");
    const char* rate_key = by_velocity ? "velocity_mm_s" : "frequency_hz";
    if (by_velocity) {
      out.velocity_mm_s = value(node, rate_key, base::kPositive, 1.0);
      out.frequency_hz = out.velocity_mm_s / speed_per_hz;
    } else {
      out.frequency_hz = value(node, rate_key, base::kPositive, 0.1);
      out.velocity_mm_s = out.frequency_hz * speed_per_hz;
    }
    out.nominal_s = out.cycles / out.frequency_hz;
    plan_.travel_mm += 4.0 * out.amplitude_mm * out.cycles;
    if (!all_well(node, {"amplitude_mm", rate_key})) return;
    check_speed(node, rate_key, out.velocity_mm_s);
    const double turning_mm_s = sine ? 0.0 : out.velocity_mm_s;
    for (const double end_mm : {position_mm_ - out.amplitude_mm, position_mm_ + out.amplitude_mm}) {
      if (outside_travel(end_mm, turning_mm_s)) {
        note(node.table, "amplitude_mm",
             said(node, "amplitude_mm", out.amplitude_mm) + " about " + number_text(position_mm_) + " mm goes to " +
                 number_text(end_mm) + "; " + travel_range(end_mm, turning_mm_s));
      }
    }
    if (sine) {
      cut_sine(node, out, rate_key);
    } else {
      check_interval(node, rate_key, 0.25 / out.frequency_hz, "quarter of a cycle");
    }
  }

  /// As few chords as keep the sine within deviation_mm.
  void cut_sine(const Node& node, Step& out, const char* rate_key) {
    const double allowed_mm =
        value(node, "deviation_mm", {1e-4 * out.amplitude_mm, out.amplitude_mm / 4.0}, 0.01 * out.amplitude_mm);
    out.segments_per_quarter = static_cast<std::uint32_t>(
        std::ceil(std::numbers::pi / (4.0 * std::acos(1.0 - allowed_mm / out.amplitude_mm)) - kEpsilon));
    out.deviation_mm = wave::deviation_mm(out.amplitude_mm, out.segments_per_quarter);
    check_interval(node, rate_key, 0.25 / (out.frequency_hz * out.segments_per_quarter),
                   "segment of a sine cut in " + std::to_string(4 * out.segments_per_quarter));
    const double slowest_mm_s = wave::quarter_speed_mm_s(out, out.segments_per_quarter - 1);
    if (slowest_mm_s < limits_.speed_min_mm_s) {
      note(node.table, rate_key,
           said(node, rate_key, value(node, rate_key, {}, 0.0)) + " needs a segment at " + number_text(slowest_mm_s) +
               " mm/s at the turning points; the rig's slowest is " + number_text(limits_.speed_min_mm_s) +
               " (limits.speed_min_mm_s): be faster or allow a larger deviation_mm");
    }
  }

  void mark(const Node& node, Step& out) {
    std::string error;
    const auto text = fill_in(node.label, bindings(), error);
    if (!text) {
      note(node.table, "label", "`label`: " + error);
    } else if (text->size() >= sizeof out.label) {
      note(node.table, "label",
           "`label` = \"" + *text + "\" is too long; at most " + std::to_string(sizeof out.label - 1) + " bytes");
    } else {
      std::memcpy(out.label, text->c_str(), text->size());
    }
  }

  void check_speed(const Node& node, std::string_view key, double speed_mm_s) {
    if (speed_mm_s <= limits_.speed_max_mm_s * (1.0 + kEpsilon) &&
        speed_mm_s >= limits_.speed_min_mm_s * (1.0 - kEpsilon)) {
      return;
    }
    const double given = value(node, key, {}, speed_mm_s);
    note(node.table, key,
         said(node, key, given) + (given == speed_mm_s ? "" : ", a peak of " + number_text(speed_mm_s) + " mm/s") +
             "; " + speed_range());
  }

  void check_interval(const Node& node, std::string_view key, double interval_s, const std::string& what) {
    if (interval_s >= limits_.segment_interval_min_s * (1.0 - kEpsilon)) return;
    note(node.table, key,
         said(node, key, value(node, key, {}, 0.0)) + " makes every " + what + " last " + number_text(interval_s) +
             " s; the rig's frame takes one per " + number_text(limits_.segment_interval_min_s) +
             " s (limits.segment_interval_min_s): be slower" +
             (node.shape == WaveShape::kSine ? " or allow a larger deviation_mm" : ""));
  }

  [[nodiscard]] bool outside_travel(double position_mm, double velocity_mm_s) const {
    const double room_mm = Limits::travel_room_mm(velocity_mm_s) - kEpsilon;
    return position_mm > limits_.travel_max_mm - room_mm || position_mm < limits_.travel_min_mm + room_mm;
  }
  [[nodiscard]] std::string travel_range(double position_mm, double velocity_mm_s) const {
    const std::string range = "the rig travels from " + number_text(limits_.travel_min_mm) + " to " +
                              number_text(limits_.travel_max_mm) + " mm (limits.travel_min_mm, limits.travel_max_mm)";
    if (outside_travel(position_mm, 0.0)) return range;
    return range + ", and a crosshead at " + number_text(velocity_mm_s) + " mm/s runs over its target: stay " +
           number_text(Limits::travel_room_mm(velocity_mm_s)) + " mm inside, or be slower";
  }
  [[nodiscard]] std::string speed_range() const {
    return "the rig allows " + number_text(limits_.speed_min_mm_s) + " to " + number_text(limits_.speed_max_mm_s) +
           " mm/s (limits.speed_min_mm_s, limits.speed_max_mm_s)";
  }

  const Limits& limits_;
  Plan& plan_;
  double position_mm_ = 0.0;
  double setpoint_psi_ = 0.0;
  bool in_session_ = false;
  std::map<double, std::int32_t> sessions_at_psi_;
  std::set<std::string> session_labels_;
};

}  // namespace

Plan compile(const base::TomlDocument& document, const Limits& limits) {
  const auto root = document.root();
  const auto protocol = syntax::parse(root);
  Plan plan;
  plan.name = protocol.name;
  plan.description = protocol.description;
  plan.source = document.name();
  plan.recording = protocol.recording;
  plan.approach_velocity_mm_s = protocol.approach_velocity_mm_s;
  Compiler(protocol, limits, plan).run(protocol, root);
  document.finish();
  resolve_recording(plan);
  return plan;
}

Plan compile_file(const std::filesystem::path& path, const Limits& limits) {
  return compile(base::TomlDocument::parse_file(path), limits);
}

}  // namespace isorig::protocol
