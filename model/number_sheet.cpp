#include "model/number_sheet.hpp"

namespace isorig::model {

const NumberSheet* sheet_of(const Law& law, std::string_view number) {
  for (const auto& p : law.parameters)
    if (p.name == number) return &p.sheet;
  for (const auto& c : law.coefficients)
    if (c.name == number) return &c.sheet;
  return nullptr;
}

std::string meaning_of(const NumberSheet* sheet) {
  if (sheet == nullptr) return {};
  std::string out(sheet->what.substr(0, sheet->what.find(';')));
  while (out.ends_with('.')) out.pop_back();
  if (!out.empty() && out[0] >= 'A' && out[0] <= 'Z') out[0] = static_cast<char>(out[0] - 'A' + 'a');
  return out;
}

std::string unit_behind(const NumberSheet* sheet) {
  return sheet == nullptr || sheet->unit.empty() || sheet->unit == "1" ? "" : " " + std::string(sheet->unit);
}

}  // namespace isorig::model
