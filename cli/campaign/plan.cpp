#include "cli/campaign/plan.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <nlohmann/json.hpp>

#include "base/fingerprint.hpp"
#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "base/text_file.hpp"
#include "base/whole_file.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr const char* kPlanFormat = "isorig-campaign-plan/1";

/// campaign.json that merge() wrote. It may be as long as the campaign; what it is stands in its first lines.
bool is_of_pieces(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::array<char, 200> head{};
  in.read(head.data(), head.size() - 1);
  return std::string_view(head.data()).find("\"isorig-campaign-pieces/") != std::string_view::npos;
}

/// A folder that something else was written into is not to be mixed with.
void refuse_other_campaign(const Plan& plan) {
  if (!fs::exists(plan.folder / "plan.json")) {
    const bool tables = fs::exists(plan.folder / "campaign.json");
    if (tables && !is_of_pieces(plan.folder / "campaign.json"))
      throw PlanError(plan.folder.string() +
                      ": holds the paper's figures (`isorig campaign` without --ask); name another folder with --out");
    if (!tables && fs::exists(plan.folder / "pooled.json"))
      throw PlanError(plan.folder.string() +
                      ": holds what `isorig pool` wrote, which this would replace; name another folder with --out");
    return;
  }
  const Plan there = read_plan(plan.folder);
  if (const std::string differs = difference(there.ask, plan.ask); !differs.empty())
    throw PlanError(plan.folder.string() + ": holds a campaign of other options (" + differs +
                    "); give the same ones to go on with it, or name another folder with --out");
}

/// Which files a recording is, whatever path leads to them; "" where there are none. The readings tell, since a link to
/// them beside a recording.toml of its own is the same measurement.
std::string files_behind(const std::string& recording) {
  for (const char* name : {"frame.csv", "pressure.csv", "recording.toml"}) {
    struct stat found {};
    // Some file systems number no files.
    if (::stat((fs::path(recording) / name).c_str(), &found) == 0 && found.st_ino != 0)
      return std::to_string(found.st_dev) + ":" + std::to_string(found.st_ino);
  }
  return {};
}

std::uint64_t number_of(const std::string& digits) {
  std::uint64_t hash = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), hash, 16);
  return hash;
}

/// Takes in paths and writes them, and remembers 16 bytes of each to find one that is there twice.
class Writer {
 public:
  Writer(const fs::path& file, const ReadSoFar& at) : file_(file), out_(file, std::ios::binary), at_(at) {}

  /// `fraction`: of what names recordings, read before this one.
  void add(const std::string& named, const std::string& where, double fraction) {
    constexpr std::size_t kEach = 256;  // each is a look at three files
    if (at_ && seen_.size() % kEach == 0) at_(fraction, "reading the list: " + std::to_string(seen_.size()));
    std::string path;
    try {
      path = plan_path(named);
    } catch (const PlanError& e) {
      throw PlanError(where + e.what());
    }
    seen_.push_back(number_of(base::fingerprint(path)));
    if (const std::string files = files_behind(path); !files.empty())
      files_.push_back(number_of(base::fingerprint(files)));
    out_ << path << '\n';
  }

  std::size_t finish() {
    out_.close();
    if (!out_) throw PlanUnwritable(file_.string() + ": cannot be written; is there room, and may you write there?");
    if (seen_.empty()) throw PlanError("no recording is named: name some, or a file that lists them with --list");
    std::ranges::sort(seen_);
    const auto twice = std::ranges::adjacent_find(seen_);
    if (twice != seen_.end()) {
      std::string which;
      const std::string digits = base::formatted("%016llx", static_cast<unsigned long long>(*twice));
      for_each_line(file_, [&](const std::string& line) {
        if (base::fingerprint(line) == digits) which = line;
      });
      throw PlanError(which + ": named twice; name every recording once");
    }
    refuse_same_files();
    return seen_.size();
  }

 private:
  void refuse_same_files() {
    std::ranges::sort(files_);
    const auto twice = std::ranges::adjacent_find(files_);
    if (twice == files_.end()) return;
    std::vector<std::string> same;
    for_each_line(file_, [&](const std::string& line) {
      if (number_of(base::fingerprint(files_behind(line))) == *twice) same.push_back(line);
    });
    // Fewer: one was moved meanwhile.
    if (same.size() > 1)
      throw PlanError(same[1] + ": the same recording as " + same[0] +
                      ", by a link or another path, and would count twice; name every recording once");
  }

  fs::path file_;
  std::ofstream out_;
  const ReadSoFar& at_;
  std::vector<std::uint64_t> seen_, files_;
};

/// `bytes`: of the list; 0: not known, and nothing is said of how much is read.
void add_list(Writer& writer, std::istream& in, const std::string& name, std::uintmax_t bytes) {
  std::string line;
  std::uintmax_t before = 0;
  for (std::size_t number = 1; std::getline(in, line); ++number) {
    const double fraction = bytes > 0 ? static_cast<double>(before) / static_cast<double>(bytes) : 0.0;
    before += line.size() + 1;
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (!line.empty()) writer.add(line, name + ":" + std::to_string(number) + ": ", fraction);
  }
}

}  // namespace

fs::path piece_name(const std::string& recording) {
  const std::string digits = base::fingerprint(recording);
  std::string name = fs::path(recording).filename().string().substr(0, 60);
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && std::strchr("-_.", c) == nullptr) c = '_';
  if (name.empty() || name.front() == '.' || name.front() == '-') name.insert(0, "_");
  // FNV-1a mixes its low digits, not its high ones.
  return fs::path(digits.substr(digits.size() - 3)) / (name + "-" + digits);
}

std::string plan_path(const std::string& recording) {
  if (base::printable(recording) != recording)
    throw PlanError(base::printable(recording) +
                    ": a folder's name with control characters, or not in UTF-8; rename the folder");
  fs::path path = fs::absolute(recording).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  return path.string();
}

std::size_t write_plan(const Plan& plan, const Named& named, std::istream& standard_input, const ReadSoFar& at) {
  refuse_other_campaign(plan);
  const ordered_json stamp = stamp_of(plan.ask);
  const fs::path aside = plan.folder / "plan.txt.part";
  Writer writer(aside, at);
  for (const std::string& recording : named.recordings) writer.add(recording, "", 0.0);
  if (named.list == "-") {
    add_list(writer, standard_input, "standard input", 0);
  } else if (!named.list.empty()) {
    std::ifstream in(named.list);
    if (!in || fs::is_directory(named.list))
      throw PlanError(named.list + ": cannot be read; --list names a file with the path of a recording on each line");
    std::error_code unknown;
    const std::uintmax_t bytes = fs::file_size(named.list, unknown);
    add_list(writer, in, named.list, unknown ? 0 : bytes);
  }
  std::size_t count = 0;
  try {
    count = writer.finish();
  } catch (const PlanError&) {
    fs::remove(aside);
    throw;
  }
  ordered_json json{{"format", kPlanFormat}, {"ask", to_json(plan.ask)}, {"program", plan.program}};
  for (const char* key : {"model_sha256", "control_sha256"})
    if (stamp.contains(key)) json[key] = stamp[key];
  base::write_whole_file(plan.folder / "plan.json", json.dump(2) + "\n");
  fs::rename(aside, recordings_of(plan));
  return count;
}

Plan read_plan(const fs::path& folder) {
  const fs::path file = folder / "plan.json";
  try {
    const auto json = ordered_json::parse(base::read_text_file(file));
    if (json.at("format") != kPlanFormat)
      throw PlanError(file.string() + ": of another version of isorig (" + json.at("format").get<std::string>() +
                      "); name another folder with --out");
    return {fs::absolute(folder).lexically_normal(), ask_from_json(json.at("ask")), json.at("program"),
            json.value("model_sha256", std::string()), json.value("control_sha256", std::string())};
  } catch (const base::FileError& e) {
    throw PlanError(e.what());
  } catch (const nlohmann::json::exception& e) {
    throw PlanError(file.string() + ": damaged (" + e.what() + "); remove it, what is done stays");
  }
}

void for_each_line(const fs::path& file, const std::function<void(const std::string&)>& each) {
  std::ifstream in(file);
  if (!in) throw PlanError(file.string() + ": cannot be read; give the whole command again");
  std::string line;
  while (std::getline(in, line)) each(line);
}

FolderLock::FolderLock(const fs::path& folder, Of of, const std::string& caller) {
  using base::LockError;
  using base::LockFile;
  try {
    file_.emplace(folder / (of == Of::kCampaign ? "campaign.lock" : "pieces.lock"),
                  of == Of::kTask ? LockFile::Shared::kYes : LockFile::Shared::kNo);
  } catch (const LockError& e) {
    if (e.why() == LockError::Why::kUnwritable) throw PlanUnwritable(e.what());
    if (e.why() == LockError::Why::kNoLocks) throw PlanError(e.what());
    if (of == Of::kMaker)
      throw PlanError(folder.string() + ": tasks of a job array make its pieces (" + e.holder() +
                      "); wait for them with --on slurm, or end them with scancel");
    throw PlanError(folder.string() + ": another `" + caller + "` works there (" + e.holder() +
                    "); wait for it or end it");
  }
}

}  // namespace isorig::cli::pieces
