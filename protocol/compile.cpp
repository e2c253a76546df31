#include "protocol/compile.hpp"

#include <algorithm>
#include <utility>

#include "protocol/budget.hpp"
#include "protocol/compiler.hpp"
#include "protocol/recording.hpp"
#include "protocol/syntax.hpp"

namespace isorig::protocol {
namespace {

constexpr double kYear_s = 365 * 24 * 3600.0;

}  // namespace

using syntax::Node;

void Compiler::run(const syntax::Protocol& protocol, const base::TomlTable& root) {
  if (!within_budget(protocol.steps, root)) return;
  walk(protocol.steps);
  if (plan_.steps.empty()) {
    root.error("steps", "the protocol has no steps");
    return;
  }
  if (outside_ != nullptr && !plan_.sessions.empty()) {
    note(
        outside_->table, {},
        "a step outside of the sessions belongs to none of them: its samples would be recorded into the one beside it, "
        "and `isorig resume` would leave it out; put it into a session, or into one of its own with a `label`");
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
  check_approach(root);
}

/// The crosshead may stand anywhere when a run begins, and a session may be the first of a resumed run.
void Compiler::check_approach(const base::TomlTable& root) {
  if (!plan_.approaches) {
    const auto moves = [](const Step& step) { return step.kind == StepKind::kRamp || step.kind == StepKind::kWave; };
    if (const auto found = std::ranges::find_if(plan_.steps, moves); found != plan_.steps.end()) {
      root.error("approach",
                 "`approach` = false leaves the crosshead where it is, and line " + std::to_string(found->line) +
                     " moves it to a position that counts from the rest length; leave `approach` out, or that step");
    }
    return;
  }
  const double v = plan_.approach_velocity_mm_s;
  if (v > limits_.speed_max_mm_s || v < limits_.speed_min_mm_s) {
    root.error("approach_velocity_mm_s", "`approach_velocity_mm_s` = " + number_text(v) + "; " + speed_range());
    return;
  }
  for (const Session& session : plan_.sessions) {
    if (!outside_travel(session.position_mm, v)) continue;
    root.error("approach_velocity_mm_s", "`approach_velocity_mm_s` = " + number_text(v) + ", and \"" + session.label +
                                             "\" begins at " + number_text(session.position_mm) + " mm; " +
                                             travel_range(session.position_mm, v));
    return;
  }
}

void Compiler::walk(const std::vector<Node>& nodes) {
  for (const auto& node : nodes) {
    if (node.is_repeat) {
      repeat(node);
    } else {
      step(node);
    }
  }
}

void Compiler::repeat(const Node& node) {
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

void Compiler::open_session(const Node* node) {
  Session session;
  session.position_mm = node == nullptr ? 0.0 : position_mm_;
  session.repetition = 0;
  if (node != nullptr && node->values.contains("repetition")) {
    session.repetition = static_cast<std::int32_t>(whole(*node, "repetition", {1.0, 1e6}));
  }
  plan_.sessions.push_back(session);
  in_session_ = true;
}

void Compiler::close_session(const base::TomlTable& table, std::uint32_t first, const std::string& label) {
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

void Compiler::step(const Node& node) {
  begin_step();
  Step out;
  out.index = static_cast<std::uint32_t>(plan_.steps.size());
  if (in_session_) {
    out.session = static_cast<std::uint32_t>(plan_.sessions.size() - 1);
  } else if (outside_ == nullptr) {
    outside_ = &node;
  }
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

Plan compile(const base::TomlDocument& document, const Limits& limits) {
  const auto root = document.root();
  const auto protocol = syntax::parse(root);
  Plan plan;
  plan.name = protocol.name;
  plan.description = protocol.description;
  plan.source = document.name();
  plan.recording = protocol.recording;
  plan.twin = protocol.twin;
  plan.approaches = protocol.approaches;
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
