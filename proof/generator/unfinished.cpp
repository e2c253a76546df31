#include "proof/generator/unfinished.hpp"

#include "base/text_file.hpp"
#include "base/whole_file.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

fs::path folder_in(const fs::path& study) {
  return study / "sealed" / "unfinished";
}

/// Equal drawings of equal programs give equal cases.
ordered_json drawn(const StudyOptions& options) {
  return {{"seed", options.seed},
          {"cases", options.cases},
          {"laws", name_of(options.laws)},
          {"program", sha256(base::read_text_file("/proc/self/exe"))}};
}

/// Null where there is nothing, or nothing whole.
ordered_json read_json(const fs::path& file) {
  if (!fs::exists(file)) return nullptr;
  ordered_json json = ordered_json::parse(base::read_text_file(file), nullptr, false);
  return json.is_discarded() ? nullptr : json;
}

}  // namespace

Unfinished::Unfinished(const StudyOptions& options) : folder_(folder_in(options.out)) {
  const ordered_json now = drawn(options);
  if (read_json(folder_ / "study.json") == now) return;
  fs::remove_all(folder_);
  write_text(folder_ / "study.json", now.dump(2) + "\n");
}

fs::path Unfinished::file_of(std::size_t number) const {
  return folder_ / (std::to_string(number) + ".json");
}

std::optional<ordered_json> Unfinished::kept(std::size_t number) const {
  ordered_json json = read_json(file_of(number));
  if (json.is_null()) return std::nullopt;
  return json;
}

void Unfinished::keep(std::size_t number, const ordered_json& label) const {
  base::write_whole_file(file_of(number), label.dump() + "\n");
}

void Unfinished::finish() const {
  fs::remove_all(folder_);
}

std::optional<std::uint64_t> unfinished_seed(const StudyOptions& options) {
  const ordered_json there = read_json(folder_in(options.out) / "study.json");
  if (!there.is_object() || !there.contains("seed")) return std::nullopt;
  StudyOptions same = options;
  same.seed = there.at("seed");
  if (there != drawn(same)) return std::nullopt;
  return same.seed;
}

}  // namespace isorig::proof
