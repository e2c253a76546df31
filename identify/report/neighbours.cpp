#include "identify/report/neighbours.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <set>
#include <system_error>

#include "base/report_pages.hpp"
#include "base/toml_reader.hpp"

namespace isorig::identify::report {
namespace {

namespace fs = std::filesystem;

struct Known {
  std::string_view file, text;
};
using base::kReportPages, base::kRunPage;
constexpr std::array kPages{Known{kReportPages[0], "Run"}, Known{kReportPages[1], "Force-velocity analysis"},
                            Known{kReportPages[2], "Campaign"}, Known{kReportPages[3], "Diagnosis"},
                            Known{kReportPages[4], "Investigation"}};
constexpr std::size_t kMost = 12;
constexpr std::size_t kMostFolders = 1000;  // of one folder that are looked into: a folder of runs grows for years

bool is_file(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

bool is_run(const fs::path& folder) {
  return is_file(folder / "run.toml");
}

std::vector<fs::path> folders_in(const fs::path& folder) {
  std::vector<fs::path> out;
  std::error_code error;
  std::size_t left = kMostFolders;
  for (fs::directory_iterator at(folder, error), end; !error && at != end && left > 0; at.increment(error), --left) {
    std::error_code ignored;
    if (at->symlink_status(ignored).type() == fs::file_type::directory) out.push_back(at->path());
  }
  std::ranges::sort(out);
  return out;
}

bool lies_in(const fs::path& inside, const fs::path& folder) {
  const auto relative = inside.lexically_relative(folder);
  return !relative.empty() && *relative.begin() != "..";
}

/// Without a last slash, links followed: what two paths are compared by.
fs::path whole(const fs::path& path) {
  std::error_code error;
  auto out = fs::weakly_canonical(path, error);
  if (error) out = fs::absolute(path).lexically_normal();
  return out.has_filename() ? out : out.parent_path();
}

class Finder {
 public:
  Finder(fs::path folder, std::string_view own) : folder_(std::move(folder)), own_(own) {}

  void look_in(const fs::path& where, bool runs_too) {
    for (const Known& page : kPages) {
      if (links_.size() >= kMost || (page.file == kRunPage && !runs_too)) continue;
      const fs::path file = where / page.file;
      if ((where == folder_ && page.file == own_) || !is_file(file) || !seen_.insert(file).second) continue;
      const std::string href = as_link(file.lexically_relative(folder_).generic_string());
      const bool elsewhere = where != folder_;
      links_.emplace_back(std::string(page.text) + (elsewhere ? " (" + where.filename().string() + ")" : ""), href);
    }
  }
  [[nodiscard]] Links take() { return std::move(links_); }

 private:
  fs::path folder_;
  std::string_view own_;
  std::set<fs::path> seen_;
  Links links_;
};

}  // namespace

std::string as_link(const std::string& path) {
  constexpr std::string_view kHex = "0123456789ABCDEF", kPlain = "/-._~";
  std::string out;
  for (const char c : path) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0 || kPlain.find(c) != std::string_view::npos)
      out += c;
    else
      out.append("%").append(1, kHex[byte >> 4U]).append(1, kHex[byte & 15U]);
  }
  return out;
}

bool is_page_of_another(std::string_view file_name, std::string_view own_name) {
  return file_name != own_name && base::is_report_page(file_name);
}

fs::path run_folder_above(const fs::path& inside) {
  constexpr int kLevels = 5;
  fs::path at = whole(inside);
  for (int level = 0; level < kLevels; ++level, at = at.parent_path()) {
    if (is_run(at)) return at;
    if (!at.has_relative_path()) break;
  }
  return {};
}

std::vector<RunOf> runs_of(const std::vector<std::string>& inputs) {
  std::vector<RunOf> out;
  for (const std::string& input : inputs) {
    if (out.size() >= kMost || input.size() >= 4096 || !is_file(fs::path(input) / "recording.toml")) continue;
    try {
      const auto document = base::TomlDocument::parse_file(fs::path(input) / "recording.toml");
      const auto said = document.root();
      RunOf run{said.string_or("run", ""), said.string_or("run_directory", "")};
      if (!run.id.empty() && std::ranges::find(out, run.id, &RunOf::id) == out.end()) out.push_back(std::move(run));
    } catch (const base::ConfigError&) {  // who reads the recording says what is wrong with it
    }
  }
  return out;
}

Links neighbours(const fs::path& folder, std::string_view file_name, const std::vector<std::string>& inputs) {
  const fs::path here = whole(folder);
  Finder finder(here, file_name);
  finder.look_in(here, true);
  for (const fs::path& in : folders_in(here)) finder.look_in(in, false);
  std::vector<fs::path> made_from;
  for (const std::string& input : inputs) {
    std::error_code error;
    if (input.size() < 4096 && fs::exists(input, error)) made_from.push_back(whole(input));
  }
  if (here.has_relative_path()) {
    const fs::path round = here.parent_path();
    finder.look_in(round, true);
    const bool holds_an_input =
        std::ranges::any_of(made_from, [&](const fs::path& input) { return lies_in(input, round); });
    if (!is_run(here) && (is_run(round) || holds_an_input))
      for (const fs::path& beside : folders_in(round))
        if (beside != here && !is_run(beside)) finder.look_in(beside, false);
  }
  made_from.push_back(here);
  for (const fs::path& inside : made_from)
    if (const fs::path run = run_folder_above(inside); !run.empty()) finder.look_in(run, true);
  for (const RunOf& run : runs_of(inputs))
    if (run.folder.is_absolute() && is_run(run.folder)) finder.look_in(whole(run.folder), true);
  return finder.take();
}

}  // namespace isorig::identify::report
