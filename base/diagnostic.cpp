#include "base/printable.hpp"
#include "base/toml_reader.hpp"

namespace isorig::base {
namespace {

std::string join(const std::vector<Diagnostic>& diagnostics) {
  std::string all;
  for (const auto& d : diagnostics) {
    if (!all.empty()) all += '\n';
    all += d.text();
  }
  return all;
}

}  // namespace

std::string Diagnostic::text() const {
  if (line == 0) return printable(file + ": " + message);  // of the whole file
  return printable(file) + ":" + std::to_string(line) + ":" + std::to_string(column) + ": " + printable(message);
}

ConfigError::ConfigError(std::vector<Diagnostic> diagnostics)
    : std::runtime_error(join(diagnostics)), diagnostics_(std::move(diagnostics)) {}

}  // namespace isorig::base
