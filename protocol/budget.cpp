#include "protocol/budget.hpp"

namespace isorig::protocol {
namespace {

using syntax::Node;

/// Doubles: nested repeats exceed every whole number.
struct Work {
  double steps = 0.0, turns = 0.0;
  [[nodiscard]] bool too_much() const { return !(steps <= kMaxSteps && turns <= kMaxTurns); }
};

Work work_of(const std::vector<Node>& nodes);

Work work_of(const Node& node) {
  if (!node.is_repeat) return {1.0, 0.0};
  const double turns = node.turns();
  const Work body = work_of(node.body);
  return {turns * body.steps, turns * (1.0 + body.turns)};
}

Work work_of(const std::vector<Node>& nodes) {
  Work all;
  for (const auto& node : nodes) {
    const Work one = work_of(node);
    all.steps += one.steps;
    all.turns += one.turns;
  }
  return all;
}

/// The innermost repeat that is too long by itself, in writing order; null: only the sum is.
const Node* culprit(const std::vector<Node>& nodes) {
  for (const auto& node : nodes) {
    if (!node.is_repeat || !work_of(node).too_much()) continue;
    const Node* inner = culprit(node.body);
    return inner != nullptr ? inner : &node;
  }
  return nullptr;
}

std::string text_of(const Work& work) {
  if (!(work.steps <= kMaxSteps)) {
    return number_text(work.steps) + " steps; more than " + number_text(kMaxSteps) + " steps are not taken";
  }
  return number_text(work.turns) + " turns of repeats; more than " + number_text(kMaxTurns) + " turns are not taken";
}

}  // namespace

bool within_budget(const std::vector<Node>& steps, const base::TomlTable& root) {
  const Work all = work_of(steps);
  if (!all.too_much()) return true;
  if (const Node* node = culprit(steps)) {
    node->table.error({}, "this repeat turns " + number_text(node->turns()) + " times and comes to " +
                              text_of(work_of(*node)) + ": shorten it or what it repeats");
  } else {
    root.error("steps", "all repeats together come to " + text_of(all) + ": shorten them");
  }
  return false;
}

}  // namespace isorig::protocol
