#include "cli/protocol_input.hpp"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "base/text_file.hpp"
#include "protocol/compile.hpp"

namespace isorig::cli {

protocol::Limits read_rig_limits(const std::filesystem::path& rig_path) {
  const auto rig = base::TomlDocument::parse_file(rig_path);
  const auto root = rig.root();
  root.ignore_rest();
  const auto limits = protocol::read_limits(root.table("limits"));
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

std::string read_text(const std::filesystem::path& path) {
  if (auto why = base::why_not_a_file(path); !why.empty()) {
    throw base::ConfigError({{path.string(), 0, 0, std::move(why)}});
  }
  std::ifstream in(path, std::ios::binary);
  if (!in) throw base::ConfigError({{path.string(), 0, 0, "cannot be opened; check the path and its permissions"}});
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

std::string duration_text(double seconds) {
  char text[48];
  if (seconds < 60.0) {
    std::snprintf(text, sizeof text, "%.1f s", seconds);
    return text;
  }
  const auto whole_s = static_cast<long long>(std::llround(seconds));
  if (whole_s < 3600) {
    std::snprintf(text, sizeof text, "%lld min %02lld s", whole_s / 60, whole_s % 60);
  } else {
    const long long minutes = (whole_s + 30) / 60;
    std::snprintf(text, sizeof text, "%lld h %02lld min", minutes / 60, minutes % 60);
  }
  return text;
}

}  // namespace isorig::cli
