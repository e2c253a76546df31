#include "cli/runs/overwriting.hpp"

#include <algorithm>

namespace isorig::cli {
namespace {

std::string few_of(const std::vector<std::string>& names) {
  constexpr std::size_t kMost = 10;
  std::string text;
  for (std::size_t i = 0; i < std::min(kMost, names.size()); ++i) text += (i == 0 ? "" : ", ") + names[i];
  return names.size() > kMost ? text + " and " + std::to_string(names.size() - kMost) + " more" : text;
}

}  // namespace

std::string why_not_to_overwrite(const std::filesystem::path& folder, const Overwriting& what) {
  std::error_code error;
  const auto is_read = [&](const std::filesystem::path& file) {
    for (const auto& source : what.read)
      if (std::filesystem::equivalent(file, source, error)) return true;
    return false;
  };
  for (const auto& names : {what.names, what.also})
    for (const auto name : names)
      if (const auto file = folder / name; is_read(file))
        return file.string() +
               ": is what the numbers are read from, and what is written would take its place; name another folder "
               "with --out";
  for (const auto name : what.names) {
    const auto file = folder / name;
    // A link that leads nowhere is somebody's as well.
    if (what.replace || !std::filesystem::exists(std::filesystem::symlink_status(file, error))) continue;
    return (name == "recording.toml" ? folder.string() + ": a recording is there already"
                                     : file.string() + ": is there already") +
           "; name another folder with --out, or --replace it";
  }
  return {};
}

std::vector<std::string> said_of(const messages::Replaced& replaced) {
  std::vector<std::string> lines, left;
  if (!replaced.removed.empty())
    lines.push_back("removed with the recording that was there: " + few_of(replaced.removed));
  for (const auto& name : replaced.left)
    if (name != "mapping.toml" && name != "mapping-answers.toml" && name != "align.json") left.push_back(name);
  if (!left.empty()) lines.push_back("left alone, as no part of a recording: " + few_of(left));
  return lines;
}

}  // namespace isorig::cli
