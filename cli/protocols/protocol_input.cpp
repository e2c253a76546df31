#include "cli/protocols/protocol_input.hpp"

#include "protocol/compile.hpp"

namespace isorig::cli {

protocol::Limits read_rig_limits(const std::filesystem::path& rig_path) {
  const auto rig = base::TomlDocument::parse_file(rig_path);
  const auto root = rig.root();
  root.ignore_rest();
  const auto limits = protocol::read_rig_limits(root);
  rig.finish();
  return limits;
}

protocol::Plan read_plan(const std::filesystem::path& protocol_path, const std::filesystem::path& rig_path) {
  std::vector<base::Diagnostic> wrong;
  protocol::Limits limits;
  if (!rig_path.empty()) {
    try {
      limits = read_rig_limits(rig_path);
    } catch (const base::ConfigError& e) {
      wrong = e.diagnostics();
      limits = {};
    }
  }
  try {
    auto plan = protocol::compile_file(protocol_path, limits);
    if (wrong.empty()) return plan;
  } catch (const base::ConfigError& e) {
    wrong.insert(wrong.end(), e.diagnostics().begin(), e.diagnostics().end());
  }
  throw base::ConfigError(std::move(wrong));
}

}  // namespace isorig::cli
