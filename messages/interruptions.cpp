#include "messages/interruptions.hpp"

#include <toml++/toml.h>

namespace isorig::messages {

std::vector<double> interruptions_s(const RecordingMetadata& metadata) {
  std::vector<double> out;
  try {
    const toml::table further = toml::parse(metadata.further_toml);
    const toml::array* events = further["events"].as_array();
    if (events == nullptr) return out;
    for (const toml::node& event : *events) {
      const toml::table* fields = event.as_table();
      if (fields == nullptr) continue;
      const auto code = (*fields)["code"].value<std::string>();
      const auto t_s = (*fields)["t_s"].value<double>();
      if (t_s && (code == "pause" || code == "resume")) out.push_back(*t_s);
    }
  } catch (const toml::parse_error&) {  // of another program's making
    out.clear();
  }
  return out;
}

}  // namespace isorig::messages
