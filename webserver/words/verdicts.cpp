#include "webserver/words/verdicts.hpp"

#include "cli/screen/live_verdicts.hpp"

namespace isorig::web {
namespace {

const char* name_of(cli::Tone tone) {
  return tone == cli::Tone::kBad ? "bad" : tone == cli::Tone::kWarn ? "warn" : "good";
}

}  // namespace

nlohmann::json verdicts_of(const nlohmann::json& status) {
  nlohmann::json out = nlohmann::json::object();
  const auto judged = [&](const char* key, cli::Said (*judge)(const nlohmann::json&)) {
    const auto part = status.find(key);
    if (part == status.end() || !part->is_object()) return;
    try {
      const auto said = judge(*part);
      out[key] = {{"tone", name_of(said.tone)}, {"text", said.text}};
    } catch (const nlohmann::json::exception&) {
      // A daemon of another release: the page says that there is no verdict.
    }
  };
  judged("loop", cli::judge_loop);
  judged("frame", cli::judge_device);
  judged("pressure", cli::judge_device);
  return out;
}

}  // namespace isorig::web
