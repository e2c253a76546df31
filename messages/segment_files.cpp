#include "messages/segment_files.hpp"

#include <algorithm>
#include <charconv>
#include <string_view>
#include <system_error>

#include "base/formatted.hpp"

namespace isorig::messages {

std::string segment_name(int number) {
  return base::formatted("segment-%04d.lcm", number);
}

int segment_number(const std::filesystem::path& segment) {
  const auto name = segment.filename().string();
  constexpr std::string_view before = "segment-";
  constexpr std::string_view after = ".lcm";
  if (!name.starts_with(before) || !name.ends_with(after)) return 0;
  int number = 0;
  const char* end = name.data() + name.size() - after.size();
  const auto [stop, error] = std::from_chars(name.data() + before.size(), end, number);
  // One name for each number: segment-1.lcm beside segment-0001.lcm is no segment of ours.
  return error == std::errc{} && stop == end && number > 0 && name == segment_name(number) ? number : 0;
}

std::vector<std::filesystem::path> list_segments(const std::filesystem::path& run_dir) {
  std::vector<std::filesystem::path> found;
  if (std::filesystem::is_regular_file(run_dir)) found.push_back(run_dir);
  if (!std::filesystem::is_directory(run_dir)) return found;
  for (const auto& entry : std::filesystem::directory_iterator(run_dir)) {
    if (segment_number(entry.path()) > 0) found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end(),
            [](const auto& a, const auto& b) { return segment_number(a) < segment_number(b); });
  return found;
}

}  // namespace isorig::messages
