#include "identify/diagnose/deciding/deciding_table.hpp"

#include <nlohmann/json.hpp>

#include "base/number_text.hpp"

namespace isorig::identify {

using nlohmann::ordered_json;

std::string deciding_table() {
  std::string out;
  for (const DecidingNumber& one : deciding_numbers()) {
    const std::string unit = one.unit == "1" ? std::string() : " " + std::string(one.unit);
    out += std::string(one.name) + " = " + base::number_text(one.stated) + unit + "  (" + base::number_text(one.least) +
           " to " + base::number_text(one.most) + (one.whole ? ", whole" : "") + ")\n    " + std::string(one.what) +
           "\n    From: " + std::string(one.derivation) + ".\n";
  }
  return out;
}

ordered_json deciding_json() {
  ordered_json list = ordered_json::array();
  for (const DecidingNumber& one : deciding_numbers())
    list.push_back({{"name", one.name},
                    {"value", one.stated},
                    {"unit", one.unit},
                    {"least", one.least},
                    {"most", one.most},
                    {"whole", one.whole},
                    {"what", one.what},
                    {"derivation", one.derivation}});
  return list;
}

ordered_json changed_json(std::span<const Decided> changed) {
  ordered_json json = ordered_json::object();
  for (const Decided& one : changed) json[std::string(one.name)] = one.value;
  return json;
}

}  // namespace isorig::identify
