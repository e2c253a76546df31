#include "cli/runs/import_constant.hpp"

#include <algorithm>
#include <functional>

#include "base/number_text.hpp"
#include "cli/runs/import_files.hpp"

namespace isorig::cli {
namespace {

using foreign::Field;

const std::vector<double>* values_of(const foreign::Test& test, Field field) {
  if (field == Field::kPosition && test.frame) return &test.frame->position_mm;
  if (field == Field::kForce && test.frame) return &test.frame->force_N;
  if (field == Field::kPressure && test.pressure) return &test.pressure->pressure_psi;
  return nullptr;
}

std::string advice(Field field) {
  const std::string name(foreign::name_of(field));
  return "\n  name the column that is the " + name + " with --column " + name + "=NAME" +
         (field == Field::kForce ? ", say --output position if it is a constant load," : ",") +
         " or, if all is as stated, --as-stated";
}

}  // namespace

std::vector<std::string> check_constant_columns(const std::filesystem::path& file, const foreign::Test& test,
                                                messages::Output output, bool as_stated) {
  std::vector<std::string> notes;
  const foreign::Table table{test.line, test.columns, {}};
  for (const auto& source : test.sources) {
    const auto* values = values_of(test, source.field);
    if (values == nullptr || values->size() < 2) continue;
    if (std::ranges::adjacent_find(*values, std::not_equal_to{}) != values->end()) continue;
    const std::string what =
        "column " + foreign::shown(table, source.column) + " never changes: " + base::number_text(values->front()) +
        " " + std::string(foreign::unit_of(source.field)) + " in all " + std::to_string(values->size()) + " rows";
    if (!as_stated && foreign::name_of(source.field) == messages::name_of(output))
      throw ImportRefused(file.string() + ":" + std::to_string(test.line) + ": " + what + ", so no " +
                          std::string(foreign::name_of(source.field)) + " was measured" + advice(source.field));
    notes.push_back(what);
  }
  return notes;
}

}  // namespace isorig::cli
